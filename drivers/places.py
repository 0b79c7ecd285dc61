"""Sources of values: a register, a signal of a CAN message, a node, a data item, or an input of a ready map.

A ready map of a thermocouple module gives the register and the fault codes of each input. It holds for the
factory settings that its docstring names. Any other module is written out in the configuration.
"""

from __future__ import annotations

import os
from abc import abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field, model_validator

from drivers.protocol import (
    DriverTable,
    FaultName,
    PollPeriod,
    Register,
    Scale,
    Settings,
    Text,
    Timeout,
    Word,
)
from observer.config.quantities import Count, Finite, Number
from observer.errors import raise_all

WORDS = {
    "int16": 1, "uint16": 1, "int32": 2, "uint32": 2, "float32": 2, "int64": 4, "uint64": 4, "float64": 4,
}  # fmt: skip
"""How many registers each type takes."""


class Place(Settings):
    """The source of one value: value = scale · number + offset."""

    scale: Scale = 1.0
    offset: Finite = 0.0

    @property
    @abstractmethod
    def identity(self) -> object:
        """A key of the source; two channels of a driver must not have the same one.

        It compares only what is transmitted, so another scale does not make another source.
        """

    def value(self, number: float) -> float:
        """Return the value for a transmitted number: scale · number + offset, in the unit of the channel's
        name.
        """
        return self.scale * number + self.offset


ByteOrder = Literal["ABCD", "CDAB", "BADC", "DCBA"]


class ModbusChannel(Place):
    """One value in the registers of a Modbus device.

    `register` counts from 0, as on the wire. `fault_codes` are the bits of a value that stand for a fault, as
    an unsigned number after `byte_order` is applied. A `status_register` (same `function`) makes the value a
    fault when it has all bits of a key of `status_faults`; the first key that fits names the fault. Values
    outside `low` … `high` are faults too.
    """

    register_: Register = Field(alias="register")
    function: Literal["holding", "input"] = "input"
    #: `"int16"`, `"uint16"`, `"int32"`, `"uint32"`, `"float32"`, `"int64"`, `"uint64"` or `"float64"`
    type: Literal["int16", "uint16", "int32", "uint32", "float32", "int64", "uint64", "float64"] = "int16"
    #: `"ABCD"`; `"CDAB"` where the low word comes first; `"BADC"` where the bytes of each word are swapped;
    #: `"DCBA"` where both are
    byte_order: ByteOrder = "ABCD"
    #: another way to give `byte_order`: `"big"` is `"ABCD"`, `"little"` is `"CDAB"`
    word_order: Literal["big", "little"] | None = None
    low: Finite | None = None
    high: Finite | None = None
    fault_codes: dict[Word, FaultName] = Field(default_factory=dict)
    status_register: Register | None = None
    status_faults: dict[Annotated[Word, Field(ge=1, le=0xFFFF)], FaultName] = Field(default_factory=dict)

    @model_validator(mode="after")
    def _sensible(self) -> ModbusChannel:
        if self.register_ + WORDS[self.type] > 0x10000:
            raise ValueError(
                f"a {self.type} at register {self.register_} ends beyond register 65535; correct register "
                "or type"
            )
        if self.word_order is not None and "byte_order" in self.model_fields_set:
            raise ValueError("word_order and byte_order say the same; give byte_order alone")
        if bool(self.status_faults) != (self.status_register is not None):
            raise ValueError("status_register and status_faults belong together; give both or neither")
        if self.low is not None and self.high is not None and not self.low < self.high:
            raise ValueError(f"low = {self.low} must be smaller than high = {self.high}; correct one of them")
        return self

    @property
    def identity(self) -> tuple[object, ...]:
        """Function, register and type."""
        return self.function, self.register_, self.type

    @property
    def order(self) -> ByteOrder:
        """The order of the bytes of a value, from either key.

        The word order `"little"` is `"CDAB"`, and `"big"` is `"ABCD"`.
        """
        return "CDAB" if self.word_order == "little" else self.byte_order

    @property
    def is_float(self) -> bool:
        """Whether the registers hold a floating-point number."""
        return self.type.startswith("float")


class CanChannel(Place):
    """One signal of a DBC file.

    `fault_signal` (of the same message) makes the value a fault when its raw number is a key of
    `fault_values`, or, without `fault_values`, when it is not 0.
    """

    message: Text
    signal: Text
    fault_signal: Text | None = None
    fault_values: dict[Annotated[int, Field(ge=0, lt=1 << 64)], FaultName] = Field(default_factory=dict)

    @model_validator(mode="after")
    def _sensible(self) -> CanChannel:
        if self.fault_values and self.fault_signal is None:
            raise ValueError("fault_values needs fault_signal; give it, or remove fault_values")
        return self

    @property
    def identity(self) -> tuple[object, ...]:
        """Message and signal."""
        return self.message, self.signal


class OpcUaChannel(Place):
    """One variable of the server."""

    node: Annotated[Text, Field(pattern=r"^(ns=\d{1,5};)?(i=\d{1,10}|[sgb]=.+)$")]

    @property
    def identity(self) -> str:
        """The node."""
        return self.node


class MtConnectChannel(Place):
    """One data item of the agent, in SI units; or 1 where it `equals` a word, else 0."""

    item: Annotated[Text, Field(pattern=r"^\S+$")]
    equals: Text | None = None

    @property
    def identity(self) -> tuple[object, ...]:
        """The item and the word that it is compared with."""
        return self.item, self.equals


def check_channels(
    channels: Mapping[str, int | Place], device: str | None = None, inputs: Mapping[str, int] | None = None
) -> None:
    """Reject input numbers that a ready map does not have, and two channels with the same source.

    Args:
        channels: For each channel the number of an input, or a place that is written out.
        device: The ready map; None if the table names none.
        inputs: The number of inputs of each ready map; None if this kind of driver has no maps.

    Raises:
        ValueError: With all problems of one kind; each names its channels and the remedy.
    """
    problems = []
    for channel, place in channels.items():
        if not isinstance(place, int):
            continue
        if device is None:
            problems.append(
                f"channel {channel}: an input number needs device; name it, or write the place out"
            )
        elif inputs is not None and place >= inputs[device]:
            last = inputs[device] - 1
            problems.append(f"channel {channel}: {device} has inputs 0 to {last}, not {place}")
    raise_all(problems)
    places: dict[object, list[str]] = {}
    for channel, place in channels.items():
        places.setdefault(place if isinstance(place, int) else place.identity, []).append(channel)
    raise_all(
        [
            f"channels {', '.join(same)} all read the same place; give each its own"
            for same in places.values()
            if len(same) > 1
        ]
    )


@dataclass(frozen=True, slots=True)
class Signals:
    """The signals that a driver takes, by channel, and the DBC file that describes their messages.

    Attributes:
        driver: The name in `[drivers.<name>]`, for messages.
        dbc: The path of the DBC file.
        channels: The signal of each channel.
    """

    driver: str
    dbc: Path
    channels: Mapping[str, CanChannel]


SILENCE_S = 5.0


class CanTable(DriverTable):
    """How python-can reaches a bus; `options` are passed to the interface unchanged."""

    interface: Text
    channel: Text
    bitrate: Annotated[Count, Field(ge=10_000, le=1_000_000)] | None = None
    options: dict[str, bool | int | float | str] = Field(default_factory=dict)
    period_s: PollPeriod = 0.1
    timeout_s: Timeout | None = None
    reopen_s: Annotated[Number, Field(ge=0.5, le=86_400)] | None = None

    @property
    def longest_silence_s(self) -> float:
        """The silence, in s, after which the bus is opened again: `reopen_s`, or a default.

        The default is 5 s, or five times `silence_s` if that is longer.
        """
        return max(SILENCE_S, 5.0 * self.silence_s) if self.reopen_s is None else self.reopen_s

    @property
    def listens(self) -> bool:
        """Whether the driver only listens and never sends.

        An interface with a listen-only mode is then opened in it, so that it does not even acknowledge
        frames.
        """
        return True

    @property
    def silence_s(self) -> float:
        """The silence, in s, after which a channel is faulty: `timeout_s`, or two periods."""
        return self.timeout_s if self.timeout_s is not None else 2.0 * self.period_s


MODBUS_INPUTS = {"icpdas_m7018": 8, "wago_750_458": 8, "micro800_tc2": 2}
"""How many inputs each ready map has."""
CAN_INPUTS = {"css_canmod_temp": 4, "peak_mu_thermocouple1": 8}

DBC_OF = {
    "css_canmod_temp": Path(__file__).parent / "maps" / "css_canmod_temp.dbc",
    "peak_mu_thermocouple1": Path(__file__).parent / "maps" / "peak_mu_thermocouple1.dbc",
}


def modbus_input(device: str, number: int, first_register: int = 0) -> ModbusChannel:
    """Return the register of an input of a ready map.

    Args:
        device: A key of `MODBUS_INPUTS`.
        number: The input, from 0 on; `check_channels` has checked it.
        first_register: Where the module's block begins, counted from 0.
    """
    return _MODBUS[device](number, first_register)


def dbc_file(path: Path) -> Path:
    """Return the path of a DBC file.

    A path that does not exist may name a file that comes with the drivers, such as `drivers/maps/….dbc`. A
    path that names neither is returned unchanged, and reading it fails later.
    """
    bundled = Path(__file__).parent.parent / path
    return bundled if not os.path.exists(path) and os.path.exists(bundled) else path


def can_input(device: str, number: int) -> CanChannel:
    """Return the signal of an input in the device's DBC file.

    Args:
        device: A key of `CAN_INPUTS`.
        number: The input, from 0 on; `check_channels` has checked it.
    """
    return {"css_canmod_temp": _canmod_temp, "peak_mu_thermocouple1": _mu_thermocouple1}[device](number)


def _m7018(number: int, first: int) -> ModbusChannel:
    """ICP DAS M-7018, engineering format of 0.1 °C: input registers 30001–30008."""
    return ModbusChannel(
        register=first + number, scale=0.1, fault_codes={0x7FFF: "open_circuit", 0x8000: "under_range"}
    )


def _wago_750_458(number: int, first: int) -> ModbusChannel:
    """WAGO 750-458, 0.1 °C, word-aligned process image: status byte in the word before each data word.

    The module clamps a value to the end of its range, and only the status byte shows it. The codes are 0x41
    under range, 0x42 over range, 0x60 wire break. With 0x80, register communication, the data word is not a
    temperature.
    """
    return ModbusChannel(
        register=first + 2 * number + 1,
        scale=0.1,
        fault_codes={0x7FFF: "open_circuit", 0x8000: "cold_junction"},
        status_register=first + 2 * number,
        status_faults={
            0x80: "register_communication",
            0x20: "open_circuit",
            0x01: "under_range",
            0x02: "over_range",
            0x40: "module_error",
        },
    )


def _micro800_tc2(number: int, first: int) -> ModbusChannel:
    """Rockwell 2080-TC2, its words mapped to registers in order: two data words, two information words.

    Counts are 10 · (t + 270 °C), so 0.1 °C with an offset of −270 °C (Rockwell 2080-UM004, appendix 3).
    """
    return ModbusChannel(
        register=first + number,
        type="uint16",
        scale=0.1,
        offset=-270.0,
        status_register=first + 2 + number,
        status_faults={
            1 << 5: "open_circuit",
            1 << 6: "under_range",
            1 << 7: "over_range",
            1 << 4: "not_ready",
            1 << 14: "module_error",
            1 << 15: "module_error",
        },
    )


_MODBUS = {"icpdas_m7018": _m7018, "wago_750_458": _wago_750_458, "micro800_tc2": _micro800_tc2}


def _canmod_temp(number: int) -> CanChannel:
    """CSS CANmod.temp, standard resolution (1 °C, 5 Hz): connectors TL, TR, BL, BR with their status."""
    place = ("TL", "TR", "BL", "BR")[number]
    return CanChannel(
        message="Thermocouple",
        signal=f"{place}Temp",
        fault_signal=f"{place}Status",
        fault_values={1: "cold_junction", 2: "open_circuit", 3: "out_of_range"},
    )


def _mu_thermocouple1(number: int) -> CanChannel:
    """PEAK MU-Thermocouple1: inputs 1A, 1B, 2A … 4B in 0x100 and 0x101, 1/16 °C every 300 ms, no status."""
    return CanChannel(
        message="Thermocouples1" if number < 4 else "Thermocouples2",
        signal=f"T{number // 2 + 1}{'AB'[number % 2]}",
    )
