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

from observer.config.quantities import Count, Finite, Number, checked_channel
from observer.frames import Reading

Deliver = Callable[[Reading], None]
Clock = Callable[[], float]
Decoded = tuple[dict[str, float], dict[str, str]]  # values and faults by channel


@dataclass(frozen=True, slots=True)
class DriverStatus:
    """The state of a driver at one moment; each change makes a new object.

    The driver replaces it on the event loop's thread, so a reader there sees no half-changed state.

    Attributes:
        connected: Whether the last poll was answered, or the bus is open and not silent.
        reconnects: Connections after the first.
        errors: Failed polls or frames since the start.
        drops: Received samples that could not be handed on because the event loop was too busy.
        last_error: The newest error as a sentence with its remedy; None before the first. It stays after
            recovery.
        connected_before: Whether there was ever a connection; so the next one is a reconnection.
        is_silent: Whether the connection is open and nothing comes.
        error_frames: Error frames of a CAN bus; those in `error_passive` and `bus_off` are included.
        error_passive: Error frames after which the controller sends passive error flags only.
        bus_off: Error frames after which the controller takes no part in the bus.
        bus_error: The present state of a CAN bus; None if it is not disturbed.
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
        """`connected`, `silent` or `disconnected`.

        A connection without data is `silent`, never `connected`. The health message publishes this word.
        """
        if self.connected:
            return "connected"
        return "silent" if self.is_silent else "disconnected"

    def opened(self) -> DriverStatus:
        """Return the status after a successful connection or poll.

        Returns:
            The status as connected. `reconnects` grows by 1 if an earlier connection was lost. Counts of
            errors and `last_error` are unchanged.
        """
        is_reconnect = self.connected_before and not self.connected
        reconnects = self.reconnects + is_reconnect
        return replace(self, connected=True, is_silent=False, reconnects=reconnects, connected_before=True)

    def silenced(self, reason: str) -> DriverStatus:
        """Return the status of a driver with an open connection on which nothing has come for long.

        Args:
            reason: The sentence for `last_error`.

        Returns:
            The status as silent. `errors` does not grow, because nothing has failed.
        """
        return replace(self, connected=False, is_silent=True, last_error=reason)

    def with_bus_error(self, error: str | None) -> DriverStatus:
        """Return the status after an error frame of a CAN bus.

        Args:
            error: The state that the frame reports, such as `error-passive`; None if the controller takes
                part again.

        Returns:
            The status with the frame counted. The state of the connection is unchanged.
        """
        return replace(
            self,
            error_frames=self.error_frames + 1,
            error_passive=self.error_passive + (error == "error-passive"),
            bus_off=self.bus_off + (error == "bus-off"),
            bus_error=error,
        )

    def failed(self, error: str, *, connected: bool = False) -> DriverStatus:
        """Return the status after a failed poll or frame.

        Args:
            error: The sentence for `last_error`; it names the device or file and the remedy.
            connected: Whether the connection can still be used.

        Returns:
            The status with one more error, connected or disconnected.
        """
        return replace(self, connected=connected, is_silent=False, errors=self.errors + 1, last_error=error)


class Driver(Protocol):
    """A source of readings.

    `run` delivers readings stamped with `now()` until it is cancelled, and reconnects for ever. It delivers
    every channel each `period_s`; a value that cannot be read is NaN with a fault. It calls `deliver` on the
    event loop's own thread.

    Attributes:
        name: The name in `[drivers.<name>]`, for messages.
        channels: The channels that its readings may hold.
        period_s: The interval, in s, within which each channel comes, as a value or as a fault.
        status: The present state; read it at any time on the event loop's thread.
    """

    name: str
    channels: tuple[str, ...]
    period_s: float
    status: DriverStatus

    async def run(self, deliver: Deliver, now: Clock) -> None:
        """Deliver readings until cancelled.

        It never returns. A lost connection is opened again, and its channels are faulty until then. After
        cancellation it closes the connection within a fraction of a second.

        Args:
            deliver: Called with each reading. It must not block, because it runs on the event loop's thread.
            now: The service's clock in s; it never runs back. Times of readings are on this clock.

        Raises:
            RuntimeError: If a thread of the driver ended by a defect; the service then starts the driver
                again.
        """


def faulty(channels: Iterable[str], fault: str, time_s: float) -> Reading:
    """Return a reading in which each of these channels is NaN with the fault.

    Args:
        channels: The names of the channels.
        fault: One fault for all, such as `timeout`; lower case with underscores.
        time_s: The time of the reading in s of the service's clock.
    """
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
    """Return a factor unchanged.

    Raises:
        ValueError: If the factor is 0, which would make every value the same.
    """
    if scale == 0:
        raise ValueError("0 makes every value the same; give the unit's factor, or the device's resolution")
    return scale


def register_of_manual(number: int) -> tuple[str, int] | None:
    """Return function and transmitted register of a manual's number, such as 40001.

    Manuals count registers from 1. They put the kind first, 3 for input and 4 for holding registers, and have
    five or six digits.

    Returns:
        The function, `"input"` or `"holding"`, and the register from 0 on; None for any other number.
    """
    for digits in (10_000, 100_000):
        kind, register = divmod(number - 1, digits)
        if kind in (3, 4) and 0 <= register < min(digits, 0x10000):
            return ("holding" if kind == 4 else "input"), register
    return None


def modicon(number: int) -> str:
    """Return what to write for a register's number from a manual.

    Returns:
        The end of a sentence that begins with the number, with register and function; empty for any other
        number.
    """
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
    """A connection that several drivers may use at once, with the settings on which they have to agree.

    Attributes:
        place: The key of the connection. Two drivers with equal places use one connection.
        settings: The settings of the line as text. Drivers with one place and other settings are rejected.
        name: The connection in words, such as the serial port, for messages.
    """

    place: tuple[object, ...]
    settings: str
    name: str


class DriverTable(Settings):
    """A table `[drivers.<name>]`: its keys, and how its driver is opened."""

    @property
    def delivered(self) -> tuple[str, ...] | None:
        """The channels of the key `channels`; None if only opening the driver shows them.

        Checks of the configuration use it, so that it needs neither device nor bus library.
        """
        channels = getattr(self, "channels", None)
        return None if channels is None else tuple(channels)

    @property
    def sample_s(self) -> float | None:
        """The interval, in s, at which each channel comes: the key `period_s`.

        It is None if unknown, as for a recorded log, whose rows give the interval.
        """
        return getattr(self, "period_s", None)

    @abstractmethod
    def open(self, name: str) -> Driver:
        """Make the driver; its bus library is imported here, and nothing is connected before `run`.

        Args:
            name: The name in `[drivers.<name>]`, for messages and the status.

        Returns:
            A driver that has not started.

        Raises:
            UserError: If a file that the table names cannot be used.
            ImportError: If the driver's bus library is not installed.
        """

    def file_problems(self, _name: str) -> list[str]:
        """Return the problems of the files that the table names.

        `observer check` shows them beside those of the tables. Files are read, but no device is opened.

        Returns:
            Sentences of the form “key: problem; remedy”; an empty list if every file can be used.
        """
        return []

    def wire(self) -> SharedWire | None:
        """Return the connection if several drivers may name the same one.

        Returns:
            Its place and settings, which the configuration compares between drivers; None if each driver has
            its own connection.
        """
        return None

    def occupied(self) -> dict[str, frozenset[tuple[object, ...]]]:
        """Return the addresses that each channel reads, if two channels could share some.

        Returns:
            For each channel the addresses, the register last. Channels of several drivers with a common
            address are reported as an error. A driver whose channels cannot overlap returns an empty mapping.
        """
        return {}

    def steps(self) -> dict[str, float]:
        """Return the step between two neighbouring values of each channel that is transmitted as an integer.

        Returns:
            The resolution by channel, in the unit of the channel's name. Channels without a known step are
            missing.
        """
        return {}

    def decodes(self, _recording: Path, _name: str) -> Iterable[Reading] | None:
        """Return the readings in a recording of the bus.

        The iterable may have `doubts`: sentences about parts of the recording that are lost or uncertain.
        They are complete after the last reading.

        Returns:
            Readings in the order of the file, with its own times in s, decoded as on the live bus. None if
            this kind of driver has no recordings.

        Raises:
            UserError: If a file that the table names cannot be used; at once, not while iterating.
        """
        return None
