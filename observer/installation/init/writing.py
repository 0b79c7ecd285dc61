"""A configuration with comments from the answers, checked before it is written."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path

from observer.errors import UserError
from observer.installation import parse
from observer.installation.init.answers import Answers
from observer.installation.init.screws import SCREWS, STEELS
from observer.installation.init.wires import CONTROLS, MODULES, has_speed, module_driver, text

_NO_LAW = """\
Nothing tells the speed, so the heats have no law; they are estimated.
# For `simulate`, `calibrate` and `discover` deliver a channel screw_speed_rpm, and give speed_channel with
# torque_Nm (nut) and heat_W_rpm (bearings) here."""


def write_new(path: Path, answers: Answers) -> str:
    """Write the configuration, and return it.

    Raises `UserError` where the file is there already, cannot be written, or an answer will not do.
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
    """The configuration as text. Raises `UserError` where an answer will not do."""
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
        _rest(),
        module_driver(answers, channels),
        CONTROLS[answers.control].driver(answers),
        _service(),
    )
    return _aligned("\n".join(part for part in parts if part))


def _aligned(content: str) -> str:
    """Put the comments behind values into one column."""
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
            f"--sensors-m: {len(names)} inputs are needed (sensors and ambient) and {module.called} has "
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
            f"--ambient: {answers.ambient!r} is neither a temperature in °C nor the word input; mend it"
        ) from None


def _machine(answers: Answers) -> str:
    screw, steel = SCREWS[answers.screw], STEELS[answers.steel]
    return f"""\
# Written by `observer init`. What is marked "look" is a usual value: mend it where you know better.
# Every key: docs/reference/configuration.md. Ask what it means:  observer check --config <this file>

[machine]                        # names the Zenoh keys: ballscrew/{answers.machine}/{answers.axis}/…
name = {text(answers.machine)}
axis = {text(answers.axis)}

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
    screw, speed = SCREWS[answers.screw], has_speed(answers)
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
    told = "Their laws are where the estimator begins; the heats are estimated." if speed else _NO_LAW
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
# What warms the screw. {told}
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


def _rest() -> str:
    return """\
[estimator]
kind = "kalman"
period_s = 0.5
"""


def _service() -> str:
    return """\
[publish]                        # where `observer watch` and `observer health` ask
mode = "router"
listen = ["tcp/127.0.0.1:7447"]

[record]                         # what was read; the unit starts in /var/lib/ballscrew-observer
directory = "recordings"

[page]                           # for browsers; needs the packages of ballscrew-observer[page]
listen = "127.0.0.1:8080"
"""
