"""A Modbus device, TCP or RTU: its table in the configuration, and how it opens its driver."""

from __future__ import annotations

from abc import abstractmethod
from typing import Annotated, Any, Literal

from pydantic import Field, model_validator

from drivers.decode import spans
from drivers.places import MODBUS_INPUTS, ModbusChannel, check_channels, modbus_input
from drivers.polled import PolledTable
from drivers.protocol import ChannelName, InputOr, PollPeriod, Text, Timeout
from observer.tables.quantities import Count, Number


class ModbusTable(PolledTable):
    """The settings shared by TCP and RTU."""

    session = "drivers.modbus_session"

    device: Literal["icpdas_m7018", "wago_750_458", "micro800_tc2"] | None = None
    first_register: Annotated[Count, Field(ge=0, le=0xFFF0)] = 0
    unit_id: Annotated[Count, Field(ge=0, le=255)] = 1
    period_s: PollPeriod = 0.5
    timeout_s: Timeout = 1.0
    channels: dict[ChannelName, InputOr[ModbusChannel]] = Field(min_length=1)

    @model_validator(mode="after")
    def _inputs_belong_to_a_device(self) -> ModbusTable:
        check_channels(self.channels, self.device, MODBUS_INPUTS)
        if self.device is None and self.first_register:
            raise ValueError(
                "first_register shifts a ready device map; without device, write the registers out"
            )
        return self

    @property
    @abstractmethod
    def address(self) -> str:
        """The host, or the serial port."""

    @property
    @abstractmethod
    def line(self) -> dict[str, Any]:
        """pymodbus's own options of the connection."""

    @property
    def silence_s(self) -> float | None:
        """On a serial line, the silence kept after a reply that never came."""
        return None

    def map(self) -> dict[str, ModbusChannel]:
        """The register of every channel, with inputs of a ready device map resolved."""
        return {
            name: modbus_input(self.device or "", place, self.first_register)
            if isinstance(place, int)
            else place
            for name, place in self.channels.items()
        }

    def occupied(self) -> dict[str, frozenset[tuple[object, ...]]]:
        """The addresses that each channel reads, the register last."""
        found: dict[str, frozenset[tuple[object, ...]]] = {}
        device = self.address, self.line.get("port"), self.unit_id
        for channel, place in self.map().items():
            own = spans(place)[0]
            words = range(own.first, own.first + own.count)
            found[channel] = frozenset((*device, own.function, word) for word in words)
        return found

    def steps(self) -> dict[str, float]:
        """The step between two neighbouring values of each channel that comes as a whole number."""
        return {c: abs(place.scale) for c, place in self.map().items() if place.type != "float32"}


class ModbusTcpSettings(ModbusTable):
    """A Modbus TCP device."""

    kind: Literal["modbus_tcp"]
    host: Text
    port: Annotated[Count, Field(ge=1, le=65535)] = 502

    @property
    def address(self) -> str:
        """The host."""
        return self.host

    @property
    def line(self) -> dict[str, Any]:
        """The port."""
        return {"port": self.port}


class ModbusRtuSettings(ModbusTable):
    """A Modbus RTU device on a serial line; `quiet_s` is the silence kept after a reply that never came."""

    kind: Literal["modbus_rtu"]
    port: Text
    baudrate: Annotated[Count, Field(ge=300, le=4_000_000)] = 19200
    parity: Literal["N", "E", "O"] = "N"
    stopbits: Literal[1, 2] = 1
    quiet_s: Annotated[Number, Field(ge=0.05, le=60)] = 0.5

    @property
    def address(self) -> str:
        """The serial port."""
        return self.port

    @property
    def line(self) -> dict[str, Any]:
        """Speed and frame."""
        return {"baudrate": self.baudrate, "parity": self.parity, "stopbits": self.stopbits}

    @property
    def silence_s(self) -> float:
        """The silence kept after a reply that never came."""
        return self.quiet_s
