"""A first configuration by `observer init`: the answers it needs, and the file composed from them.

The file's comments teach its keys; it is loaded before it is written.
"""

from __future__ import annotations

import math
import tomllib
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import NamedTuple

import tomlkit
from pydantic import ValidationError

from drivers.places import CAN_INPUTS
from observer.errors import UserError, has_extra
from observer.installation import parse
from observer.installation.catalogue import MODULES, SCREWS, STEELS, Answers, OfControl

Ask = Callable[[str, str | None, str], str]
"""Asks for a field of `Answers`, with its default and what is wrong so far; returns what was typed."""


def option(name: str) -> str:
    """The command-line option of a field of `Answers`."""
    return f"--{name.replace('_', '-')}"


def agreed(given: Mapping[str, str | None], ask: Ask | None) -> Answers:
    """Complete the answers until a configuration can be composed; whoever is asked may correct them.

    Raises `UserError` where an option is invalid, nobody can be asked, or the answers are unchanged.
    """
    said: dict[str, str] = {}
    trouble = ""
    while True:
        before = dict(said)
        try:
            found = answers(given, ask, said, trouble)
            checked(found)
        except UserError as error:
            if ask is None or said == before:
                raise
            trouble = f"{error}\nTry again; Enter keeps your answer.\n"
        else:
            return found


def answers(
    given: Mapping[str, str | None], ask: Ask | None, said: dict[str, str] | None = None, trouble: str = ""
) -> Answers:
    """Complete what was not given by asking or, if nobody can be asked, by defaults.

    Earlier answers in `said` are offered as defaults and updated; `trouble` is shown before the first
    question. Raises `UserError` for an invalid option and, if nobody can be asked, for missing ones.
    """
    said = {} if said is None else said
    found, missing = Answers.model_construct(), []
    for name, field in Answers.model_fields.items():
        text = given.get(name)
        of = next((each.names for each in field.metadata if isinstance(each, OfControl)), None)
        if of is not None and found.control not in of:
            if text is not None:
                belongs = f"belongs to --control {' or '.join(of)}, not to {found.control}"
                raise UserError(f"{option(name)}: {belongs}; leave it out")
        elif text is not None:
            if problem := _set(found, name, text):
                raise UserError(f"{option(name)}: {problem}")
        elif ask is not None:
            default = said.get(name, None if field.is_required() else str(field.default or ""))
            while True:
                text = ask(name, default, trouble).strip()
                if text == "" == default or not (trouble := _set(found, name, text)):
                    break
            trouble, said[name] = "", text
        elif field.is_required():
            missing.append(option(name))
    if missing:
        raise UserError(f"init: no terminal to ask on; give {', '.join(missing)}")
    return found


def _set(found: Answers, name: str, text: str) -> str:
    """Set a field from text; returns what is wrong with it, or with it and the answers before, or nothing."""
    try:
        setattr(found, name, text)
        _fits(found, name)
    except ValidationError as error:
        problem = error.errors()[0]["msg"].removeprefix("Value error, ")
        return f"{text!r}: {problem[0].lower()}{problem[1:]}"
    except UserError as error:
        return str(error).removeprefix(f"{option(name)}: ")
    return ""


def _fits(found: Answers, name: str) -> None:
    """Raise `UserError` where the answer just given does not fit those before it."""
    if name in ("stroke_m", "sensors_m") and max(getattr(found, name)) > getattr(found, "length_m", math.inf):
        beyond_m = max(getattr(found, name))
        raise UserError(f"{beyond_m:g} m is beyond the screw's end, at {found.length_m:g} m")
    if name == "module":
        _inputs(found, len(getattr(found, "sensors_m", ())))
    if name == "ambient":
        _inputs(found, len(found.sensors_m) + (found.ambient == "input"))
    if name == "module_at" and found.module not in CAN_INPUTS:
        _modbus_at(found.module_at)
    if name == "control_at" and found.control == "modbus":
        _modbus_at(found.control_at, name)
    if name == "control_at" and found.control in _LIKE:
        _url(found)
    if name in ("position_signal", "speed_signal") and found.control == "can" and getattr(found, name):
        _message_and_signal(found, name)


def _inputs(answers: Answers, needed: int) -> None:
    """Raise `UserError` where the module has fewer inputs than are needed."""
    module = MODULES[answers.module]
    if needed > module.inputs:
        raise UserError(
            f"{needed} inputs are needed (sensors, and the air where it is an input) and {module.title} has "
            f"{module.inputs}; leave some out, and add another module to the file afterwards"
        )


def write_new(path: Path, given: Mapping[str, str | None], ask: Ask | None) -> None:
    """Write a configuration by the answers. Raises `UserError` if the file exists, or cannot be written."""
    if path.exists():  # before anything is asked
        raise UserError(f"{path}: already exists and is not overwritten; give another file with --output")
    content = checked(agreed(given, ask))
    try:
        path.write_text(content, encoding="utf-8")
    except OSError as error:
        raise UserError(
            f"{path}: cannot be written ({error.strerror}); name another file with --output"
        ) from None


def checked(answers: Answers) -> str:
    """The configuration as text. Raises `UserError` where the answers do not fit together."""
    content = compose(answers)
    parse(tomllib.loads(content), "init")
    return content


class Note(NamedTuple):
    """A value with the comment beside it."""

    value: object
    comment: str


class FileTable(NamedTuple):
    """A table of the file: its header with a comment, and its keys."""

    header: str
    keys: Mapping[str, object]
    comment: str = ""


def compose(answers: Answers) -> str:
    """The configuration as text. Raises `UserError` where the answers do not fit together."""
    parts = [*_machine(answers), *_sources(answers), *_sensors(answers), _module(answers)]
    parts += _CONTROL_PARTS[answers.control](answers)
    parts += [
        FileTable(
            "[publish]",
            {"mode": "router", "listen": ["tcp/127.0.0.1:7447"]},
            "where `observer watch` and `observer health` ask",
        ),
        FileTable(
            "[record]",
            {"directory": "recordings"},
            "what was read; the unit starts in /var/lib/ballscrew-observer",
        ),
    ]
    if has_extra("page"):
        parts.append(FileTable("[page]", {"listen": "127.0.0.1:8080"}, "for browsers on this computer"))
    return _HEAD + "".join(f"\n{_text(part)}" for part in parts)


def _text(part: FileTable) -> str:
    lines = [_line(part.header, part.comment)]
    for key, entry in part.keys.items():
        value, comment = entry if isinstance(entry, Note) else (entry, "")
        lines.append(_line(f"{key} = {tomlkit.item(value).as_string()}", comment))
    return "\n".join(lines) + "\n"


def _line(text: str, comment: str) -> str:
    return f"{text:<32} # {comment}" if comment else text


_HEAD = """\
# Written by `observer init`. Values marked "look" are typical ones: correct them where you know better.
# Every key: docs/reference/configuration.md. Ask what it means:  observer check --config <this file>
"""
_NO_LAW = """no channel gives the speed, so the heats have no law; they are estimated
# For `simulate`, `calibrate` and `discover` deliver a channel screw_speed_rpm, and give speed_channel with
# torque_Nm (nut) and heat_W_rpm (bearings) here."""
_INSULATED = {"kind": "insulated"}


def _machine(answers: Answers) -> list[FileTable]:
    screw, steel = SCREWS[answers.screw], STEELS[answers.steel]
    about = {
        "length_m": Note(answers.length_m, "between the bearings; all positions count from its left end"),
        "diameter_m": Note(round(screw.root_mm / 1000, 6), "look: between the grooves"),
        "conductivity_W_mK": Note(steel.conductivity_W_mK, "look"),
        "density_kg_m3": steel.density_kg_m3,
        "specific_heat_J_kgK": steel.specific_heat_J_kgK,
        "expansion_1_K": steel.expansion_1_K,
    }
    film = Note(15.0, "look: still air 10, a fast screw 30; `observer calibrate` finds it")
    air: dict[str, object] = {"temperature_degC": answers.ambient}
    if answers.ambient == "input":
        air = {"channel": Note("ambient_degC", "of the air near the screw, shielded from its heat")}
    keys = f"names the Zenoh keys: ballscrew/{answers.machine}/{answers.axis}/…"
    return [
        FileTable("[machine]", {"name": answers.machine, "axis": answers.axis}, keys),
        FileTable("[screw]", about, f"{answers.screw} mm, of {answers.steel} steel"),
        FileTable("[surface]", {"convection_W_m2K": film}),
        FileTable("[ambient]", air),
        FileTable(
            "[boundary.left]", _INSULATED, "the bearings are sources below; beyond them nothing is lost"
        ),
        FileTable("[boundary.right]", _INSULATED),
        FileTable("[estimator]", {"kind": "kalman", "period_s": 0.5}),
    ]


def _sources(answers: Answers) -> list[FileTable]:
    screw = SCREWS[answers.screw]
    nut: dict[str, object] = {
        "name": "nut",
        "shape": "nut",
        "length_m": Note(screw.nut_mm / 1000, "look"),
        "stroke_m": Note(list(answers.stroke_m), "where the middle of the nut travels"),
    }
    bearing: dict[str, object] = {}
    if answers.control != "none":
        nut |= {"position_channel": "nut_position_m", "lead_m": screw.lead_mm / 1000}
    about = _NO_LAW
    if answers.has_speed:
        about = "what warms the screw; the estimator starts from the laws and estimates the heats"
        nut |= {
            "speed_channel": "screw_speed_rpm",
            "torque_Nm": Note(screw.torque_Nm, "look: friction with preload; a starting value"),
            "share": Note(0.5, "of it into the screw, the rest into nut and table"),
        }
        bearing = {
            "speed_channel": "screw_speed_rpm",
            "heat_W_rpm": Note(screw.bearing_W_rpm, "look: a starting value"),
        }
    ends = (("left_bearing", 0.0), ("right_bearing", answers.length_m))
    return [
        FileTable("[[source]]", nut, about),
        *(
            FileTable("[[source]]", {"name": name, "shape": "point", "position_m": at, **bearing})
            for name, at in ends
        ),
    ]


def _sensors(answers: Answers) -> list[FileTable]:
    noise_K = MODULES[answers.module].noise_K
    return [
        FileTable(
            "[[sensor]]", {"name": f"t{n}", "channel": f"t{n}_degC", "position_m": at, "noise_K": noise_K}
        )
        for n, at in enumerate(answers.sensors_m, start=1)
    ]


def _module(answers: Answers) -> FileTable:
    """The table of the thermocouple module."""
    names = [f"t{k + 1}_degC" for k in range(len(answers.sensors_m))]
    names += ["ambient_degC"] if answers.ambient == "input" else []
    module = MODULES[answers.module]
    _inputs(answers, len(names))
    wire = _can_at(answers.module_at) if answers.module in CAN_INPUTS else _modbus_at(answers.module_at)
    inputs = tomlkit.inline_table()
    inputs.update({name: k for k, name in enumerate(names)})
    keys = {
        **wire,
        "device": answers.module,
        "period_s": module.period_s,
        "channels": Note(inputs, "from 0"),
    }
    about = f"{module.title}; a broken wire and other errors it reports become faults"
    return FileTable("[drivers.thermocouples]", keys, about)


def _is_serial(place: str) -> bool:
    return place.startswith("/") or place.upper().startswith("COM")


def _modbus_at(place: str, name: str = "module_at") -> dict[str, object]:
    if _is_serial(place):
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
    if _is_serial(place):
        wire = {"interface": "slcan", "channel": place, "bitrate": Note(500_000, "of the bus")}
        return {"kind": kind, **wire}
    socket = Note("socketcan", "its bit rate is set where the interface is brought up")
    return {"kind": kind, "interface": socket, "channel": place}


_ZERO = "so that the nut's middle at the screw's left end is 0"
_AXIS = "[drivers.axis]"


def _channels(position: Mapping[str, object], speed: Mapping[str, object] | None) -> list[FileTable]:
    """The channels of a control: the nut's position, and the screw's speed if there is one."""
    parts = [FileTable("[drivers.axis.channels.nut_position_m]", position)]
    return parts if speed is None else [*parts, FileTable("[drivers.axis.channels.screw_speed_rpm]", speed)]


def _canopen(answers: Answers) -> list[FileTable]:
    keys = {
        **_can_at(answers.control_at, "canopen"),
        "node_id": answers.node_id,
        "mode": "tpdo",
        "position_byte": Note(0, "where the position begins in its message; cob_id if not the first TPDO's"),
        "counts_per_m": answers.counts_per_m,
        "offset_m": Note(0.0, _ZERO),
        "position_channel": "nut_position_m",
    }
    return [
        FileTable(_AXIS, keys, "CANopen DS-402 drive, object 0x6064; it only listens, and gives no speed")
    ]


def _modbus(answers: Answers) -> list[FileTable]:
    keys = {**_modbus_at(answers.control_at, "control_at"), "period_s": 0.1}
    position = {
        "register": Note(answers.position_register, "the first of a pair; 40001 is 0"),
        "function": "holding",
        "type": "int32",
        "word_order": Note("big", '"little" where the low word comes first'),
        "scale": 1.0 / (answers.counts_per_m or 1.0),
        "offset": Note(0.0, _ZERO),
    }
    number = answers.speed_register
    speed = {"register": number, "function": "holding", "type": "int16", "scale": Note(1.0, "rpm per count")}
    about = "the control's position in registers, counted from 0 as on the wire"
    return [FileTable(_AXIS, keys, about), *_channels(position, None if number is None else speed)]


def _can(answers: Answers) -> list[FileTable]:
    keys = {
        **_can_at(answers.control_at),
        "dbc": answers.dbc,
        "period_s": Note(0.02, "how often the message comes"),
        "timeout_s": 0.3,
    }

    def signal(name: str) -> dict[str, object]:
        message, of_it = _message_and_signal(answers, name)
        scale = Note(1.0, "to the unit in the channel's name: 0.001 where the signal is in mm")
        return {"message": message, "signal": of_it, "scale": scale}

    channels = _channels(signal("position_signal"), signal("speed_signal") if answers.speed_signal else None)
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
    position = {name: answers.position_signal, **scale, "offset": Note(0.0, f"{_ZERO}, in m")}
    speed = {name: answers.speed_signal} if answers.speed_signal else None
    about = "the control's own server, only read; needs the packages of ballscrew-observer[plant]"
    return [FileTable(_AXIS, keys, about), *_channels(position, speed)]


def _opcua(answers: Answers) -> list[FileTable]:
    scale = Note(0.001, "mm to m; 1.0 where the node is in metres")
    return _server(answers, "node", 0.1, scale=scale)


def _mtconnect(answers: Answers) -> list[FileTable]:
    """Data items have their own unit."""
    return _server(answers, "item", 0.5)


_CONTROL_PARTS: dict[str, Callable[[Answers], list[FileTable]]] = {
    "canopen": _canopen,
    "modbus": _modbus,
    "can": _can,
    "opcua": _opcua,
    "mtconnect": _mtconnect,
    "none": lambda _answers: [],
}
