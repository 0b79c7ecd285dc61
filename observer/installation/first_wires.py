"""The drivers in a first configuration: the thermocouples' module, and what gives the nut's position."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from drivers.places import CAN_INPUTS
from observer.errors import UserError
from observer.installation.catalogue import MODULES, Answers, option
from observer.installation.first_tables import FileTable, Note, inline


def check_wires(found: Answers, name: str) -> None:
    """Raise `UserError` where the answer `name`, just given, does not fit the module or the control."""
    if name == "module":
        _inputs(found, len(found.thermocouples))
    if name == "ambient":
        _inputs(found, len(found.thermocouples) + (found.ambient == "input"))
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


def control_tables(answers: Answers) -> list[FileTable]:
    """Return the tables of what gives the nut's position. Raises `UserError` for an address that is none."""
    return _CONTROL_PARTS[answers.control](answers)


def module_table(answers: Answers) -> FileTable:
    """Return the table of the thermocouple module. Raises `UserError` where it has too few inputs."""
    names = [f"{name}_degC" for name in answers.thermocouples]
    names += ["ambient_degC"] if answers.ambient == "input" else []
    module = MODULES[answers.module]
    _inputs(answers, len(names))
    wire = _can_at(answers.module_at) if answers.module in CAN_INPUTS else _modbus_at(answers.module_at)
    inputs = inline({name: k for k, name in enumerate(names)})
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
        "byte_order": Note("ABCD", '"CDAB" where the low word comes first'),
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
