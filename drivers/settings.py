"""What the configuration says about each driver; checked here once, without importing any bus library.

A driver is a table `[drivers.<name>]` whose `kind` chooses its settings. Every kind names the channels it
delivers; a channel either takes an input of a ready device map (`device = "wago_750_458"`,
`channels = { t1_degC = 0 }`) or spells its place out (`channels.t1_degC = { register = 0, scale = 0.1 }`).
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Literal, TypeVar, get_args

from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Discriminator,
    Field,
    Tag,
    model_validator,
)

from observer.errors import raise_all
from observer.tables.quantities import Count, File, Finite, Number, checked_channel


def _any_base(code: object) -> object:
    """Let codes be written as in device manuals; keys of TOML tables are strings, `0x7FFF` among them."""
    try:
        return int(code, 0) if isinstance(code, str) and len(code) <= 12 else code
    except ValueError:
        return code


ChannelName = Annotated[
    str,
    Field(min_length=1, max_length=128, pattern=r"^[A-Za-z0-9_.-]+$"),
    AfterValidator(checked_channel),
]
Input = Annotated[Count, Field(ge=0, le=63)]
Scale = Annotated[Finite, Field(ge=-1e9, le=1e9)]
PollPeriod = Annotated[Number, Field(ge=0.005, le=3600)]
Timeout = Annotated[Number, Field(ge=0.01, le=60)]
Register = Annotated[Count, Field(ge=0, le=0xFFFF)]
Word = Annotated[Count, BeforeValidator(_any_base), Field(ge=0, le=0xFFFF_FFFF)]
Text = Annotated[str, Field(min_length=1, max_length=256, pattern=r"^[^\x00-\x1f\x7f]+$")]
FaultName = Annotated[str, Field(pattern=r"^[a-z][a-z0-9_]*$", max_length=64)]

WORDS = {"int16": 1, "uint16": 1, "int32": 2, "uint32": 2, "float32": 2}


Place = TypeVar("Place")


def _which(value: object) -> str:
    return UNION_TAGS[0] if isinstance(value, int) else UNION_TAGS[1]


# An input of a ready map or a place written out, told apart before either is checked, so that an error is
# about the one that was meant. The tags appear in the location of such an error.
UNION_TAGS = ("input", "place")
_InputOr = Annotated[
    Annotated[Input, Tag(UNION_TAGS[0])] | Annotated[Place, Tag(UNION_TAGS[1])], Discriminator(_which)
]


class Settings(BaseModel):
    """A table under `[drivers.…]`: frozen, and unknown keys are refused."""

    model_config = ConfigDict(frozen=True, extra="forbid")


class ModbusChannel(Settings):
    """One value in the registers of a Modbus device: value = scale · raw + offset.

    `register` counts from 0, as on the wire. `fault_codes` are raw values (unsigned, as in the manual) that
    stand for a fault. A `status_register` (same `function`) makes the value a fault when it has all bits of
    a key of `status_faults`; the first key that fits names the fault. Values outside `low` … `high` are
    faults too.
    """

    register_: Register = Field(alias="register")
    function: Literal["holding", "input"] = "input"
    type: Literal["int16", "uint16", "int32", "uint32", "float32"] = "int16"
    word_order: Literal["big", "little"] = "big"
    scale: Scale = 1.0
    offset: Finite = 0.0
    low: Finite | None = None
    high: Finite | None = None
    fault_codes: dict[Word, FaultName] = {}
    status_register: Register | None = None
    status_faults: dict[Annotated[Word, Field(ge=1, le=0xFFFF)], FaultName] = {}

    @model_validator(mode="after")
    def _sensible(self) -> ModbusChannel:
        if self.scale == 0:
            raise ValueError("scale = 0 makes every value the same; give the device's resolution")
        if self.register_ + WORDS[self.type] > 0x10000:
            raise ValueError(f"a {self.type} at register {self.register_} reaches beyond register 65535")
        if bool(self.status_faults) != (self.status_register is not None):
            raise ValueError("status_register and status_faults belong together; give both or neither")
        if self.low is not None and self.high is not None and not self.low < self.high:
            raise ValueError(f"low = {self.low} must be smaller than high = {self.high}")
        return self


class _Modbus(Settings):
    """What TCP and RTU share."""

    device: Literal["icpdas_m7018", "wago_750_458", "micro800_tc2"] | None = None
    first_register: Annotated[Count, Field(ge=0, le=0xFFF0)] = 0
    unit_id: Annotated[Count, Field(ge=0, le=255)] = 1
    period_s: PollPeriod = 0.5
    timeout_s: Timeout = 1.0
    channels: dict[ChannelName, _InputOr[ModbusChannel]] = Field(min_length=1)

    @model_validator(mode="after")
    def _inputs_belong_to_a_device(self) -> _Modbus:
        _check_inputs(self.device, self.channels)
        _check_each_its_own(self.channels)
        if self.device is None and self.first_register:
            raise ValueError(
                "first_register shifts a ready device map; without device, write the registers out"
            )
        return self


class ModbusTcpSettings(_Modbus):
    """A Modbus TCP device."""

    kind: Literal["modbus_tcp"]
    host: Text
    port: Annotated[Count, Field(ge=1, le=65535)] = 502


class ModbusRtuSettings(_Modbus):
    """A Modbus RTU device on a serial line; `quiet_s` is the silence kept after a reply that never came."""

    kind: Literal["modbus_rtu"]
    port: Text
    baudrate: Annotated[Count, Field(ge=300, le=4_000_000)] = 19200
    parity: Literal["N", "E", "O"] = "N"
    stopbits: Literal[1, 2] = 1
    quiet_s: Annotated[Number, Field(ge=0.05, le=60)] = 0.5


class CanChannel(Settings):
    """One signal of a DBC file: value = scale · signal + offset.

    `fault_signal` (of the same message) makes the value a fault when its raw number is a key of
    `fault_values`, or, without `fault_values`, when it is not 0.
    """

    message: Text
    signal: Text
    scale: Scale = 1.0
    offset: Finite = 0.0
    fault_signal: Text | None = None
    fault_values: dict[Annotated[int, Field(ge=0, lt=1 << 64)], FaultName] = {}

    @model_validator(mode="after")
    def _sensible(self) -> CanChannel:
        if self.scale == 0:
            raise ValueError("scale = 0 makes every value the same; give 1 or the unit's factor")
        if self.fault_values and self.fault_signal is None:
            raise ValueError("fault_values needs fault_signal")
        return self


class _CanBus(Settings):
    """How python-can reaches the bus; `options` go to the interface as they are."""

    interface: Text
    channel: Text
    bitrate: Annotated[Count, Field(ge=10_000, le=1_000_000)] | None = None
    options: dict[str, bool | int | float | str] = {}
    period_s: PollPeriod = 0.1
    timeout_s: Timeout | None = None

    @property
    def silence_s(self) -> float:
        """How long a channel may say nothing before each further period is a fault."""
        return self.timeout_s if self.timeout_s is not None else 2.0 * self.period_s


class CanSettings(_CanBus):
    """Signals of cyclic CAN messages, decoded by a DBC file or a ready device map."""

    kind: Literal["can"]
    dbc: File | None = None
    device: Literal["css_canmod_temp", "peak_mu_thermocouple1"] | None = None
    channels: dict[ChannelName, _InputOr[CanChannel]] = Field(min_length=1)

    @model_validator(mode="after")
    def _one_description(self) -> CanSettings:
        if (self.dbc is None) == (self.device is None):
            raise ValueError("give exactly one of dbc and device")
        _check_inputs(self.device, self.channels)
        _check_each_its_own(self.channels)
        return self


class CanopenSettings(_CanBus):
    """The actual position (object 0x6064) of a CANopen DS-402 drive.

    metres = counts / counts_per_m + offset_m.
    `mode = "tpdo"` listens to the drive's own process data (identifier `cob_id`, position at byte
    `position_byte`); `mode = "sdo"` asks for the object each period, which is the only way here that sends,
    and only upload (read) requests.
    """

    kind: Literal["canopen"]
    node_id: Annotated[Count, Field(ge=1, le=127)]
    mode: Literal["tpdo", "sdo"] = "tpdo"
    cob_id: Annotated[Count, Field(ge=0x181, le=0x57F)] | None = None
    position_byte: Annotated[Count, Field(ge=0, le=4)] = 0
    counts_per_m: Finite
    offset_m: Finite = 0.0
    position_channel: ChannelName = "nut_position_m"

    @model_validator(mode="after")
    def _sensible(self) -> CanopenSettings:
        if self.counts_per_m == 0:
            raise ValueError("counts_per_m = 0 makes no position; give the drive's resolution")
        if self.mode == "sdo" and self.cob_id is not None:
            raise ValueError('cob_id belongs to mode = "tpdo"; remove it')
        return self


class PlayerSettings(Settings):
    """A recorded log played as if it were live, in its own rhythm; `channels` defaults to all of it."""

    kind: Literal["player"]
    path: File
    speed: Finite = 1.0
    channels: tuple[ChannelName, ...] | None = Field(default=None, min_length=1)

    @model_validator(mode="after")
    def _in_its_own_rhythm(self) -> PlayerSettings:
        if self.speed != 1:
            raise ValueError(
                f"speed = {self.speed:g} would show the model a machine that heats as much in another time; "
                "remove it, or take `observer replay`, which is as fast as the computer"
            )
        return self


DriverSettings = Annotated[
    ModbusTcpSettings | ModbusRtuSettings | CanSettings | CanopenSettings | PlayerSettings,
    Field(discriminator="kind"),
]

DRIVER_KINDS: tuple[str, ...] = tuple(
    get_args(settings.model_fields["kind"].annotation)[0]
    for settings in get_args(get_args(DriverSettings)[0])
)

# Inputs of each ready device map; the maps themselves are in `drivers.devices`.
DEVICE_INPUTS = {
    "icpdas_m7018": 8,
    "wago_750_458": 8,
    "micro800_tc2": 2,
    "css_canmod_temp": 4,
    "peak_mu_thermocouple1": 8,
}


def _check_inputs(device: str | None, channels: Mapping[str, int | ModbusChannel | CanChannel]) -> None:
    """Refuse input numbers that no ready map has."""
    problems = []
    for channel, place in channels.items():
        if not isinstance(place, int):
            continue
        if device is None:
            problems.append(
                f"channel {channel}: an input number needs device; name it, or write the place out"
            )
        elif place >= DEVICE_INPUTS[device]:
            last = DEVICE_INPUTS[device] - 1
            problems.append(f"channel {channel}: {device} has inputs 0 to {last}, not {place}")
    raise_all(problems)


def _check_each_its_own(channels: Mapping[str, int | ModbusChannel | CanChannel]) -> None:
    """Refuse two channels that take the very same value."""
    places: dict[object, list[str]] = {}
    for channel, place in channels.items():
        match place:
            case ModbusChannel():
                places.setdefault((place.function, place.register_, place.type), []).append(channel)
            case CanChannel():
                places.setdefault((place.message, place.signal), []).append(channel)
            case _:
                places.setdefault(place, []).append(channel)
    raise_all(
        [
            f"channels {', '.join(same)} all read the same place; give each its own"
            for same in places.values()
            if len(same) > 1
        ]
    )


def delivered(settings: DriverSettings) -> tuple[str, ...] | None:
    """The channels that a driver delivers; None for a player of a whole log, which nobody has read yet."""
    if settings.kind == "canopen":
        return (settings.position_channel,)
    return None if settings.channels is None else tuple(settings.channels)
