"""A first configuration by `observer init`: the answers it needs, and the file composed from them.

The file's comments teach its keys; it is loaded before it is written.
"""

from __future__ import annotations

import math
import tomllib
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from pydantic import ValidationError

from observer.errors import UserError, has_extra
from observer.installation import parse
from observer.installation.catalogue import (
    HOUSINGS,
    MOUNTINGS,
    OTHER,
    SCREWS,
    STEELS,
    Answers,
    Of,
    option,
    screw_of,
)
from observer.installation.first_bodies import bodies
from observer.installation.first_tables import FileTable, Note, as_text, inline
from observer.installation.first_wires import check_wires, control_tables, module_tables

Ask = Callable[[str, str | None, str], str]
"""Asks for a field of `Answers`, with its default and what is wrong so far; returns what was typed."""


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
        needed = field.is_required() or (name == "sensors_m" and not found.housings)
        if belongs := _belongs(found, field.metadata):
            if text is not None:
                raise UserError(f"{option(name)}: {belongs}; leave it out")
        elif text is not None:
            if problem := _set(found, name, text):
                raise UserError(f"{option(name)}: {problem}")
        elif ask is not None:
            default = said.get(name, None if needed else _offered(field.default))
            while True:
                text = ask(name, default, trouble).strip()
                if text == "" == default or not (trouble := _set(found, name, text)):
                    break
            trouble, said[name] = "", text
        elif needed:
            missing.append(option(name))
    if missing:
        raise UserError(f"init: no terminal to ask on; give {', '.join(missing)}")
    return found


def _offered(default: object) -> str:
    """A default as it is offered, empty where there is none."""
    return "" if default is None or default == () else str(default)


def _belongs(found: Answers, metadata: Sequence[object]) -> str:
    """To which other answer a question belongs that is not to be asked; empty where it is."""
    reasons = (of.belongs(found) for of in metadata if isinstance(of, Of))
    return next(filter(None, reasons), "")


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
    places_m = getattr(found, name) if name in ("stroke_m", "sensors_m") else ()
    if name == "sensors_m" and not places_m and not found.housings:
        raise UserError("there is no thermocouple yet; give a place on the screw, or name --housings")
    if (beyond_m := max(places_m, default=0.0)) > getattr(found, "length_m", math.inf):
        raise UserError(f"{beyond_m:g} m is beyond the screw's end, at {found.length_m:g} m")
    check_wires(found, name)


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


def compose(answers: Answers) -> str:
    """The configuration as text. Raises `UserError` where the answers do not fit together."""
    parts = [
        *_machine(answers),
        *_sources(answers),
        *bodies(answers),
        *_sensors(answers),
        *_supports(answers),
        *module_tables(answers),
        *control_tables(answers),
    ]
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
    no_driver = [
        what
        for what, bus in (("the module", answers.module_bus), ("the control", answers.control))
        if bus == OTHER
    ]
    head = _HEAD + (_NO_DRIVER.format(what=" and ".join(no_driver)) if no_driver else "")
    return head + "".join(f"\n{as_text(part)}" for part in parts)


_HEAD = """\
# Written by `observer init`. Values marked "look" are typical ones: correct them where you know better.
# Every key: docs/reference/configuration.md. Ask what it means:  observer check --config <this file>
"""
_NO_DRIVER = """\
#
# No driver speaks the bus of {what}. Either write the values to a log and replay it
# (docs/how-to/record-and-replay.md), or write a driver, one file (docs/how-to/add-a-driver.md).
"""
_NO_LAW = """no channel gives the speed, so the heats have no law; they are estimated
# For `simulate`, `calibrate` and `discover` deliver a channel screw_speed_rpm, and give speed_channel with
# torque_Nm (nut) and heat_W_rpm (bearings) here."""
_INSULATED = {"kind": "insulated"}


def _machine(answers: Answers) -> list[FileTable]:
    screw, steel = screw_of(answers.screw), STEELS[answers.steel]
    unlisted = "" if answers.screw in SCREWS else "; scaled from the nearest size in the list"
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
        FileTable("[screw]", about, f"{answers.screw} mm, of {answers.steel} steel{unlisted}"),
        FileTable("[surface]", {"convection_W_m2K": film}),
        FileTable("[ambient]", air),
        FileTable(
            "[boundary.left]", _INSULATED, "the bearings are sources below; beyond them nothing is lost"
        ),
        FileTable("[boundary.right]", _INSULATED),
        FileTable("[estimator]", {"kind": "kalman", "period_s": 0.5}),
    ]


def _sources(answers: Answers) -> list[FileTable]:
    screw = screw_of(answers.screw)
    nut: dict[str, object] = {
        "name": "nut",
        "shape": "nut",
        "length_m": Note(screw.nut_mm / 1000, "look"),
        "stroke_m": Note(list(answers.stroke_m), "where the middle of the nut travels"),
    }
    bearing: dict[str, object] = {}
    if answers.control not in ("none", OTHER):
        nut |= {"position_channel": "nut_position_m", "lead_m": screw.lead_mm / 1000}
    about = _NO_LAW
    if answers.has_speed:
        about = "what warms the screw; the estimator starts from the laws and estimates the heats"
        nut |= {
            "speed_channel": "screw_speed_rpm",
            "torque_Nm": Note(screw.torque_Nm, "look: friction with preload; a starting value"),
        }
        bearing = {
            "speed_channel": "screw_speed_rpm",
            "heat_W_rpm": Note(screw.bearing_W_rpm, "look: a starting value"),
        }
    if "nut" in answers.housings:
        nut["nodes"] = Note(inline({HOUSINGS["nut"].node: 0.5}), "half of it, the rest into the screw")
    elif answers.has_speed:
        nut["share"] = Note(0.5, "of it into the screw, the rest into nut and table")
    ends = (("left_bearing", 0.0), ("right_bearing", answers.length_m))
    return [
        FileTable("[[source]]", nut, about),
        *(
            FileTable("[[source]]", {"name": name, "shape": "point", "position_m": at, **bearing})
            for name, at in ends
        ),
    ]


def _sensors(answers: Answers) -> list[FileTable]:
    places: list[dict[str, object]] = [{"on": HOUSINGS[name].node} for name in answers.housings]
    places += [{"position_m": at} for at in answers.sensors_m]
    noise_K = answers.reader.noise_K
    return [
        FileTable("[[sensor]]", {"name": name, "channel": f"{name}_degC", **place, "noise_K": noise_K})
        for name, place in zip(answers.thermocouples, places, strict=True)
    ]


def _supports(answers: Answers) -> list[FileTable]:
    """How the ends are held, where that is known."""
    if answers.mounting == "unknown":
        return []
    keys: dict[str, object] = {"mounting": Note(MOUNTINGS[answers.mounting], answers.mounting)}
    if answers.mounting in ("fixed-supported", "fixed-free"):
        keys["first"] = Note(answers.fixed_end, "the fixed end; upper is left on a vertical axis")
    if answers.mounting == "fixed-fixed":
        keys["preload_N"] = Note(0.0, "pre-tension of the cold screw, if it is stretched")
    return [FileTable("[supports]", keys)]
