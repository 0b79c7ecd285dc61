"""A Modbus device, TCP or RTU: its table in the configuration, and how it opens its driver."""

from __future__ import annotations

import os
from abc import abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, Field, model_validator

from drivers.decode import MAX_REGISTERS, spans
from drivers.places import MODBUS_INPUTS, ModbusChannel, check_channels, modbus_input
from drivers.polled import PolledTable
from drivers.protocol import ChannelName, InputOr, PollPeriod, SharedWire, Text, Timeout
from observer.config.quantities import Count, Number, checked_host


@dataclass(frozen=True, slots=True)
class ModbusAddress:
    """Where a connection leads: a TCP host and port, or a serial port with its speed and frame.

    Attributes:
        transport: How frames travel; `rtu-over-tcp` is RTU frames over a TCP connection.
        host: The TCP host, or the serial port's path or name.
        port: The TCP port; 0 for a serial port.
        line: The serial port's `baudrate`, `parity` and `stopbits`; empty for TCP.
    """

    transport: Literal["tcp", "rtu-over-tcp", "serial"]
    host: str  # or the serial port
    port: int = 0
    line: Mapping[str, Any] = field(default_factory=dict)

    @property
    def place(self) -> tuple[object, ...]:
        """The key of the physical connection: the real path of the serial port, or host and port.

        Two names of one serial port, such as a link in `/dev/serial/by-id`, have the same key. Host names are
        compared as text, without a look-up.
        """
        if self.transport == "serial":
            return "serial", os.path.realpath(self.host) if os.path.exists(self.host) else self.host
        return "tcp", self.host.lower(), self.port


class ModbusTable(PolledTable):
    """The settings shared by TCP and RTU."""

    session = "drivers.modbus_session"

    device: Literal["icpdas_m7018", "wago_750_458", "micro800_tc2"] | None = None
    first_register: Annotated[Count, Field(ge=0, le=0xFFF0)] = 0
    unit_id: Annotated[Count, Field(ge=0, le=255)] = 1
    period_s: PollPeriod = 0.5
    timeout_s: Timeout = 1.0
    quiet_s: Annotated[Number, Field(ge=0.05, le=60)] = 0.5  #: RTU: shortest silence after a missing reply
    #: most registers in one request
    max_registers: Annotated[Count, Field(ge=1, le=MAX_REGISTERS)] = MAX_REGISTERS
    channels: dict[ChannelName, InputOr[ModbusChannel]] = Field(min_length=1)

    @model_validator(mode="after")
    def _inputs_belong_to_a_device(self) -> ModbusTable:
        check_channels(self.channels, self.device, MODBUS_INPUTS)
        if self.device is None and self.first_register:
            raise ValueError(
                "first_register shifts a ready device map; without device, write the registers out"
            )
        longest = max(spans(place)[0].count for place in self.map().values())
        if longest > self.max_registers:
            raise ValueError(
                f"max_registers = {self.max_registers} is less than the {longest} registers of one value; "
                f"make it at least {longest}"
            )
        return self

    @property
    @abstractmethod
    def address(self) -> ModbusAddress:
        """Where the connection leads.

        Drivers with the same `place` share one connection and take turns.
        """

    def wire(self) -> SharedWire:
        """Return the connection, which several drivers may share if they agree on its settings.

        On a serial port they have to agree on speed and frame, and on TCP on the kind of frames.
        """
        address = self.address
        if address.transport == "serial":
            settings = ", ".join(f"{key} = {value!r}" for key, value in address.line.items())
            return SharedWire(address.place, settings, address.host)
        return SharedWire(
            address.place, f'transport = "{address.transport}"', f"{address.host}:{address.port}"
        )

    def map(self) -> dict[str, ModbusChannel]:
        """Return the register of every channel.

        An input number of a ready device map becomes its register, shifted by `first_register`.
        """
        return {
            name: modbus_input(self.device or "", place, self.first_register)
            if isinstance(place, int)
            else place
            for name, place in self.channels.items()
        }

    def occupied(self) -> dict[str, frozenset[tuple[object, ...]]]:
        """Return the addresses that each channel reads: connection, unit, function and register.

        Status registers are not included, because several channels may share one.
        """
        addresses: dict[str, frozenset[tuple[object, ...]]] = {}
        device = *self.address.place, self.unit_id
        for channel, place in self.map().items():
            block = spans(place)[0]
            words = range(block.first, block.first + block.count)
            addresses[channel] = frozenset((*device, block.function, word) for word in words)
        return addresses

    def steps(self) -> dict[str, float]:
        """Return the step between two neighbouring values of each channel that is transmitted as an integer.

        The step is |scale|, in the unit of the channel's name. Floating-point channels are missing.
        """
        return {c: abs(place.scale) for c, place in self.map().items() if not place.is_float}


class ModbusTcpSettings(ModbusTable):
    """A Modbus device behind TCP: Modbus TCP, or RTU frames as a serial server passes them on."""

    kind: Literal["modbus_tcp"]
    #: `"tcp"`, or `"rtu-over-tcp"` for a serial server that passes RTU frames on as they are
    transport: Literal["tcp", "rtu-over-tcp"] = "tcp"
    host: Annotated[Text, AfterValidator(checked_host)]
    port: Annotated[Count, Field(ge=1, le=65535)] = 502

    @property
    def address(self) -> ModbusAddress:
        """The host and its port."""
        return ModbusAddress(self.transport, self.host, self.port)


class ModbusRtuSettings(ModbusTable):
    """A Modbus RTU device on a serial line."""

    kind: Literal["modbus_rtu"]
    #: `"serial"`; with `"rtu-over-tcp"` the keys are those of `modbus_tcp`
    transport: Literal["serial"] = "serial"
    port: Text
    baudrate: Annotated[Count, Field(ge=300, le=4_000_000)] = 19200
    parity: Literal["N", "E", "O"] = "N"
    stopbits: Literal[1, 2] = 1

    @property
    def address(self) -> ModbusAddress:
        """The serial port, its speed and frame."""
        line = {"baudrate": self.baudrate, "parity": self.parity, "stopbits": self.stopbits}
        return ModbusAddress("serial", self.port, line=line)
