"""The problems of a configuration: one sentence for each, likely typos first."""

from __future__ import annotations

import contextlib
import difflib
import re
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, get_args

from pydantic import BaseModel, ValidationError
from pydantic_core import ErrorDetails

from drivers import DRIVER_KINDS
from drivers.protocol import UNION_TAGS
from observer.config.effects.catalogue import KINDS
from observer.config.outside import entry_names, is_outside, outside
from observer.errors import SeveralError
from observer.files.toml_slips import truth, without_quotes
from observer.installation.typed import key_name
from observer.installation.typical_ranges import hint

Path = tuple[int | str, ...]
_MOST_LISTED = 40
_KEY = "[key]"  # the end of pydantic's location when the name of a table is wrong


def problems_of(table: dict[str, Any], model: type[BaseModel]) -> list[str]:
    """Return every problem of a table as “key: what is wrong; remedy”, at most 40; empty for a valid one.

    Misspelt keys come first. A missing key is left out where a misspelt one probably means it.

    Args:
        table: The content of a file.
        model: The class that validates it.
    """
    try:
        model.model_validate(table)
        return []
    except ValidationError as error:
        errors = [(_path(e["loc"], table), e) for e in _without_consequences(error.errors(include_url=False))]
    unknown = [path for path, e in errors if e["type"] == "extra_forbidden"]
    meant = {path: _meant_key(path, table, model) for path in unknown[:_MOST_LISTED]}
    suggested = {(*path[:-1], key) for path, key in meant.items() if key is not None}
    typos = [
        (path, f"unknown key{_question(meant.get(path))}; remove it or correct its name") for path in unknown
    ]
    others = [
        (path, words)
        for path, e in errors
        if e["type"] != "extra_forbidden" and not (e["type"] == "missing" and path in suggested)
        for words in _sentences(e, path)
    ]
    problems = dict.fromkeys(typos + others)
    lines = [_line(path, words, table) for path, words in [*problems][:_MOST_LISTED]]
    remaining = len(problems) - len(lines)
    return [*lines, f"and {remaining} more; fix these first"] if remaining > 0 else lines


def _sentences(detail: ErrorDetails, path: Path) -> Sequence[str]:
    """Return an error of pydantic in words; a check of several keys may find several problems."""
    cause = detail.get("ctx", {}).get("error")
    return cause.problems if isinstance(cause, SeveralError) else [_words(detail, path)]


def as_message(place: str, problems: Sequence[str]) -> str:
    """Return one sentence for one problem, a list with their number for several.

    Args:
        place: The file.
        problems: At least one, each with its key.
    """
    if len(problems) == 1:
        return f"{place}: {problems[0]}"
    return f"{place}: {len(problems)} problems\n" + "\n".join(f"  {p}" for p in problems)


def _without_consequences(errors: Sequence[ErrorDetails]) -> list[ErrorDetails]:
    """Return the errors without those on too few entries that come only from another wrong entry."""
    return [
        e
        for e in errors
        if e["type"] != "too_short"
        or not any(o is not e and o["loc"][: len(e["loc"])] == e["loc"] for o in errors)
    ]


def _words(detail: ErrorDetails, path: Path) -> str:
    """Return the problem and its remedy, without the key."""
    kind, value, message = detail["type"], detail["input"], detail["msg"].removeprefix("Value error, ")
    if kind == "value_error":
        return message + hint(path, value)
    if kind == "missing":
        return "is missing; add it"
    message = f"{message[0].lower()}{message[1:]}"
    if detail["loc"] and detail["loc"][-1] == _KEY:
        message = f"the name {shown(path[-1])} is not valid ({message}); change it"
    elif kind.startswith("union_tag"):
        named = value.get("kind") if isinstance(value, dict) else None
        stated = "kind is missing" if named is None else f"unknown kind {shown(named)}"
        group, built_in = ("effects", KINDS) if path[0] == "effect" else ("drivers", DRIVER_KINDS)
        message = f"{stated}; give one of {', '.join((*built_in, *entry_names(group), 'module:Class'))}"
    elif kind in {"model_type", "model_attributes_type", "dict_type"}:
        message = f"must be a table, not {shown(value)}; write [{key_of(path, {})}] and its keys below"
    elif kind in {"too_short", "too_long"} and isinstance(value, list | tuple | dict):
        limit = int(detail["ctx"].get("min_length") or detail["ctx"].get("max_length") or 0)
        comparison = "at least" if kind == "too_short" else "at most"
        message = (
            f"has {len(value)} entries where {comparison} {limit} are expected; {_shorter(value, limit)}"
        )
    elif kind in {"list_type", "tuple_type"} and isinstance(value, dict):
        message = f"there may be several of this table; write [[{key_of(path, {})}]], in two brackets"
    elif isinstance(value, int | float | str | bool):
        message = f"{message}, not {shown(value)}{_meant(detail, path) or hint(path, value)}"
    return message


def _shorter(entries: Sequence[object] | Mapping[str, object], limit: int) -> str:
    """Return a remedy for a list of the wrong length; twice the length hints at decimal commas."""
    if len(entries) != 2 * limit or not all(type(part) is int for part in entries):
        return "change the list"
    pairs = zip(*[iter(entries)] * 2, strict=True)
    return f"with decimal points write [{', '.join(f'{whole}.{part}' for whole, part in pairs)}]"


def _meant(detail: ErrorDetails, path: Path) -> str:
    """Return “; write …” with the number, truth or choice that was probably meant, else an empty text."""
    kind, value, key = detail["type"], detail["input"], str(path[-1]) if path else ""
    meant = ""
    if kind.startswith(("float_", "int_", "decimal_")) and isinstance(value, str):
        meant = without_quotes(key, value) or "the number alone, without quotes"
    elif kind.startswith("bool_"):
        meant = truth(str(value)) or {"1": "true", "0": "false"}.get(str(value), "true or false")
    elif kind in ("list_type", "tuple_type") and isinstance(value, str):
        meant = f'["{value}"], in square brackets'
    elif kind == "string_type":
        meant = f'"{value}", in quotes'
    elif kind == "string_pattern_mismatch" and key in ("name", "axis"):
        with contextlib.suppress(ValueError):
            meant = f'"{key_name(str(value))}": letters, digits, _ . and - are allowed'
    elif kind == "literal_error":
        meant = _choice(key, str(value), str(detail["ctx"]["expected"]))
    return f"; write {meant}" if meant else ""


def _choice(key: str, written: str, expected: str) -> str:
    """Return the choice that a word, or a Modbus function code, probably stands for; empty without a near
    one.
    """
    if key == "function" and (code := written.lstrip("0")) in ("3", "4"):
        return '"holding", which is function 3' if code == "3" else '"input", which is function 4'
    if key == "byte_order" and written in ("big", "little"):
        return f'word_order = "{written}", or byte_order = "{"CDAB" if written == "little" else "ABCD"}"'
    choices = re.findall(r"'([^']*)'", expected)
    by_lower = {choice.lower(): choice for choice in choices}
    word = {"real": "float32", "float": "float32", "int": "int16", "word": "uint16", "dint": "int32"}.get(
        written.lower(), written.lower()
    )
    close = difflib.get_close_matches(word, list(by_lower), n=1)
    return f'"{by_lower[close[0]]}"' if close else ""


def shown(value: object) -> str:
    """Return a value as it was written, cut to 60 characters."""
    try:
        text = repr(value)
    except (ValueError, RecursionError):  # a number of thousands of digits, tables in tables
        return "that"
    return text if len(text) <= 60 else f"{text[:57]}…"


def _line(path: Path, words: str, table: dict[str, Any]) -> str:
    key = key_of(path, table)
    return f"{key}: {words}" if key else words


def _path(location: Sequence[int | str], table: Any) -> Path:
    """Return a place in the file, without the parts that pydantic inserts: kinds and `[key]`."""
    parts: list[int | str] = []
    for part in location:
        inserted = (*UNION_TAGS, table.get("kind") if isinstance(table, dict) else None)
        is_key = isinstance(table, dict) and part in table
        if part == _KEY or (isinstance(part, str) and part in inserted and not is_key):
            continue
        parts.append(part)
        table = entry_at(table, part)
    return tuple(parts)


def key_of(path: Path, table: object) -> str:
    """Return the dotted key of a place; list entries go by their name where they have one.

    Args:
        path: Keys and indices from the root.
        table: The root, or anything without entries to go by indices.
    """
    parts: list[str] = []
    for part in path:
        table = entry_at(table, part)
        if isinstance(part, str):
            parts.append(_readable(part))
            continue
        name = table.get("name") if isinstance(table, dict) else None
        is_readable = isinstance(name, str) and _readable(name) == name
        parts[-1:] = [f'{parts[-1]} "{name}"' if is_readable else f"{parts[-1]}[{part}]"]
    return ".".join(parts)


def _readable(name: str) -> str:
    return name if name.isprintable() and len(name) <= 64 else shown(name)


def entry_at(table: Any, part: int | str) -> Any:
    """Return the value at a key of a table or an index of a list; None without one."""
    if isinstance(part, int):
        return table[part] if isinstance(table, list | tuple) and part < len(table) else None
    return table.get(part) if isinstance(table, dict) else None


def _question(key: str | None) -> str:
    return f" (did you mean {key}?)" if key else ""


def _meant_key(path: Path, table: Any, model: type[BaseModel]) -> str | None:
    """Return the valid key nearest to an unknown one, None without a near one."""
    *place, key = path
    return _closest(str(key).lower()[:80], _keys_at(place, table, model))


def _closest(key: str, keys: Sequence[str]) -> str | None:
    """Return the valid key that a misspelt one in lower case probably means, None without a near one.

    Capitals, a missing or other unit and a beginning count as close: `Length`, `length`, `length_mm`, `temp`.
    """
    by_lower = {name.lower(): name for name in sorted(keys, reverse=True)}
    names = sorted(by_lower)
    stem = key.rsplit("_", 1)[0]
    likely = (
        [name for name in names if name == key],
        [name for name in names if name.startswith(f"{key}_")],
        [name for name in names if stem != key and (name == stem or name.startswith(f"{stem}_"))],
        [name for name in names if len(key) >= 3 and name.startswith(key)],
        difflib.get_close_matches(key, names, n=1),
    )
    return next((by_lower[matches[0]] for matches in likely if matches), None)


def _keys_at(path: Sequence[int | str], table: Any, model: type[BaseModel]) -> list[str]:
    """Return the valid keys of the table at a place."""
    models: list[type[BaseModel]] = [model]
    for part in path:
        table = entry_at(table, part)
        fields = [f for m in models for name, f in m.model_fields.items() if (f.alias or name) == part]
        if fields:  # else an index of a list or a name in a table of tables, which has the same models
            models = [m for f in fields for m in _models_in(f.annotation)]
    kind = table.get("kind") if isinstance(table, dict) else None
    group = {"effect": "effects", "outlets": "outlets"}.get(str(path[0]) if path else "", "drivers")
    if outside_model := _model_outside(kind, group):
        models = [outside_model]
    kinds = [(m, m.model_fields["kind"]) for m in models if "kind" in m.model_fields]
    chosen = [m for m, field in kinds if kind in get_args(field.annotation)]
    return [f.alias or name for m in chosen or models for name, f in m.model_fields.items()]


def _model_outside(kind: object, group: str) -> type[BaseModel] | None:
    """Return the model from outside with this `kind`, None without one."""
    try:
        model = outside(kind, group) if is_outside(kind, group) else None
    except ValueError:  # reported where the table was validated
        return None
    return model if isinstance(model, type) and issubclass(model, BaseModel) else None


def _models_in(annotation: Any) -> Iterator[type[BaseModel]]:
    """Yield the models within a type annotation."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        yield annotation
    for part in get_args(annotation):
        yield from _models_in(part)
