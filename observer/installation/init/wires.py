"""Ready pieces of `[drivers.…]` for modules and controls; as text, with comments that say what to look up."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import tomlkit

from drivers.places import CAN_INPUTS, MODBUS_INPUTS
from observer.errors import UserError
from observer.installation.init.answers import Answers


@dataclass(frozen=True, slots=True)
class Module:
    """A thermocouple module: what it is called, how often it has news, and how finely it measures."""

    called: str
    inputs: int
    period_s: float
    noise_K: float


MODULES = {
    "wago_750_458": Module("WAGO 750-458", MODBUS_INPUTS["wago_750_458"], 0.5, 0.1),
    "icpdas_m7018": Module("ICP DAS M-7018", MODBUS_INPUTS["icpdas_m7018"], 1.0, 0.1),
    "micro800_tc2": Module("Rockwell 2080-TC2", MODBUS_INPUTS["micro800_tc2"], 0.5, 0.1),
    "css_canmod_temp": Module("CSS CANmod.temp", CAN_INPUTS["css_canmod_temp"], 0.2, 0.4),
    "peak_mu_thermocouple1": Module("PEAK MU-Thermocouple1", CAN_INPUTS["peak_mu_thermocouple1"], 0.3, 0.1),
}


def text(value: object) -> str:
    """A value as TOML."""
    return tomlkit.item(value).as_string()


def module_driver(answers: Answers, channels: dict[str, int]) -> str:
    """The table of the thermocouple module; `channels` are its inputs, counted from 0."""
    module = MODULES[answers.module]
    listed = ", ".join(f"{name} = {number}" for name, number in channels.items())
    on_can = answers.module in CAN_INPUTS
    return f"""\
# {module.called}; a broken wire and what else it tells become faults. Inputs are counted from 0.
[drivers.thermocouples]
{_can_at(answers.module_at) if on_can else _modbus_at(answers.module_at)}
device = {text(answers.module)}
period_s = {module.period_s:g}
channels = {{ {listed} }}
"""


def _host_and_port(place: str, usual: int, option: str) -> tuple[str, int]:
    host, _, port = place.partition(":")
    if not host or (port and not port.isdigit()):
        raise UserError(f"{option}: {place!r} is no address; write it as 192.168.0.20 or 192.168.0.20:502")
    return host, int(port or usual)


def _is_serial(place: str) -> bool:
    return place.startswith("/") or place.upper().startswith("COM")


def _modbus_at(place: str, option: str = "--module-at") -> str:
    if _is_serial(place):
        return f"""\
kind = "modbus_rtu"
port = {text(place)}
baudrate = 9600                  # as the device is set
parity = "N"
unit_id = 1"""
    host, port = _host_and_port(place, 502, option)
    return f"""\
kind = "modbus_tcp"
host = {text(host)}
port = {port}
unit_id = 1"""


def _can_at(place: str, kind: str = "can") -> str:
    if _is_serial(place):
        return f"""\
kind = {text(kind)}
interface = "slcan"
channel = {text(place)}
bitrate = 500000                 # of the bus"""
    return f"""\
kind = {text(kind)}
interface = "socketcan"          # its bit rate is set where the interface is brought up
channel = {text(place)}"""


def _needed(answers: Answers, *names: str) -> None:
    missing = [f"--{n.replace('_', '-')}" for n in names if getattr(answers, n) in (None, "")]
    if missing:
        raise UserError(f"init: --control {answers.control} also needs {', '.join(missing)}")


def _canopen(answers: Answers) -> str:
    _needed(answers, "control_at", "counts_per_m", "node_id")
    return f"""\
# CANopen DS-402 drive, object 0x6064; it only listens to the drive's own process data.
# The drive tells no speed here, so the heats have no law; they are estimated all the same.
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
dbc = {text(answers.dbc)}
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
message = {text(message)}
signal = {text(name)}
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
scale = 0.001                    # mm to m; 1.0 where the node tells metres
offset = 0.0                     # so that the nut's middle at the screw's left end is 0
""",
    )


def _mtconnect(answers: Answers) -> str:
    """`position_signal` and `speed_signal` are data items, which tell their unit."""
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
        raise UserError(f"--control-at: {answers.control_at!r} is no address; write it as {like}")
    speed = (
        ""
        if not answers.speed_signal
        else f"""
[drivers.axis.channels.screw_speed_rpm]
{name} = {text(answers.speed_signal)}
"""
    )
    return f"""\
# The control's own server; it is only read. Needs the packages of ballscrew-observer[plant].
[drivers.axis]
kind = {text(kind)}
url = {text(answers.control_at)}
period_s = {period_s:g}

[drivers.axis.channels.nut_position_m]
{name} = {text(answers.position_signal)}
{of_position}{speed}"""


@dataclass(frozen=True, slots=True)
class Control:
    """Where the nut's position comes from: words for who asks, and the table, if there is one."""

    called: str
    driver: Callable[[Answers], str]


CONTROLS = {
    "canopen": Control("CANopen DS-402 drive", _canopen),
    "modbus": Control("Modbus registers of the control", _modbus),
    "can": Control("CAN messages by a DBC file", _can),
    "opcua": Control("OPC UA server of the control", _opcua),
    "mtconnect": Control("MTConnect agent of the control", _mtconnect),
    "none": Control("no position yet: the nut's heat is spread over its stroke", lambda _: ""),
}


def has_speed(answers: Answers) -> bool:
    """Whether the control tells the screw's speed."""
    return answers.speed_register is not None or bool(answers.speed_signal)
