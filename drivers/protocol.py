"""The interface of every driver: a table of the configuration, and a source of readings, whatever its bus.

A driver is a table `[drivers.<name>]` whose `kind` selects it. Every kind names the channels it delivers. A
channel either takes an input of a ready device map (`device = "wago_750_458"`, `channels = { t1_degC = 0 }`)
or spells its source out (`channels.t1_degC = { register = 0, scale = 0.1 }`). All of it is checked without
importing any bus library.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from math import nan
from pathlib import Path
from typing import Annotated, NamedTuple, Protocol, TypeVar

from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Discriminator,
    Field,
    Tag,
)

from observer.frames import Reading
from observer.tables.quantities import Count, Finite, Number, checked_channel

Deliver = Callable[[Reading], None]
Clock = Callable[[], float]
Decoded = tuple[dict[str, float], dict[str, str]]  # values and faults by channel


@dataclass(frozen=True, slots=True)
class DriverStatus:
    """The state of a driver at one moment.

    Attributes:
        reconnects: connections after the first
        errors: failed polls or frames
        drops: received samples that could not be handed on
        is_silent: whether the connection is open and nothing comes
        error_frames: of a CAN bus; those with `error_passive` or `bus_off` are counted there too
        bus_error: the present state of a CAN bus, None if it is not disturbed
    """

    connected: bool = False
    reconnects: int = 0
    errors: int = 0
    drops: int = 0
    last_error: str | None = None
    connected_before: bool = False
    is_silent: bool = False
    error_frames: int = 0
    error_passive: int = 0
    bus_off: int = 0
    bus_error: str | None = None

    @property
    def state(self) -> str:
        """`connected`, `silent` or `disconnected`."""
        if self.connected:
            return "connected"
        return "silent" if self.is_silent else "disconnected"

    def opened(self) -> DriverStatus:
        """Return the status after a successful connection or poll."""
        is_reconnect = self.connected_before and not self.connected
        reconnects = self.reconnects + is_reconnect
        return replace(self, connected=True, is_silent=False, reconnects=reconnects, connected_before=True)

    def silenced(self, reason: str) -> DriverStatus:
        """Return the status of a driver with an open connection on which nothing has come for long."""
        return replace(self, connected=False, is_silent=True, last_error=reason)

    def with_bus_error(self, error: str | None) -> DriverStatus:
        """Return the status after an error frame of a CAN bus; None if the frame reports that the controller
        is back.
        """
        return replace(
            self,
            error_frames=self.error_frames + 1,
            error_passive=self.error_passive + (error == "error-passive"),
            bus_off=self.bus_off + (error == "bus-off"),
            bus_error=error,
        )

    def failed(self, error: str, *, connected: bool = False) -> DriverStatus:
        """Return the status after a failed poll or frame; `connected` is whether the connection can still be
        used.
        """
        return replace(self, connected=connected, is_silent=False, errors=self.errors + 1, last_error=error)


class Driver(Protocol):
    """A source of readings.

    `run` delivers readings stamped with `now()` until it is cancelled, and reconnects for ever. It delivers
    every channel each `period_s`; a value that cannot be read is NaN with a fault. It calls `deliver` on the
    event loop's own thread.
    """

    name: str
    channels: tuple[str, ...]
    period_s: float
    status: DriverStatus

    async def run(self, deliver: Deliver, now: Clock) -> None:
        """Deliver readings until cancelled."""


def faulty(channels: Iterable[str], fault: str, time_s: float) -> Reading:
    """Return a reading in which each of these channels is NaN with the fault."""
    faults = dict.fromkeys(channels, fault)
    return Reading(time_s, dict.fromkeys(faults, nan), faults)


def _any_base(code: object) -> object:
    """Convert a code such as `"0x7FFF"` to an integer; keys of TOML tables are strings. Others stay as
    given.
    """
    try:
        return int(code, 0) if isinstance(code, str) and len(code) <= 20 else code
    except ValueError:
        return code


def not_zero(scale: float) -> float:
    """Return a factor unchanged. Raises `ValueError` for 0."""
    if scale == 0:
        raise ValueError("0 makes every value the same; give the unit's factor, or the device's resolution")
    return scale


def register_of_manual(number: int) -> tuple[str, int] | None:
    """Return function and transmitted register of a manual's number, such as 40001; None for any other
    number.
    """
    for digits in (10_000, 100_000):
        kind, register = divmod(number - 1, digits)
        if kind in (3, 4) and 0 <= register < min(digits, 0x10000):
            return ("holding" if kind == 4 else "input"), register
    return None


def modicon(number: int) -> str:
    """Return what to write for a register's number from a manual; empty for any other number."""
    register = register_of_manual(number)
    if register is None:
        return ""
    return (
        "looks like a number of a manual, which counts from 1 and puts the kind of register first: "
        f'write register = {register[1]} and function = "{register[0]}"'
    )


def _on_the_wire(number: object) -> object:
    """Raise `ValueError` for a register beyond 65535 that is a manual's number; return any other
    unchanged.
    """
    if type(number) is int and number > 0xFFFF and (words := modicon(number)):
        raise ValueError(f"{number} {words}")
    return number


ChannelName = Annotated[
    str,
    Field(min_length=1, max_length=128, pattern=r"^[A-Za-z0-9_.-]+$"),
    AfterValidator(checked_channel),
]
Input = Annotated[Count, Field(ge=0, le=63)]
Scale = Annotated[Finite, Field(ge=-1e9, le=1e9), AfterValidator(not_zero)]
PollPeriod = Annotated[Number, Field(ge=0.005, le=3600)]
Timeout = Annotated[Number, Field(ge=0.01, le=60)]
Register = Annotated[Count, BeforeValidator(_on_the_wire), Field(ge=0, le=0xFFFF)]
Word = Annotated[Count, BeforeValidator(_any_base), Field(ge=0, le=0xFFFF_FFFF_FFFF_FFFF)]
Text = Annotated[str, Field(min_length=1, max_length=256, pattern=r"^[^\x00-\x1f\x7f]+$")]
FaultName = Annotated[str, Field(pattern=r"^[a-z][a-z0-9_]*$", max_length=64)]

Place = TypeVar("Place")


def _union_tag(value: object) -> str:
    """Return the tag of an input number or of a place that is written out."""
    return UNION_TAGS[0] if isinstance(value, int) else UNION_TAGS[1]


# An input of a ready map or a place written out, distinguished before either is checked, so that an error is
# about the one that was meant. The tags appear in the location of such an error.
UNION_TAGS = ("input", "place")
InputOr = Annotated[
    Annotated[Input, Tag(UNION_TAGS[0])] | Annotated[Place, Tag(UNION_TAGS[1])], Discriminator(_union_tag)
]


class Settings(BaseModel):
    """A table under `[drivers.…]`: frozen, and unknown keys are rejected."""

    model_config = ConfigDict(frozen=True, extra="forbid")


class SharedWire(NamedTuple):
    """A connection that several drivers may use at once, with the settings on which they have to agree."""

    place: tuple[object, ...]
    settings: str
    name: str


class DriverTable(Settings):
    """A table `[drivers.<name>]`: its keys, and how its driver is opened."""

    @property
    def delivered(self) -> tuple[str, ...] | None:
        """The channels of the key `channels`; None if only opening the driver shows them."""
        channels = getattr(self, "channels", None)
        return None if channels is None else tuple(channels)

    @property
    def sample_s(self) -> float | None:
        """The interval, in s, at which each channel comes: the key `period_s`; None if unknown."""
        return getattr(self, "period_s", None)

    @abstractmethod
    def open(self, name: str) -> Driver:
        """Make the driver; its bus library is imported here, and nothing is connected before `run`.

        Raises `UserError` where a file that the table names cannot be used.
        """

    def file_problems(self, _name: str) -> list[str]:
        """Return the problems of the files that the table names, as “key: a sentence”."""
        return []

    def wire(self) -> SharedWire | None:
        """Return the connection if several drivers may name the same one; None if each has its own."""
        return None

    def occupied(self) -> dict[str, frozenset[tuple[object, ...]]]:
        """Return the addresses that each channel reads, the register last, if two channels could share
        some.
        """
        return {}

    def steps(self) -> dict[str, float]:
        """Return the step between two neighbouring values of each channel that is transmitted as an
        integer.
        """
        return {}

    def decodes(self, _recording: Path, _name: str) -> Iterable[Reading] | None:
        """Return the readings in a recording of the bus; None if this kind of driver has no recordings.

        The iterable may have `doubts`: sentences about parts of the recording that are lost or uncertain.
        """
        return None
