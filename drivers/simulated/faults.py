"""Faults that can be switched on in the simulated machine."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field


def _one_or_many(names: object) -> object:
    return (names,) if isinstance(names, str) else names


Value = Annotated[float, Field(allow_inf_nan=False)]
Share = Annotated[float, Field(ge=0.0, le=1.0)]
Names = Annotated[tuple[str, ...], BeforeValidator(_one_or_many)]


class Faults(BaseModel):
    """The faults in force: thermocouples by name, the rest of the wires as a whole.

    A faulty value looks like any other: thermocouples read `offset_K` too much, two have `exchanged` their
    plugs, and the axis has been homed `homed_off_m` from where it was.
    CAN frames are held up for `hold_can_s` and then delivered at once: now, or at random, on average every
    `hold_can_every_s`. `drop_can`, `double_can` and `swap_can` are shares of frames to which that happens.
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
        """What the thermocouples show: exchanged plugs, then offsets; a stuck one shows its last value."""
        shown = dict(true_degC)
        if self.exchanged is not None and shown.keys() >= set(self.exchanged):
            one, other = self.exchanged
            shown[one], shown[other] = shown[other], shown[one]
        for name in shown:
            shown[name] += self.offset_K.get(name, 0.0)
            if name in self.stuck:
                shown[name] = last_degC[name]
        return shown


class Command(BaseModel):
    """One line on standard input: `{"fault": {"open": "t3_degC"}}`; `{"fault": {}}` clears everything."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    fault: Faults
