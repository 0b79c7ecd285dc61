"""Cyclic CAN messages: their table in the configuration, and how it opens their driver."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Literal

from pydantic import Field, model_validator

from drivers.places import (
    CAN_INPUTS,
    DBC_OF,
    CanChannel,
    CanTable,
    Signals,
    can_input,
    check_channels,
    dbc_file,
)
from drivers.protocol import ChannelName, Driver, InputOr
from observer.config.quantities import File, exactly_one
from observer.frames import Reading


class CanSettings(CanTable):
    """Signals of cyclic CAN messages, decoded by a DBC file or a ready device map."""

    kind: Literal["can"]
    dbc: File | None = None
    device: Literal["css_canmod_temp", "peak_mu_thermocouple1"] | None = None
    channels: dict[ChannelName, InputOr[CanChannel]] = Field(min_length=1)

    _one = exactly_one("dbc", "device")

    @model_validator(mode="after")
    def _channels_are_there(self) -> CanSettings:
        check_channels(self.channels, self.device, CAN_INPUTS)
        return self

    def signals(self, name: str) -> Signals:
        """Return the channels with the signal of each.

        An input number of a ready device map becomes the signal of its DBC file, which comes with the
        drivers.

        Args:
            name: The driver's name, for messages about the file.
        """
        dbc = DBC_OF[self.device] if self.device else dbc_file(self.dbc or Path())
        channels = {
            channel: can_input(self.device or "", place) if isinstance(place, int) else place
            for channel, place in self.channels.items()
        }
        return Signals(name, dbc, channels)

    def open(self, name: str) -> Driver:
        """Make the driver that decodes frames by the DBC file. The bus is not opened before `run`.

        Raises:
            UserError: If the DBC file cannot be read, or lacks a message or signal; it names the file and
                channel.
        """
        from drivers.can_bus import BusDriver  # noqa: PLC0415  (the bus library is imported only when it is used)
        from drivers.dbc import load_decoder  # noqa: PLC0415

        return BusDriver(name, self, load_decoder(self.signals(name)))

    def file_problems(self, name: str) -> list[str]:
        """Return the problems of the DBC file, each as “dbc: a sentence”.

        The list is empty if every channel finds its message and signal in the file.
        """
        from drivers.dbc import dbc_problems  # noqa: PLC0415

        return [f"dbc: {problem}" for problem in dbc_problems(self.signals(name))]

    def decodes(self, recording: Path, name: str) -> Iterable[Reading]:
        """Return the readings in a recording of the bus, decoded as on the live bus.

        Args:
            recording: A file of one of python-can's formats, also with `.gz`.
            name: The driver's name, for messages about the DBC file.

        Returns:
            An iterable of readings with the recording's own times in s. Iterating it raises `LogError` if the
            file is not a recording.

        Raises:
            UserError: If the DBC file cannot be read, or lacks a message or signal.
        """
        from drivers.dbc import load_decoder  # noqa: PLC0415
        from drivers.recording import CanRecording  # noqa: PLC0415

        return CanRecording(recording, load_decoder(self.signals(name)))
