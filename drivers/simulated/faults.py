"""Faults that can be switched on in the simulated machine: of its thermocouples, and of its CAN frames."""

from __future__ import annotations

import asyncio
import random
from collections.abc import Callable, Mapping
from typing import Annotated

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field


def _one_or_many(names: object) -> object:
    return (names,) if isinstance(names, str) else names


Value = Annotated[float, Field(allow_inf_nan=False)]
Share = Annotated[float, Field(ge=0.0, le=1.0)]
Names = Annotated[tuple[str, ...], BeforeValidator(_one_or_many)]


class Faults(BaseModel):
    """The active faults: thermocouples by name, the other wires as a whole.

    A faulty value looks like any other. Thermocouples read `offset_K` too much, two have `exchanged` their
    plugs, and the axis has been homed `homed_off_m` from its former zero. CAN frames are held up for
    `hold_can_s` and then delivered at once. This happens now, or at random, on average every
    `hold_can_every_s`. `drop_can`, `double_can` and `swap_can` are the fractions of frames that are lost,
    doubled or swapped.

    Attributes:
        open: Thermocouples with a broken wire.
        over_range: Thermocouples beyond the module's range.
        stuck: Thermocouples that repeat their last value.
        exception: The Modbus exception code of every answer; None for answers.
        drop_modbus: Whether the Modbus server is down.
        silence_can: Whether the axis sends nothing.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    open: Names = ()
    over_range: Names = ()
    stuck: Names = ()
    offset_K: dict[str, Value] = Field(default_factory=dict)
    exchanged: tuple[str, str] | None = None
    homed_off_m: Value = 0.0
    exception: Annotated[int, Field(ge=1, le=11)] | None = None
    drop_modbus: bool = False
    silence_can: bool = False
    hold_can_s: Annotated[float, Field(ge=0.0, le=10.0)] = 0.0
    hold_can_every_s: Annotated[float, Field(ge=0.1)] | None = None
    drop_can: Share = 0.0
    double_can: Share = 0.0
    swap_can: Share = 0.0

    def read_degC(self, true_degC: Mapping[str, float], last_degC: Mapping[str, float]) -> dict[str, float]:
        """Return the readings of the thermocouples in °C, from the true and the last ones.

        Plugs are exchanged first, then offsets added; a stuck thermocouple repeats its last value.

        Args:
            true_degC: The readings without faults, by name.
            last_degC: The previous return value.
        """
        shown = dict(true_degC)
        if self.exchanged is not None and shown.keys() >= set(self.exchanged):
            first, second = self.exchanged
            shown[first], shown[second] = shown[second], shown[first]
        for name in shown:
            shown[name] += self.offset_K.get(name, 0.0)
            if name in self.stuck:
                shown[name] = last_degC[name]
        return shown


class MachineCommand(BaseModel):
    """One line on standard input: `{"fault": {"open": "t3_degC"}}`; `{"fault": {}}` clears everything.

    `{"probe_m": 0.9}` has the machine probe how far its screw has grown there.

    A line that does not match it is refused on standard error, and the machine goes on.

    Attributes:
        fault: The faults that replace all active ones; None clears them too.
        probe_m: The place of a probing cycle, in m from the left end; the faults are then unchanged.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    fault: Faults | None = None
    probe_m: Annotated[float, Field(ge=0.0, le=1.0)] | None = None


class Mishaps:
    """Hands lines on to `write`, or holds them up, drops, doubles or swaps them, according to the faults.

    Needs a running event loop, which delivers held-up lines.

    Args:
        write: Puts bytes on the wire.
        seed: Of the random numbers, so that a run can be repeated.
    """

    def __init__(self, write: Callable[[bytes], None], seed: int) -> None:
        self._write = write
        self._random = random.Random(seed)
        self._faults = Faults()
        self._held: list[bytes] | None = None
        self._behind = b""

    def set(self, faults: Faults) -> None:
        """Replace the active faults; a hold-up without `hold_can_every_s` happens once, now."""
        self._faults = faults
        if faults.hold_can_s and faults.hold_can_every_s is None:
            self._hold_up(faults.hold_can_s)

    def send(self, line: bytes, period_s: float) -> None:
        """Send one of the lines that come each `period_s` (in s), or let one of the active faults happen to
        it.
        """
        faults = self._faults
        every_s = faults.hold_can_every_s
        if faults.hold_can_s and every_s and self._random.random() < period_s / every_s:
            self._hold_up(faults.hold_can_s)
        if self._random.random() < faults.drop_can:
            return
        if self._random.random() < faults.double_can:
            line += line
        if not self._behind and self._random.random() < faults.swap_can:
            self._behind = line  # until the next has overtaken it
            return
        line, self._behind = line + self._behind, b""
        if self._held is None:
            self._write(line)
        else:
            self._held.append(line)

    def _hold_up(self, for_s: float) -> None:
        """Keep all lines for some time, then deliver them at once."""
        if self._held is None:
            self._held = []
            asyncio.get_running_loop().call_later(for_s, self._release)

    def _release(self) -> None:
        held_lines, self._held = self._held or [], None
        self._write(b"".join(held_lines))
