"""Which keys a table of the configuration may have, and which of them a misspelt one was meant to be."""

from __future__ import annotations

import difflib
from collections.abc import Iterator, Sequence
from typing import Any, get_args

from pydantic import BaseModel


def suggestion(key: str, here: Sequence[str], anywhere: Sequence[str]) -> str | None:
    """The key that was probably meant: one of this table, else one of the configuration at all.

    Capitals, a missing or other unit and a beginning count as close: `Length`, `length`, `length_mm`, `temp`.
    """
    return _closest(key.lower()[:80], here) or _closest(key.lower()[:80], anywhere)


def _closest(key: str, known: Sequence[str]) -> str | None:
    by_lower = {name.lower(): name for name in sorted(known, reverse=True)}
    names = sorted(by_lower)
    stem = key.rsplit("_", 1)[0]
    likely = (
        [name for name in names if name == key],
        [name for name in names if name.startswith(f"{key}_")],
        [name for name in names if stem != key and (name == stem or name.startswith(f"{stem}_"))],
        [name for name in names if len(key) >= 3 and name.startswith(key)],
        difflib.get_close_matches(key, names, n=1),
    )
    return next((by_lower[found[0]] for found in likely if found), None)


def keys_at(path: Sequence[int | str], table: Any, model: type[BaseModel]) -> list[str]:
    """The keys that the table at a place may have."""
    models: list[type[BaseModel]] = [model]
    for part in path:
        table = within(table, part)
        fields = [f for m in models for name, f in m.model_fields.items() if (f.alias or name) == part]
        if fields:  # else a number in a list, or a name in a table of tables: the models stay what they are
            models = [m for f in fields for m in _models_in(f.annotation)]
    kind = table.get("kind") if isinstance(table, dict) else None
    kinds = [(m, m.model_fields["kind"]) for m in models if "kind" in m.model_fields]
    chosen = [m for m, field in kinds if kind in get_args(field.annotation)]
    return [f.alias or name for m in chosen or models for name, f in m.model_fields.items()]


def every_key(model: type[BaseModel]) -> list[str]:
    """Every key that a table of the configuration may have, anywhere."""
    seen: dict[type[BaseModel], None] = {}
    waiting = [model]
    while waiting:
        one = waiting.pop()
        if one not in seen:
            seen[one] = None
            waiting += [m for f in one.model_fields.values() for m in _models_in(f.annotation)]
    return sorted({f.alias or name for m in seen for name, f in m.model_fields.items()})


def within(table: Any, part: int | str) -> Any:
    """What stands at a place of a table or list, None where there is none."""
    if isinstance(part, int):
        return table[part] if isinstance(table, list | tuple) and part < len(table) else None
    return table.get(part) if isinstance(table, dict) else None


def _models_in(annotation: Any) -> Iterator[type[BaseModel]]:
    """The tables that a type is made of."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        yield annotation
    for part in get_args(annotation):
        yield from _models_in(part)
