"""A first configuration with comments, composed from the answers and checked before it is written."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Callable
from pathlib import Path

import tomlkit

from drivers.places import CAN_INPUTS
from observer.errors import UserError
from observer.installation import parse
from observer.installation.init.catalogue import MODULES, SCREWS, STEELS
from observer.installation.init.questions import Answers

_NO_LAW = """\
No channel gives the speed, so the heats have no law; they are estimated.
# For `simulate`, `calibrate` and `discover` deliver a channel screw_speed_rpm, and give speed_channel with
# torque_Nm (nut) and heat_W_rpm (bearings) here."""

_ESTIMATOR = """\
[estimator]
kind = "kalman"
period_s = 0.5
"""

_SERVICE = """\
[publish]                        # where `observer watch` and `observer health` ask
mode = "router"
listen = ["tcp/127.0.0.1:7447"]

[record]                         # what was read; the unit starts in /var/lib/ballscrew-observer
directory = "recordings"

[page]                           # for browsers; needs the packages of ballscrew-observer[page]
listen = "127.0.0.1:8080"
"""


def write_new(path: Path, answers: Answers) -> str:
    """Write the configuration, and return it.

    Raises `UserError` if the file exists, cannot be written, or an answer is invalid.
    """
    content = checked(answers)
    try:
        with path.open("x", encoding="utf-8") as file:
            file.write(content)
    except FileExistsError:
        raise UserError(
            f"{path}: is there already and is not overwritten; name another file with --output"
        ) from None
    except OSError as error:
        raise UserError(
            f"{path}: cannot be written ({error.strerror}); name another file with --output"
        ) from None
    return content


def checked(answers: Answers) -> str:
    """The configuration as text. Raises `UserError` if an answer is invalid."""
    content = compose(answers)
    parse(tomllib.loads(content), "init")
    return content


def compose(answers: Answers) -> str:
    """The configuration as text. Raises `UserError` where the answers do not fit together."""
    channels = _inputs(answers)
    parts = (
        _machine(answers),
        _sources(answers),
        *_sensors(answers),
        _ESTIMATOR,
        _module_driver(answers, channels),
        _DRIVERS[answers.control](answers) if answers.control != "none" else "",
        _SERVICE,
    )
    return _aligned("\n".join(part for part in parts if part))


def _aligned(content: str) -> str:
    """Align the comments after values in one column."""
    return re.sub(
        r'^(\w+ = (?:"[^"\n]*"|[^"#\n]*?)) +# ', lambda found: f"{found[1]:<32} # ", content, flags=re.M
    )


def _inputs(answers: Answers) -> dict[str, int]:
    """The module's inputs by channel."""
    names = [f"t{k + 1}_degC" for k in range(len(answers.sensors_m))]
    names += ["ambient_degC"] if answers.ambient == "input" else []
    module = MODULES[answers.module]
    if len(names) > module.inputs:
        raise UserError(
            f"--sensors-m: {len(names)} inputs are needed (sensors and ambient) and {module.title} has "
            f"{module.inputs}; leave some out, and add another module to the file afterwards"
        )
    return {name: number for number, name in enumerate(names)}


def _ambient(answers: Answers) -> str:
    if answers.ambient == "input":
        return 'channel = "ambient_degC"         # of the air near the screw, in the shade of its heat'
    try:
        return f"temperature_degC = {float(answers.ambient)!r}"
    except ValueError:
        raise UserError(
            f"--ambient: {answers.ambient!r} is neither a temperature in °C nor the word input"
        ) from None


def _machine(answers: Answers) -> str:
    screw, steel = SCREWS[answers.screw], STEELS[answers.steel]
    return f"""\
# Written by `observer init`. What is marked "look" is a typical value: correct it where you know better.
# Every key: docs/reference/configuration.md. Ask what it means:  observer check --config <this file>

[machine]                        # names the Zenoh keys: ballscrew/{answers.machine}/{answers.axis}/…
name = {_text(answers.machine)}
axis = {_text(answers.axis)}

[screw]                          # {answers.screw} mm, of {answers.steel} steel
length_m = {answers.length_m!r}  # between the bearings; all positions count from its left end
diameter_m = {screw.root_mm / 1000:.4f}              # look: between the grooves
conductivity_W_mK = {steel.conductivity_W_mK!r}         # look
density_kg_m3 = {steel.density_kg_m3!r}
specific_heat_J_kgK = {steel.specific_heat_J_kgK!r}
expansion_1_K = {steel.expansion_1_K!r}

[surface]
convection_W_m2K = 15.0          # look: still air 10, a fast screw 30; `observer calibrate` finds it

[ambient]
{_ambient(answers)}

[boundary.left]                  # the bearings are sources below; beyond them nothing is lost
kind = "insulated"
[boundary.right]
kind = "insulated"
"""


def _sources(answers: Answers) -> str:
    screw, speed = SCREWS[answers.screw], _has_speed(answers)
    follows = f'position_channel = "nut_position_m"\nlead_m = {screw.lead_mm / 1000:g}\n'
    friction = f"""\
speed_channel = "screw_speed_rpm"
torque_Nm = {screw.torque_Nm}  # look: friction with preload; a starting value
share = 0.5  # of it into the screw, the rest into nut and table
"""
    bearing = f"""\
speed_channel = "screw_speed_rpm"
heat_W_rpm = {screw.bearing_W_rpm}  # look: a starting value
"""
    laws = "Their laws are where the estimator begins; the heats are estimated." if speed else _NO_LAW
    ends = "".join(
        f"""
[[source]]
name = "{side}_bearing"
shape = "point"
position_m = {at!r}
{bearing if speed else ""}"""
        for side, at in (("left", 0.0), ("right", answers.length_m))
    )
    return f"""\
# What warms the screw. {laws}
[[source]]
name = "nut"
shape = "nut"
length_m = {screw.nut_mm / 1000:g}                 # look
stroke_m = [{answers.stroke_m[0]!r}, {answers.stroke_m[1]!r}]           # where the middle of the nut travels
{"" if answers.control == "none" else follows}{friction if speed else ""}{ends}"""


def _sensors(answers: Answers) -> list[str]:
    noise_K = MODULES[answers.module].noise_K
    return [
        f"""\
[[sensor]]
name = "t{number}"
channel = "t{number}_degC"
position_m = {at!r}
noise_K = {noise_K}
"""
        for number, at in enumerate(answers.sensors_m, start=1)
    ]


def _text(value: object) -> str:
    """A value as TOML."""
    return tomlkit.item(value).as_string()


def _module_driver(answers: Answers, channels: dict[str, int]) -> str:
    """The table of the thermocouple module; `channels` are its inputs, counted from 0."""
    module = MODULES[answers.module]
    listed = ", ".join(f"{name} = {number}" for name, number in channels.items())
    on_can = answers.module in CAN_INPUTS
    return f"""\
# {module.title}; a broken wire and other errors it reports become faults. Inputs are counted from 0.
[drivers.thermocouples]
{_can_at(answers.module_at) if on_can else _modbus_at(answers.module_at)}
device = {_text(answers.module)}
period_s = {module.period_s:g}
channels = {{ {listed} }}
"""


def _host_and_port(place: str, usual: int, option: str) -> tuple[str, int]:
    host, _, port = place.partition(":")
    if not host or (port and not port.isdigit()):
        raise UserError(
            f"{option}: {place!r} is not an address; write it as 192.168.0.20 or 192.168.0.20:502"
        )
    return host, int(port or usual)


def _is_serial(place: str) -> bool:
    return place.startswith("/") or place.upper().startswith("COM")


def _modbus_at(place: str, option: str = "--module-at") -> str:
    if _is_serial(place):
        return f"""\
kind = "modbus_rtu"
port = {_text(place)}
baudrate = 9600                  # as the device is set
parity = "N"
unit_id = 1"""
    host, port = _host_and_port(place, 502, option)
    return f"""\
kind = "modbus_tcp"
host = {_text(host)}
port = {port}
unit_id = 1"""


def _can_at(place: str, kind: str = "can") -> str:
    if _is_serial(place):
        return f"""\
kind = {_text(kind)}
interface = "slcan"
channel = {_text(place)}
bitrate = 500000                 # of the bus"""
    return f"""\
kind = {_text(kind)}
interface = "socketcan"          # its bit rate is set where the interface is brought up
channel = {_text(place)}"""


def _needed(answers: Answers, *names: str) -> None:
    missing = [f"--{n.replace('_', '-')}" for n in names if getattr(answers, n) in (None, "")]
    if missing:
        raise UserError(f"init: --control {answers.control} also needs {', '.join(missing)}")


def _canopen(answers: Answers) -> str:
    _needed(answers, "control_at", "counts_per_m", "node_id")
    return f"""\
# CANopen DS-402 drive, object 0x6064; it only listens to the drive's own process data.
# The drive reports no speed here, so the heats have no law; they are still estimated.
[drivers.axis]
{_can_at(answers.control_at, "canopen")}
node_id = {answers.node_id}
mode = "tpdo"
# cob_id = 0x185                 # the message with the position, where it is not the first (0x180 + node)
position_byte = 0                # where in the message the position begins
counts_per_m = {answers.counts_per_m}
offset_m = 0.0                   # so that the nut's middle at the screw's left end is 0
position_channel = "nut_position_m"
"""


def _modbus(answers: Answers) -> str:
    _needed(answers, "control_at", "counts_per_m", "position_register")
    speed = (
        ""
        if answers.speed_register is None
        else f"""
[drivers.axis.channels.screw_speed_rpm]
register = {answers.speed_register}
function = "holding"
type = "int16"
scale = 1.0                      # rpm per count
"""
    )
    return f"""\
# The control's position in a pair of registers, counted from 0 as on the wire: 40001 is 0.
[drivers.axis]
{_modbus_at(answers.control_at, "--control-at")}
period_s = 0.1

[drivers.axis.channels.nut_position_m]
register = {answers.position_register}
function = "holding"
type = "int32"
word_order = "big"               # "little" where the low word comes first
scale = {1.0 / (answers.counts_per_m or 1.0)!r}
offset = 0.0                     # so that the nut's middle at the screw's left end is 0
{speed}"""


def _can(answers: Answers) -> str:
    _needed(answers, "control_at", "dbc", "position_signal")
    parts = [
        f"""\
# Cyclic messages of the drive or the control, by its DBC file; it only listens.
[drivers.axis]
{_can_at(answers.control_at)}
dbc = {_text(answers.dbc)}
period_s = 0.02                  # how often the message comes
timeout_s = 0.3
"""
    ]
    for channel, signal, option in (
        ("nut_position_m", answers.position_signal, "--position-signal"),
        ("screw_speed_rpm", answers.speed_signal, "--speed-signal"),
    ):
        if not signal:
            continue
        message, _, name = signal.partition(".")
        if not message or not name:
            raise UserError(f"{option}: {signal!r} names no signal; write it as AxisStatus.NutPosition")
        parts.append(f"""
[drivers.axis.channels.{channel}]
message = {_text(message)}
signal = {_text(name)}
scale = 1.0                      # to the unit in the channel's name: 0.001 where the signal is in mm
""")
    return "".join(parts)


def _opcua(answers: Answers) -> str:
    """`position_signal` and `speed_signal` are nodes."""
    return _server(
        answers,
        "opcua",
        "opc.tcp://192.168.0.21:4840",
        "node",
        0.1,
        """\
scale = 0.001                    # mm to m; 1.0 where the node is in metres
offset = 0.0                     # so that the nut's middle at the screw's left end is 0
""",
    )


def _mtconnect(answers: Answers) -> str:
    """`position_signal` and `speed_signal` are data items, which have their own unit."""
    return _server(
        answers,
        "mtconnect",
        "http://192.168.0.21:5000",
        "item",
        0.5,
        """\
offset = 0.0                     # so that the nut's middle at the screw's left end is 0, in m
""",
    )


def _server(answers: Answers, kind: str, like: str, name: str, period_s: float, of_position: str) -> str:
    _needed(answers, "control_at", "position_signal")
    if not answers.control_at.startswith(like.partition("//")[0]):
        raise UserError(f"--control-at: {answers.control_at!r} is not an address; write it as {like}")
    speed = (
        ""
        if not answers.speed_signal
        else f"""
[drivers.axis.channels.screw_speed_rpm]
{name} = {_text(answers.speed_signal)}
"""
    )
    return f"""\
# The control's own server; it is only read. Needs the packages of ballscrew-observer[plant].
[drivers.axis]
kind = {_text(kind)}
url = {_text(answers.control_at)}
period_s = {period_s:g}

[drivers.axis.channels.nut_position_m]
{name} = {_text(answers.position_signal)}
{of_position}{speed}"""


def _has_speed(answers: Answers) -> bool:
    """Whether the control reports the screw's speed."""
    return answers.speed_register is not None or bool(answers.speed_signal)


_DRIVERS: dict[str, Callable[[Answers], str]] = {
    "canopen": _canopen,
    "modbus": _modbus,
    "can": _can,
    "opcua": _opcua,
    "mtconnect": _mtconnect,
}
