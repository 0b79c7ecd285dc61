"""The commented template of a first configuration, filled from the answers of `observer init`.

In the template `##` begins a comment that goes beside its key, and lines without text are left out.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping

import tomlkit

from drivers.places import WORDS
from observer.errors import has_extra
from observer.installation.catalogue import (
    HOUSINGS,
    MOUNTINGS,
    OTHER,
    SCREWS,
    STEELS,
    TYPICAL_LINK,
    TYPICAL_MASS,
    Answers,
    BODY_J_kgK,
    NUT_FILM_W_m2K,
    screw_of,
)
from observer.installation.first_wires import (
    direction_of_counts,
    message_and_signal,
    modbus_place,
    module_channels,
    raw_code,
    register_on_wire,
    url_of,
)
from observer.installation.typed import is_serial

_COMMENT_AT = 32


def filled(answers: Answers) -> str:
    """Return the configuration as commented text; values marked "look" are typical ones to be corrected.

    Raises:
        UserError: The answers about module, control or signals do not fit together.
    """
    parts = (_machine, _sources, _bodies, _sensors, _supports, _module, _control, _outlets)
    return _head(answers) + _laid_out("\n".join(part(answers) for part in parts))


def _laid_out(text: str) -> str:
    """The lines of a template with a blank line before each table, and comments below each other."""
    lines = []
    for line in filter(str.strip, text.splitlines()):
        code, mark, comment = (part.strip() for part in line.partition("##"))
        blank = "\n" if re.match(r"\[+[a-z]", code) else ""
        lines.append(f"{blank}{code:<{_COMMENT_AT}} # {comment}" if mark else f"{blank}{line.strip()}")
    return "\n".join(lines) + "\n"


def _toml(value: object) -> str:
    """A value as TOML, a mapping in one line."""
    if isinstance(value, Mapping):
        table = tomlkit.inline_table()
        table.update(value)
        return table.as_string()
    return tomlkit.item(value).as_string()


def _head(answers: Answers) -> str:
    unknown = [
        name
        for name, bus in (("the module", answers.module_bus), ("the control", answers.control))
        if bus == OTHER
    ]
    head = """\
# Written by `observer init`. Values marked "look" are typical ones: correct them where you know better.
# Every key: docs/reference/configuration.md. Ask what it means:  observer check --config <this file>
"""
    if not unknown:
        return head
    return f"""{head}#
# No driver speaks the bus of {" and ".join(unknown)}. Either write the values to a log and replay it
# (docs/how-to/record-and-replay.md), or write a driver, one file (docs/how-to/add-a-driver.md).
"""


def _machine(answers: Answers) -> str:
    screw, steel = screw_of(answers.screw), STEELS[answers.steel]
    scaled = "" if answers.screw in SCREWS else "; scaled from the nearest size in the list"
    air = f"temperature_degC = {_toml(answers.ambient)}"
    if answers.ambient == "input":
        air = 'channel = "ambient_degC" ## of the air near the screw, shielded from its heat'
    return f"""
[machine] ## names the Zenoh keys: ballscrew/{answers.machine}/{answers.axis}/…
name = {_toml(answers.machine)}
axis = {_toml(answers.axis)}
[screw] ## {answers.screw} mm, of {answers.steel} steel{scaled}
length_m = {_toml(answers.length_m)} ## between the bearings; all positions count from its left end
diameter_m = {_toml(round(screw.root_mm / 1000, 6))} ## look: between the grooves
conductivity_W_mK = {_toml(steel.conductivity_W_mK)} ## look
density_kg_m3 = {_toml(steel.density_kg_m3)}
specific_heat_J_kgK = {_toml(steel.specific_heat_J_kgK)}
expansion_1_K = {_toml(steel.expansion_1_K)}
[surface]
convection_W_m2K = 15.0 ## look: still air 10, a fast screw 30; `observer calibrate` finds it
[ambient]
{air}
[boundary.left] ## the bearings are sources below; beyond them nothing is lost
kind = "insulated"
[boundary.right]
kind = "insulated"
[estimator]
kind = "kalman"
period_s = 0.5
"""


def _sources(answers: Answers) -> str:
    screw = screw_of(answers.screw)
    position = speed = bearing = share = ""
    comment = """no channel gives the speed, so the heats have no law; they are estimated
# For `simulate`, `calibrate` and `discover` deliver a channel screw_speed_rpm, and give speed_channel with
# torque_Nm (nut) and heat_W_rpm (bearings) here."""
    if answers.control not in ("none", OTHER):
        position = f"""position_channel = "nut_position_m"
lead_m = {_toml(screw.lead_mm / 1000)}"""
    if answers.has_speed:
        comment = "what warms the screw; the estimator starts from the laws and estimates the heats"
        speed = f"""speed_channel = "screw_speed_rpm"
torque_Nm = {_toml(screw.torque_Nm)} ## look: friction with preload; a starting value"""
        bearing = f"""speed_channel = "screw_speed_rpm"
heat_W_rpm = {_toml(screw.bearing_W_rpm)} ## look: a starting value"""
        share = "share = 0.5 ## of it into the screw, the rest into nut and table"
    if "nut" in answers.housings:
        share = f"nodes = {_toml({HOUSINGS['nut'].node: 0.5})} ## half of it, the rest into the screw"
    ends = "".join(
        f"""
[[source]]
name = "{name}_bearing"
shape = "point"
position_m = {_toml(at_m)}
{bearing}"""
        for name, at_m in (("left", 0.0), ("right", answers.length_m))
    )
    return f"""
[[source]] ## {comment}
name = "nut"
shape = "nut"
length_m = {_toml(screw.nut_mm / 1000)} ## look
stroke_m = {_toml(list(answers.stroke_m))} ## where the middle of the nut travels
{position}
{speed}
{share}
{ends}"""


def _bodies(answers: Answers) -> str:
    """The bodies that carry thermocouples, each linked to the screw and to the air."""
    return "".join(_body(name, answers) for name in answers.housings)


def _body(name: str, answers: Answers) -> str:
    screw, body, is_nut = screw_of(answers.screw), HOUSINGS[name], name == "nut"
    given_kg = answers.nut_kg if is_nut else answers.housing_kg
    kg = given_kg or (screw.nut_kg if is_nut else screw.housing_kg)
    capacity = f"capacity_J_K = {_toml(round(kg * BODY_J_kgK))} ## "
    capacity += f"{kg:g} kg" if given_kg is not None else f"look: {kg:g} kg with what is bolted to it"
    mass = "" if given_kg is not None else f"tolerance = {_toml(TYPICAL_MASS)}"
    contact = f"conductance_W_K = {_toml(screw.housing_W_K)} ## look: by balls, rings and seats"
    if is_nut:
        area_m2 = math.pi * screw.root_mm * screw.nut_mm / 1e6
        contact = f"""film_W_m2K = {_toml(NUT_FILM_W_m2K)} ## look: a grease film of 0.2 mm, and the balls
area_m2 = {_toml(round(area_m2, 5))} ## of the thread within the nut"""
    air_W_K = _toml(round(body.air_W_K * kg ** (2.0 / 3.0), 2))
    return f"""
[[node]]
name = {_toml(body.node)}
{capacity}
{mass}
[[link]]
between = {_toml([body.source, body.node])}
{contact}
tolerance = {_toml(TYPICAL_LINK)} ## how well that is known
[[link]]
between = {_toml([body.node, "ambient"])}
conductance_W_K = {air_W_K} ## look: by its surface, and what it is bolted to
tolerance = {_toml(TYPICAL_LINK)}
"""


def _sensors(answers: Answers) -> str:
    places = [f"on = {_toml(HOUSINGS[name].node)}" for name in answers.housings]
    places += [f"position_m = {_toml(at_m)}" for at_m in answers.sensors_m]
    return "".join(
        f"""
[[sensor]]
name = {_toml(name)}
channel = {_toml(f"{name}_degC")}
{place}
noise_K = {_toml(answers.reader.noise_K)}
"""
        for name, place in zip(answers.thermocouples, places, strict=True)
    )


def _supports(answers: Answers) -> str:
    """How the ends are held, where that is known."""
    if answers.mounting == "unknown":
        return ""
    detail = ""
    if answers.mounting in ("fixed-supported", "fixed-free"):
        detail = f"first = {_toml(answers.fixed_end)} ## the fixed end; upper is left on a vertical axis"
    if answers.mounting == "fixed-fixed":
        detail = "preload_N = 0.0 ## pre-tension of the cold screw, if it is stretched"
    return f"""
[supports]
mounting = {_toml(MOUNTINGS[answers.mounting])} ## {answers.mounting}
{detail}
"""


def _outlets(_answers: Answers) -> str:
    page = '\n[page] ## for browsers on this computer\nlisten = "127.0.0.1:8080"\n'
    return f"""
[publish] ## where `observer watch` and `observer health` ask
mode = "router"
listen = ["tcp/127.0.0.1:7447"]
[record] ## what was read; the unit starts in /var/lib/ballscrew-observer
directory = "recordings"
{page if has_extra("page") else ""}"""


def _modbus(place: str, name: str, unit_id: int = 1) -> str:
    """The keys of a Modbus connection; `name` is the question that its place answers."""
    if is_serial(place):
        return f"""kind = "modbus_rtu"
port = {_toml(place)}
baudrate = 9600 ## as the device is set
parity = "N"
unit_id = {unit_id}"""
    host, port = modbus_place(place, name)
    return f"""kind = "modbus_tcp"
host = {_toml(host)}
port = {port}
unit_id = {unit_id}"""


def _can(place: str, kind: str = "can") -> str:
    """The keys of a connection to a CAN bus."""
    if is_serial(place):
        return f"""kind = {_toml(kind)}
interface = "slcan"
channel = {_toml(place)}
bitrate = 500000 ## of the bus"""
    return f"""kind = {_toml(kind)}
interface = "socketcan" ## its bit rate is set where the interface is brought up
channel = {_toml(place)}"""


def _word_order(order: str, kind: str) -> str:
    """The order of a number's words, where it has several."""
    return (
        f'word_order = {_toml(order)} ## "little" where the low word comes first' if WORDS[kind] > 1 else ""
    )


def _module(answers: Answers) -> str:
    """The tables of the thermocouple module."""
    names = module_channels(answers)
    if not answers.wire:
        return ""
    module = answers.reader
    is_can = answers.wire == "can"
    wire = _can(answers.module_at) if is_can else _modbus(answers.module_at, "module_at", answers.module_unit)
    if answers.transport != "tcp":
        wire += f"\ntransport = {_toml(answers.transport)} ## a serial server that passes RTU frames on"
    if answers.module == OTHER:
        channels = "".join(_described(answers, name, k) for k, name in enumerate(names))
        return f"""
[drivers.thermocouples] ## {module.title}, counted from 0 as on the wire (40001 and 30001 of a manual are 0)
{wire}
period_s = {_toml(module.period_s)}
{channels}"""
    return f"""
[drivers.thermocouples] ## {module.title}; a broken wire and other errors it reports become faults
{wire}
device = {_toml(answers.module)}
period_s = {_toml(module.period_s)}
channels = {_toml({name: k for k, name in enumerate(names)})} ## from 0
"""


def _described(answers: Answers, name: str, number: int) -> str:
    """The table of one channel of a module that is not in the list."""
    first = register_on_wire(answers.first_register, answers.function)
    faults = """low = -40.0
high = 200.0 ## look: beyond these it counts as a fault, as an open input"""
    if answers.fault_code:
        codes = _toml({raw_code(answers.fault_code, answers.type): "open_circuit"})
        faults = f"fault_codes = {codes} ## what it sends for an open input"
    return f"""
[drivers.thermocouples.channels.{name}]
register = {first + (answers.step or WORDS[answers.type]) * number}
function = {_toml(answers.function)}
type = {_toml(answers.type)}
{_word_order(answers.word_order, answers.type)}
scale = {_toml(answers.scale)} ## °C per count
{faults}
"""


def _control(answers: Answers) -> str:
    """Return the tables of the driver that reads the nut's position, empty without one."""
    if answers.control in ("none", OTHER):
        return ""
    tables = {"canopen": _canopen, "modbus": _registers, "can": _signals}
    return tables.get(answers.control, _server)(answers)


def _offset(answers: Answers, key: str, unit: str = "") -> str:
    """Return the key of the offset that brings the control's position to 0 at the screw's left end."""
    aim = f"so that the nut's middle at the screw's left end is 0{unit}"
    if answers.shown_at_ends_m is None:
        return f"{key} = 0.0 ## {aim}: its place at the stroke's left end less what is read there"
    offset_m = answers.stroke_m[0] - direction_of_counts(answers) * answers.shown_at_ends_m[0]
    return f"{key} = {_toml(round(offset_m, 6))} ## {aim}"


def _channels(position: str, speed: str) -> str:
    """The channels of a control: the nut's position, and the screw's speed if there is one."""
    speed = f"[drivers.axis.channels.screw_speed_rpm]\n{speed}" if speed else ""
    return f"[drivers.axis.channels.nut_position_m]\n{position}\n{speed}\n"


def _canopen(answers: Answers) -> str:
    return f"""
[drivers.axis] ## CANopen DS-402 drive, object 0x6064; it only listens, and gives no speed
{_can(answers.control_at, "canopen")}
node_id = {_toml(answers.node_id)}
mode = "tpdo"
position_byte = 0 ## where the position begins in its message; cob_id if not the first TPDO's
counts_per_m = {_toml(answers.counts_per_m)}
{_offset(answers, "offset_m")}
position_channel = "nut_position_m"
"""


def _registers(answers: Answers) -> str:
    speed, number = "", answers.speed_register
    if number is not None:
        speed = f"""register = {register_on_wire(number, "holding")}
function = "holding"
type = "int16"
scale = 1.0 ## rpm per count"""
    register = register_on_wire(answers.position_register, "holding")
    position = f"""register = {register} ## counted from 0; 40001 is 0
function = "holding"
type = {_toml(answers.position_type)}
{_word_order(answers.position_word_order, answers.position_type)}
scale = {_toml(1.0 / (answers.counts_per_m or 1.0))}
{_offset(answers, "offset")}"""
    return f"""
[drivers.axis] ## the control's position in registers, counted from 0 as on the wire
{_modbus(answers.control_at, "control_at")}
period_s = 0.05
{_channels(position, speed)}"""


def _signals(answers: Answers) -> str:
    def signal(name: str, direction: float = 1.0) -> str:
        message, signal = message_and_signal(answers, name)
        return f"""message = {_toml(message)}
signal = {_toml(signal)}
scale = {_toml(direction)} ## to the unit in the channel's name: 0.001 where the signal is in mm"""

    position = signal("position_signal", direction_of_counts(answers))
    if answers.shown_at_ends_m is not None:
        position += f"\n{_offset(answers, 'offset')}"
    return f"""
[drivers.axis] ## the control's cyclic messages, by its DBC file; it only listens
{_can(answers.control_at)}
dbc = {_toml(answers.dbc)}
period_s = 0.02 ## how often the message comes
timeout_s = 0.3
{_channels(position, signal("speed_signal") if answers.speed_signal else "")}"""


def _server(answers: Answers) -> str:
    """The control's own server, OPC UA or MTConnect, whose data items have their own unit."""
    direction, is_opcua = direction_of_counts(answers), answers.control == "opcua"
    key, period_s = ("node", 0.05) if is_opcua else ("item", 0.5)
    scale = "" if direction > 0.0 else "scale = -1.0"
    if is_opcua:
        scale = f"scale = {_toml(direction * 0.001)} ## mm to m; 1.0 where the node is in metres"
    position = f"""{key} = {_toml(answers.position_signal)}
{scale}
{_offset(answers, "offset", ", in m")}"""
    speed = f"{key} = {_toml(answers.speed_signal)}" if answers.speed_signal else ""
    return f"""
[drivers.axis] ## the control's own server, only read; needs the extra `plant`
kind = {_toml(answers.control)}
url = {_toml(url_of(answers))}
period_s = {period_s}
{_channels(position, speed)}"""
