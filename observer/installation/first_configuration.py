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
from observer.installation.catalogue import Answers, BelongsTo, option
from observer.installation.first_template import filled
from observer.installation.first_wires import check_wires

Ask = Callable[[str, str | None, str], str]
"""Asks for a field of `Answers`, with its default and what is wrong so far; returns what was typed."""


def agreed(options: Mapping[str, str | None], ask: Ask | None) -> Answers:
    """Complete the answers until a configuration can be composed; ask again where they do not fit
    together.

    Args:
        options: Answers given as options, by field; None for one that is not given.
        ask: Asks a question; None without a terminal.

    Raises:
        UserError: An option is invalid, no terminal is there to ask, or the answers stay the same.
    """
    typed_before: dict[str, str] = {}
    trouble = ""
    while True:
        before = dict(typed_before)
        try:
            completed = answers(options, ask, typed_before, trouble)
            checked(completed)
        except UserError as error:
            if ask is None or typed_before == before:
                raise
            trouble = f"{error}\nTry again; Enter keeps your answer.\n"
        else:
            return completed


def answers(
    options: Mapping[str, str | None],
    ask: Ask | None,
    typed_before: dict[str, str] | None = None,
    trouble: str = "",
) -> Answers:
    """Complete the options by asking or, without `ask`, by defaults.

    Args:
        options: Answers given as options, by field; None for one that is not given.
        ask: Asks a question, again and again until the answer is valid; None without a terminal.
        typed_before: Earlier answers, which are offered as defaults; it is updated.
        trouble: Shown before the first question.

    Raises:
        UserError: An option is invalid or does not belong to the other answers. Without `ask` also if
            required ones are missing.
    """
    typed_before = {} if typed_before is None else typed_before
    partial_answers, missing = Answers.model_construct(), []
    for name, field in Answers.model_fields.items():
        text = options.get(name)
        is_required = field.is_required() or (name == "sensors_m" and not partial_answers.housings)
        if belongs := _reason_to_skip(partial_answers, field.metadata):
            if text is not None:
                raise UserError(f"{option(name)}: {belongs}; leave it out")
        elif text is not None:
            if problem := _set_answer(partial_answers, name, text):
                raise UserError(f"{option(name)}: {problem}")
        elif ask is not None:
            default = typed_before.get(name, None if is_required else _offered(field.default))
            while True:
                text = ask(name, default, trouble).strip()
                if text == "" == default or not (trouble := _set_answer(partial_answers, name, text)):
                    break
            trouble, typed_before[name] = "", text
        elif is_required:
            missing.append(option(name))
    if missing:
        raise UserError(f"init: no terminal to ask on; give {', '.join(missing)}")
    return partial_answers


def _offered(default: object) -> str:
    """Return a default as the text to offer, empty without one."""
    return "" if default is None or default == () else str(default)


def _reason_to_skip(partial_answers: Answers, metadata: Sequence[object]) -> str:
    """Return why a question is not asked after the answers so far, empty where it is asked."""
    reasons = (of.reason_to_skip(partial_answers) for of in metadata if isinstance(of, BelongsTo))
    return next(filter(None, reasons), "")


def _set_answer(partial_answers: Answers, name: str, text: str) -> str:
    """Set a field from text; return a sentence on why it is invalid or does not fit, else an empty text."""
    try:
        setattr(partial_answers, name, text)
        _refuse_unfit(partial_answers, name)
    except ValidationError as error:
        problem = error.errors()[0]["msg"].removeprefix("Value error, ")
        return f"{text!r}: {problem[0].lower()}{problem[1:]}"
    except UserError as error:
        return str(error).removeprefix(f"{option(name)}: ")
    return ""


def _refuse_unfit(partial_answers: Answers, name: str) -> None:
    """Raise `UserError` where the answer just given does not fit those before it."""
    places_m = getattr(partial_answers, name) if name in ("stroke_m", "sensors_m") else ()
    if name == "sensors_m" and not places_m and not partial_answers.housings:
        raise UserError("there is no thermocouple yet; give a place on the screw, or name --housings")
    if (beyond_m := max(places_m, default=0.0)) > getattr(partial_answers, "length_m", math.inf):
        raise UserError(
            f"{beyond_m:g} m is beyond the screw's end, at {partial_answers.length_m:g} m; correct one"
        )
    check_wires(partial_answers, name)


def write_new(path: Path, options: Mapping[str, str | None], ask: Ask | None) -> None:
    """Write a configuration by the answers.

    Args:
        path: The file, which must not exist; this is checked before anything is asked.
        options: Answers given as options, by field.
        ask: Asks a question; None without a terminal.

    Raises:
        UserError: The file exists or cannot be written, or an answer is missing or invalid.
    """
    if path.exists():  # before anything is asked
        raise UserError(f"{path}: already exists and is not overwritten; give another file with --output")
    content = checked(agreed(options, ask))
    try:
        path.write_text(content, encoding="utf-8")
    except OSError as error:
        raise UserError(
            f"{path}: cannot be written ({error.strerror}); name another file with --output"
        ) from None


def checked(answers: Answers) -> str:
    """Return the configuration as text, after loading it.

    Raises:
        UserError: The answers do not fit together.
    """
    content = filled(answers)
    parse(tomllib.loads(content), "init")
    return content
