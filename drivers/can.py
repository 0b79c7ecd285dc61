"""Cyclic CAN messages: their table in the configuration, and the way to their driver."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field, model_validator

from drivers.devices import CAN_INPUTS, DBC_OF, can_input, dbc_file
from drivers.places import Bus, CanChannel, Signals
from drivers.protocol import Driver
from drivers.settings import (
    ChannelName,
    DriverTable,
    InputOr,
    PollPeriod,
    Text,
    Timeout,
    check_each_its_own,
    check_inputs,
)
from observer.frames import Reading
from observer.tables.quantities import Count, File


class CanTable(DriverTable):
    """How python-can reaches the bus; `options` go to the interface as they are."""

    interface: Text
    channel: Text
    bitrate: Annotated[Count, Field(ge=10_000, le=1_000_000)] | None = None
    options: dict[str, bool | int | float | str] = Field(default_factory=dict)
    period_s: PollPeriod = 0.1
    timeout_s: Timeout | None = None

    @property
    def listens(self) -> bool:
        """Whether nothing is ever sent."""
        return True

    @property
    def bus(self) -> Bus:
        """How the bus is opened; without a time-out, two silent periods are none yet, each further one is."""
        silence_s = self.timeout_s if self.timeout_s is not None else 2.0 * self.period_s
        return Bus(
            interface=self.interface,
            channel=self.channel,
            options=({} if self.bitrate is None else {"bitrate": self.bitrate}) | self.options,
            listens=self.listens,
            period_s=self.period_s,
            silence_s=silence_s,
        )

    @property
    def sample_s(self) -> float:
        """How often each channel comes."""
        return self.period_s


class CanSettings(CanTable):
    """Signals of cyclic CAN messages, decoded by a DBC file or a ready device map."""

    kind: Literal["can"]
    dbc: File | None = None
    device: Literal["css_canmod_temp", "peak_mu_thermocouple1"] | None = None
    channels: dict[ChannelName, InputOr[CanChannel]] = Field(min_length=1)

    @model_validator(mode="after")
    def _one_description(self) -> CanSettings:
        if (self.dbc is None) == (self.device is None):
            raise ValueError("give exactly one of dbc and device")
        check_inputs(self.device, CAN_INPUTS, self.channels)
        check_each_its_own(self.channels)
        return self

    @property
    def delivered(self) -> tuple[str, ...]:
        """The channels it delivers."""
        return tuple(self.channels)

    def signals(self, name: str) -> Signals:
        """The signals that it takes, inputs of a ready device map resolved."""
        dbc = DBC_OF[self.device] if self.device else dbc_file(self.dbc or Path())
        channels = {
            channel: can_input(self.device or "", place) if isinstance(place, int) else place
            for channel, place in self.channels.items()
        }
        return Signals(name, dbc, channels)

    def open(self, name: str) -> Driver:
        """Make the driver of the signals that the DBC file describes."""
        from drivers.can_bus import BusDriver  # noqa: PLC0415  (the bus library only when it is used)
        from drivers.dbc import load_decoder  # noqa: PLC0415

        return BusDriver(name, self.bus, self.delivered, load_decoder(self.signals(name)))

    def file_problems(self, name: str) -> list[str]:
        """What is wrong with the DBC file."""
        from drivers.dbc import dbc_problems  # noqa: PLC0415

        return [f"dbc: {problem}" for problem in dbc_problems(self.signals(name))]

    def decodes(self, recording: Path, name: str) -> Iterator[Reading]:
        """The readings in a recording of the bus, through the decoding of the live one."""
        from drivers.can_bus import readings_of  # noqa: PLC0415
        from drivers.dbc import load_decoder  # noqa: PLC0415

        return readings_of(recording, load_decoder(self.signals(name)))
