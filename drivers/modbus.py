"""A Modbus device, TCP or RTU: its table in the configuration, and the way to its driver."""

from __future__ import annotations

from abc import abstractmethod
from typing import Annotated, Literal

from pydantic import Field, model_validator

from drivers.decode import spans
from drivers.places import MODBUS_INPUTS, Device, ModbusChannel, check_channels, modbus_input
from drivers.protocol import ChannelName, Driver, DriverTable, InputOr, PollPeriod, Text, Timeout
from observer.tables.quantities import Count, Number


class _Modbus(DriverTable):
    """What TCP and RTU share."""

    device: Literal["icpdas_m7018", "wago_750_458", "micro800_tc2"] | None = None
    first_register: Annotated[Count, Field(ge=0, le=0xFFF0)] = 0
    unit_id: Annotated[Count, Field(ge=0, le=255)] = 1
    period_s: PollPeriod = 0.5
    timeout_s: Timeout = 1.0
    channels: dict[ChannelName, InputOr[ModbusChannel]] = Field(min_length=1)

    @model_validator(mode="after")
    def _inputs_belong_to_a_device(self) -> _Modbus:
        check_channels(self.channels, self.device, MODBUS_INPUTS)
        if self.device is None and self.first_register:
            raise ValueError(
                "first_register shifts a ready device map; without device, write the registers out"
            )
        return self

    @property
    @abstractmethod
    def at(self) -> Device:
        """Where the device is."""

    def open(self, name: str) -> Driver:
        """Make the driver that polls the device."""
        from drivers.modbus_session import connect  # noqa: PLC0415  (the bus library only when it is used)
        from drivers.polled import Polled  # noqa: PLC0415

        device, places = self.at, self.map()
        return Polled(name, tuple(places), self.period_s, lambda now: connect(device, places, now))

    def map(self) -> dict[str, ModbusChannel]:
        """Every channel's place, inputs of a ready device map resolved."""
        return {
            name: modbus_input(self.device or "", place, self.first_register)
            if isinstance(place, int)
            else place
            for name, place in self.channels.items()
        }

    def occupied(self) -> dict[str, frozenset[tuple[object, ...]]]:
        """The addresses that each channel reads, the register last."""
        found: dict[str, frozenset[tuple[object, ...]]] = {}
        device = self.at.serial, self.at.address, self.at.options.get("port"), self.unit_id
        for channel, place in self.map().items():
            own = spans(place)[0]
            words = range(own.first, own.first + own.count)
            found[channel] = frozenset((*device, own.function, word) for word in words)
        return found

    def steps(self) -> dict[str, float]:
        """The step between two neighbouring values of each channel that comes as a whole number."""
        return {c: abs(place.scale) for c, place in self.map().items() if place.type != "float32"}


class ModbusTcpSettings(_Modbus):
    """A Modbus TCP device."""

    kind: Literal["modbus_tcp"]
    host: Text
    port: Annotated[Count, Field(ge=1, le=65535)] = 502

    @property
    def at(self) -> Device:
        """Where the device is."""
        return Device(self.host, {"port": self.port}, self.unit_id, self.timeout_s)


class ModbusRtuSettings(_Modbus):
    """A Modbus RTU device on a serial line; `quiet_s` is the silence kept after a reply that never came."""

    kind: Literal["modbus_rtu"]
    port: Text
    baudrate: Annotated[Count, Field(ge=300, le=4_000_000)] = 19200
    parity: Literal["N", "E", "O"] = "N"
    stopbits: Literal[1, 2] = 1
    quiet_s: Annotated[Number, Field(ge=0.05, le=60)] = 0.5

    @property
    def at(self) -> Device:
        """Where the device is."""
        line = {"baudrate": self.baudrate, "parity": self.parity, "stopbits": self.stopbits}
        return Device(self.port, line, self.unit_id, self.timeout_s, self.quiet_s)
