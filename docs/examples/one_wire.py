"""One-wire thermometers, as Linux shows them: a file each, with the temperature in thousandths of °C."""

from __future__ import annotations

import asyncio
from math import nan
from pathlib import Path

from pydantic import Field

from drivers.protocol import ChannelName, Clock, Deliver, Driver, DriverStatus, DriverTable, PollPeriod, Text
from observer.config.quantities import File
from observer.frames import Reading


class OneWireSettings(DriverTable):
    """Thermometers by the number printed on them."""

    kind: str
    directory: File = Path("/sys/bus/w1/devices")
    period_s: PollPeriod = 2.0
    channels: dict[ChannelName, Text] = Field(min_length=1)

    def open(self, name: str) -> Driver:
        """Make the driver."""
        return OneWire(name, self)


class OneWire:
    """Reads every thermometer each period; what cannot be read is delivered with its fault."""

    def __init__(self, name: str, settings: OneWireSettings) -> None:
        self.name = name
        self.channels = tuple(settings.channels)
        self.period_s = settings.period_s
        self.status = DriverStatus()
        self._files = {
            channel: settings.directory / number / "temperature"
            for channel, number in settings.channels.items()
        }

    async def run(self, deliver: Deliver, now: Clock) -> None:
        """Deliver a reading each period until cancelled."""
        while True:
            deliver(await asyncio.to_thread(self._read, now))
            await asyncio.sleep(self.period_s)

    def _read(self, now: Clock) -> Reading:
        values, faults = dict.fromkeys(self.channels, nan), {}
        for channel, file in self._files.items():
            try:
                values[channel] = int(file.read_text()) * 1e-3
            except (OSError, ValueError) as error:
                faults[channel] = "unreadable"
                self.status = self.status.failed(str(error), connected=len(faults) < len(values))
        if len(faults) < len(values):
            self.status = self.status.opened()
        return Reading(now(), values, faults)
