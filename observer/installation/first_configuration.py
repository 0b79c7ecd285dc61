"""A first configuration by `observer init`: the answers it needs, and the file composed from them.

The file's comments teach its keys; it is loaded before it is written.
"""

from __future__ import annotations

import math
import tomllib
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from pydantic import ValidationError

from observer.errors import UserError
from observer.installation import parse
from observer.installation.catalogue import Answers, Of, option
from observer.installation.first_template import filled
from observer.installation.first_wires import check_wires

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
    content = filled(answers)
    parse(tomllib.loads(content), "init")
    return content
