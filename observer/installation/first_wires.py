"""The drivers in a first configuration: the thermocouples' module, and what gives the nut's position."""

from __future__ import annotations

import math
import struct
from collections.abc import Callable, Mapping

from drivers.decode import bytes_of, words_of
from drivers.places import WORDS
from drivers.protocol import register_of_manual
from observer.errors import UserError
from observer.installation.catalogue import OTHER, Answers, option
from observer.installation.first_tables import FileTable, Note, inline
from observer.installation.typed import is_serial


def check_wires(found: Answers, name: str) -> None:
    """Raise `UserError` where the answer `name`, just given, does not fit the module or the control."""
    if name == "inputs" or (name == "module" and found.module != OTHER):
        _inputs(found, len(found.thermocouples))
    if name == "ambient":
        _inputs(found, len(found.thermocouples) + (found.ambient == "input"))
    if name == "module_at" and found.wire != "can":
        _modbus_at(found.module_at)
    if name == "first_register":
        _register(found.first_register, found.function)
    if name == "control_at" and found.control == "modbus":
        _modbus_at(found.control_at, name)
    if name == "control_at" and found.control in _LIKE:
        _url(found)
    if name in ("position_signal", "speed_signal") and found.control == "can" and getattr(found, name):
        _message_and_signal(found, name)
    if name == "shown_at_ends_m":
        _direction(found)


def _register(number: int, function: str) -> int:
    """A register on the wire, given as there or by a manual. Raises `UserError` for another function's."""
    of_manual = register_of_manual(number)
    if of_manual is None:
        return number
    if of_manual[0] != function:
        raise UserError(f"{number} is the manual's number of a register of {of_manual[0]}, not of {function}")
    return of_manual[1]


def _inputs(answers: Answers, needed: int) -> None:
    """Raise `UserError` where the module has fewer inputs than are needed."""
    module = answers.reader
    if answers.wire and needed > module.inputs:
        raise UserError(
            f"{needed} inputs are needed (sensors, and the air where it is an input) and {module.title} has "
            f"{module.inputs}; leave some out, and add another module to the file afterwards"
        )


def control_tables(answers: Answers) -> list[FileTable]:
    """Return the tables of what gives the nut's position. Raises `UserError` for an address that is none."""
    return _CONTROL_PARTS[answers.control](answers)


def module_tables(answers: Answers) -> list[FileTable]:
    """Return the tables of the thermocouple module. Raises `UserError` where it has too few inputs."""
    names = [f"{name}_degC" for name in answers.thermocouples]
    names += ["ambient_degC"] if answers.ambient == "input" else []
    _inputs(answers, len(names))
    if not answers.wire:
        return []
    wire = _can_at(answers.module_at) if answers.wire == "can" else _modbus_at(answers.module_at)
    if answers.wire != "can":
        wire["unit_id"] = answers.module_unit
    if answers.transport != "tcp":
        wire["transport"] = Note(answers.transport, "a serial server that passes RTU frames on")
    module = answers.reader
    if answers.module == OTHER:
        about = f"{module.title}, counted from 0 as on the wire (40001 and 30001 of a manual are 0)"
        table = FileTable("[drivers.thermocouples]", {**wire, "period_s": module.period_s}, about)
        return [table, *(_described(answers, name, k) for k, name in enumerate(names))]
    inputs = inline({name: k for k, name in enumerate(names)})
    keys = {
        **wire,
        "device": answers.module,
        "period_s": module.period_s,
        "channels": Note(inputs, "from 0"),
    }
    about = f"{module.title}; a broken wire and other errors it reports become faults"
    return [FileTable("[drivers.thermocouples]", keys, about)]


def _described(answers: Answers, name: str, number: int) -> FileTable:
    """The table of one channel of a module that is not in the list."""
    first = _register(answers.first_register, answers.function)
    step = answers.step or WORDS[answers.type]
    keys: dict[str, object] = {"register": first + step * number, "function": answers.function}
    keys["type"] = answers.type
    if WORDS[answers.type] > 1:
        keys["word_order"] = Note(answers.word_order, '"little" where the low word comes first')
    keys["scale"] = Note(answers.scale, "°C per count")
    if answers.fault_code:
        codes = inline({_raw_code(answers.fault_code, answers.type): "open_circuit"})
        keys["fault_codes"] = Note(codes, "what it sends for an open input")
    else:
        keys |= {
            "low": -40.0,
            "high": Note(200.0, "look: beyond these it counts as a fault, as an open input"),
        }
    return FileTable(f"[drivers.thermocouples.channels.{name}]", keys)


def _raw_code(code: str, kind: str) -> str:
    """The raw value, in hexadecimal, by which registers of a type hold a code as it was typed."""
    words = WORDS[kind]
    if code.lower().startswith("0x"):
        return f"0x{int(code, 16):0{4 * words}X}"
    try:
        data = bytes_of(words_of(float(code), kind, "ABCD"))
    except (struct.error, OverflowError):
        wrapped = round(float(code)) & ((1 << 16 * words) - 1)
        data = wrapped.to_bytes(2 * words, "big")
    return f"0x{data.hex().upper()}"


def _modbus_at(place: str, name: str = "module_at") -> dict[str, object]:
    if is_serial(place):
        return {
            "kind": "modbus_rtu",
            "port": place,
            "baudrate": Note(9600, "as the device is set"),
            "parity": "N",
            "unit_id": 1,
        }
    host, _, port = place.partition(":")
    if not host or (port and not port.isdigit()):
        raise UserError(
            f"{option(name)}: {place!r} is not an address; write it as 192.168.0.20 or 192.168.0.20:502"
        )
    return {"kind": "modbus_tcp", "host": host, "port": int(port or 502), "unit_id": 1}


def _can_at(place: str, kind: str = "can") -> dict[str, object]:
    if is_serial(place):
        wire = {"interface": "slcan", "channel": place, "bitrate": Note(500_000, "of the bus")}
        return {"kind": kind, **wire}
    socket = Note("socketcan", "its bit rate is set where the interface is brought up")
    return {"kind": kind, "interface": socket, "channel": place}


_ZERO = "so that the nut's middle at the screw's left end is 0"
_AXIS = "[drivers.axis]"
_LEAST_PART, _MOST_PART = 0.9, 1.1
"""Of the stroke, between what the control shows at its ends."""


def _channels(position: Mapping[str, object], speed: Mapping[str, object] | None) -> list[FileTable]:
    """The channels of a control: the nut's position, and the screw's speed if there is one."""
    parts = [FileTable("[drivers.axis.channels.nut_position_m]", position)]
    return parts if speed is None else [*parts, FileTable("[drivers.axis.channels.screw_speed_rpm]", speed)]


def _direction(answers: Answers) -> float:
    """1, or -1 where the control counts towards the left bearing.

    Raises `UserError` where what it shows at the ends does not fit the stroke or the sign of its counts.
    """
    if answers.shown_at_ends_m is None:
        return 1.0
    left_m, right_m = answers.shown_at_ends_m
    stroke_m = answers.stroke_m[1] - answers.stroke_m[0]
    shown_m = right_m - left_m
    if not _LEAST_PART * stroke_m <= abs(shown_m) <= _MOST_PART * stroke_m:
        raise UserError(
            f"the control then shows {1000 * abs(shown_m):g} mm from end to end, and the stroke is "
            f"{1000 * stroke_m:g} mm; correct one of them"
        )
    counts_per_m = getattr(answers, "counts_per_m", None)
    if counts_per_m is not None and counts_per_m * shown_m < 0.0:
        raise UserError(
            f"the control then counts towards the {'left' if shown_m < 0.0 else 'right'} bearing, and "
            f"counts_per_m = {counts_per_m:g} says otherwise; correct its sign, or exchange the two readings"
        )
    return math.copysign(1.0, shown_m)


def _offset(answers: Answers, unit: str = "") -> Note:
    """What to add to the control's position so that the screw's left end is 0."""
    if answers.shown_at_ends_m is None:
        return Note(0.0, f"{_ZERO}{unit}: its place at the stroke's left end less what is read there")
    offset_m = answers.stroke_m[0] - _direction(answers) * answers.shown_at_ends_m[0]
    return Note(round(offset_m, 6), f"{_ZERO}{unit}")


def _canopen(answers: Answers) -> list[FileTable]:
    keys = {
        **_can_at(answers.control_at, "canopen"),
        "node_id": answers.node_id,
        "mode": "tpdo",
        "position_byte": Note(0, "where the position begins in its message; cob_id if not the first TPDO's"),
        "counts_per_m": answers.counts_per_m,
        "offset_m": _offset(answers),
        "position_channel": "nut_position_m",
    }
    return [
        FileTable(_AXIS, keys, "CANopen DS-402 drive, object 0x6064; it only listens, and gives no speed")
    ]


def _modbus(answers: Answers) -> list[FileTable]:
    keys = {**_modbus_at(answers.control_at, "control_at"), "period_s": 0.05}
    first = _register(answers.position_register, "holding")
    position: dict[str, object] = {
        "register": Note(first, "counted from 0; 40001 is 0"),
        "function": "holding",
        "type": answers.position_type,
    }
    if WORDS[answers.position_type] > 1:
        position["word_order"] = Note(answers.position_word_order, '"little" where the low word comes first')
    position |= {"scale": 1.0 / (answers.counts_per_m or 1.0), "offset": _offset(answers)}
    number = answers.speed_register
    speed = None
    if number is not None:
        at = _register(number, "holding")
        speed = {"register": at, "function": "holding", "type": "int16", "scale": Note(1.0, "rpm per count")}
    about = "the control's position in registers, counted from 0 as on the wire"
    return [FileTable(_AXIS, keys, about), *_channels(position, speed)]


def _can(answers: Answers) -> list[FileTable]:
    keys = {
        **_can_at(answers.control_at),
        "dbc": answers.dbc,
        "period_s": Note(0.02, "how often the message comes"),
        "timeout_s": 0.3,
    }

    def signal(name: str, direction: float = 1.0) -> dict[str, object]:
        message, of_it = _message_and_signal(answers, name)
        scale = Note(direction, "to the unit in the channel's name: 0.001 where the signal is in mm")
        return {"message": message, "signal": of_it, "scale": scale}

    position = signal("position_signal", _direction(answers))
    if answers.shown_at_ends_m is not None:
        position["offset"] = _offset(answers)
    channels = _channels(position, signal("speed_signal") if answers.speed_signal else None)
    return [
        FileTable(_AXIS, keys, "the control's cyclic messages, by its DBC file; it only listens"),
        *channels,
    ]


def _message_and_signal(answers: Answers, name: str) -> tuple[str, str]:
    """The message and the signal of a DBC file that an answer names."""
    given = str(getattr(answers, name))
    message, _, signal = given.partition(".")
    if not message or not signal:
        raise UserError(f"{option(name)}: {given!r} names no signal; write it as AxisStatus.NutPosition")
    return message, signal


_LIKE = {"opcua": "opc.tcp://192.168.0.21:4840", "mtconnect": "http://192.168.0.21:5000"}
"""How the address of each kind of server is written."""


def _url(answers: Answers) -> str:
    """The address of the control's own server."""
    like = _LIKE[answers.control]
    if not answers.control_at.startswith(like.partition("//")[0]):
        raise UserError(f"--control-at: {answers.control_at!r} is not an address; write it as {like}")
    return answers.control_at


def _server(answers: Answers, name: str, period_s: float, **scale: object) -> list[FileTable]:
    """The control's own server, whose values go by `name`."""
    keys = {"kind": answers.control, "url": _url(answers), "period_s": period_s}
    position = {name: answers.position_signal, **scale, "offset": _offset(answers, ", in m")}
    speed = {name: answers.speed_signal} if answers.speed_signal else None
    about = "the control's own server, only read; needs the packages of ballscrew-observer[plant]"
    return [FileTable(_AXIS, keys, about), *_channels(position, speed)]


def _opcua(answers: Answers) -> list[FileTable]:
    scale = Note(_direction(answers) * 0.001, "mm to m; 1.0 where the node is in metres")
    return _server(answers, "node", 0.05, scale=scale)


def _mtconnect(answers: Answers) -> list[FileTable]:
    """Data items have their own unit."""
    if _direction(answers) < 0.0:
        return _server(answers, "item", 0.5, scale=-1.0)
    return _server(answers, "item", 0.5)


_CONTROL_PARTS: dict[str, Callable[[Answers], list[FileTable]]] = {
    "canopen": _canopen,
    "modbus": _modbus,
    "can": _can,
    "opcua": _opcua,
    "mtconnect": _mtconnect,
    "none": lambda _answers: [],
    OTHER: lambda _answers: [],
}
