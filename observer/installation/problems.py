"""What is wrong with a configuration, all of it at once: one sentence for each problem, likely typos first.

Checks of a table as a whole begin only when each of its keys is right by itself. So what is misspelt or out
of its range is mended as it was probably meant, and looked at again, for as long as that brings up more.
"""

from __future__ import annotations

import copy
import functools
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

from pydantic import BaseModel, ValidationError
from pydantic_core import ErrorDetails

from drivers import DRIVER_KINDS
from drivers.protocol import UNION_TAGS
from observer.effects.catalogue import KINDS
from observer.errors import SeveralError
from observer.installation.known_keys import every_key, keys_at, suggestion, within
from observer.installation.slips import hint, meant

Path = tuple[int | str, ...]
_PASSES = 4
_MOST_NAMED = 40
_SOME_CHANNEL = "some_channel"
_KEY = "[key]"  # what pydantic ends a place with when the name of a table is wrong


@dataclass
class _Found:
    """Problems by place and words, and the tables in which something was mended by guess."""

    typos: dict[tuple[Path, str], None] = field(default_factory=dict)
    others: dict[tuple[Path, str], None] = field(default_factory=dict)
    mended: set[Path] = field(default_factory=set)
    explained: set[Path] = field(default_factory=set)


def problems_of(table: dict[str, Any], model: type[BaseModel]) -> list[str]:
    """Every problem of a table as “key: what is wrong; remedy”; empty where the model accepts it."""
    found, first = _Found(), table
    for number in range(_PASSES):
        try:
            model.model_validate(table)
            break
        except ValidationError as error:
            before = len(found.typos) + len(found.others)
            errors, table = error.errors(include_url=False), copy.deepcopy(table)
            for detail in sorted(_not_said_twice(errors), key=lambda e: e["type"] != "extra_forbidden"):
                _note(found, detail, table, model, again=number > 0)
            if len(found.typos) + len(found.others) == before:
                break
    every = [*found.typos, *found.others]
    lines = [_line(path, words, first) for path, words in every[:_MOST_NAMED]]
    left = len(every) - len(lines)
    return [*lines, f"and {left} more; mend these first"] if left > 0 else lines


def as_message(place: str, problems: Sequence[str]) -> str:
    """One sentence for one problem, a list for several."""
    if len(problems) == 1:
        return f"{place}: {problems[0]}"
    return f"{place}: {len(problems)} problems\n" + "\n".join(f"  {p}" for p in problems)


def _note(
    found: _Found, detail: ErrorDetails, table: dict[str, Any], model: type[BaseModel], *, again: bool
) -> None:
    """Note one error of pydantic's, and mend the table where what was meant is likely."""
    path = _path(detail["loc"], table)
    if detail["type"] == "extra_forbidden":
        close = suggestion(str(path[-1]), keys_at(path[:-1], table, model), every_key(model))
        remedy = f"unknown key{f' (did you mean {close}?)' if close else ''}; remove it or mend its name"
        found.typos[path, remedy] = None
        _rename(table, path, close)
        if close:
            found.explained.add((*path[:-1], close))
        elif path[:-1]:
            found.mended.add(path[:-1])
        return
    if path in found.explained:  # put there by guess, or taken away for another problem
        if detail["type"] != "missing":
            _put(table, path, _likely(path, detail["input"]))
        return
    if again and (path in found.mended or path[:-1] in found.mended):
        return  # follows from what was mended here by guess
    error = detail.get("ctx", {}).get("error")
    for words in error.problems if isinstance(error, SeveralError) else [_words(detail, path)]:
        found.others[path, words] = None
    if path and detail["type"] != "missing" and not isinstance(detail["input"], dict):
        _put(table, path, _likely(path, detail["input"]))
        found.explained.add(path)
        found.mended |= {path[:-1]} - {()}


def _not_said_twice(errors: Sequence[ErrorDetails]) -> list[ErrorDetails]:
    """The errors without those that count too few entries because an entry is wrong by itself."""
    return [
        e
        for e in errors
        if e["type"] != "too_short"
        or not any(o is not e and o["loc"][: len(e["loc"])] == e["loc"] for o in errors)
    ]


def _words(detail: ErrorDetails, path: Path) -> str:
    """What is wrong, in words."""
    kind, given, message = detail["type"], detail["input"], detail["msg"].removeprefix("Value error, ")
    if kind == "value_error":
        return message + hint(path, given)
    if kind == "missing":
        return "is missing; add it"
    message = f"{message[0].lower()}{message[1:]}"
    if detail["loc"] and detail["loc"][-1] == _KEY:
        message = f"the name {shown(path[-1])} will not do ({message}); mend it"
    elif kind.startswith("union_tag"):
        named = given.get("kind") if isinstance(given, dict) else None
        stated = "kind is missing" if named is None else f"unknown kind {shown(named)}"
        kinds = KINDS if path[0] == "effect" else (*DRIVER_KINDS, "module:Class")
        message = f"{stated}; give one of {', '.join(kinds)}"
    elif kind in {"model_type", "model_attributes_type", "dict_type"}:
        message = f"is to be a table, not {shown(given)}; write [{key_of(path, {})}] and its keys below"
    elif kind in {"too_short", "too_long"} and isinstance(given, list | tuple | dict):
        limit = detail["ctx"].get("min_length", detail["ctx"].get("max_length"))
        least = "at least" if kind == "too_short" else "at most"
        message = f"has {len(given)} entries where {least} {limit} are to stand; mend it"
    elif isinstance(given, int | float | str | bool):
        message = f"{message}, not {shown(given)}{hint(path, given)}"
    return message


def shown(value: object) -> str:
    """A value as it was written, cut short where it is long."""
    try:
        text = repr(value)
    except (ValueError, RecursionError):  # a number of thousands of digits, tables in tables
        return "that"
    return text if len(text) <= 60 else f"{text[:57]}…"


def _line(path: Path, words: str, table: dict[str, Any]) -> str:
    key = key_of(path, table)
    return f"{key}: {words}" if key else words


def _path(location: Sequence[int | str], table: Any) -> Path:
    """A place in the file, without what pydantic inserts: kinds of drivers and effects, and `[key]`."""
    parts: list[int | str] = []
    for part in location:
        inserted = (*UNION_TAGS, table.get("kind") if isinstance(table, dict) else None)
        there = isinstance(table, dict) and part in table
        if part == _KEY or (isinstance(part, str) and part in inserted and not there):
            continue
        parts.append(part)
        table = within(table, part)
    return tuple(parts)


def key_of(path: Path, table: object) -> str:
    """Return the dotted key of a place; list entries go by their name where they have one."""
    parts: list[str] = []
    for part in path:
        table = within(table, part)
        if isinstance(part, str):
            parts.append(_readable(part))
            continue
        name = table.get("name") if isinstance(table, dict) else None
        known = isinstance(name, str) and _readable(name) == name
        parts[-1:] = [f'{parts[-1]} "{name}"' if known else f"{parts[-1]}[{part}]"]
    return ".".join(parts)


def _readable(name: str) -> str:
    return name if name.isprintable() and len(name) <= 64 else shown(name)


def _holder(table: Any, path: Path) -> Any:
    """The table or list in which a place is."""
    return functools.reduce(within, path[:-1], table)


def _rename(table: Any, path: Path, new: str | None) -> None:
    """Give an unknown key the name that was probably meant; without one, remove it."""
    table = _holder(table, path)
    if isinstance(table, dict):
        value = table.pop(path[-1], None)
        if new is not None:
            table.setdefault(new, value)


def _likely(path: Path, value: object) -> float | str | None:
    """What may stand in for a wrong value while the rest is looked at."""
    a_channel = isinstance(value, str) and str(path[-1]).endswith("channel")
    return _SOME_CHANNEL if a_channel else meant(path, value)


def _put(table: Any, path: Path, value: float | str | None) -> None:
    """Put in what was probably meant; without that, remove the value, so that its default holds."""
    table = _holder(table, path)
    if isinstance(table, dict):
        table.pop(path[-1], None)
        if value is not None:
            table[path[-1]] = value
    elif isinstance(table, list) and isinstance(path[-1], int) and value is not None:
        table[path[-1]] = value
