"""Write fitted values into the text of a configuration, everything else as its author left it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import tomlkit
from tomlkit.items import AoT, Array

from observer.effects.base import EffectTable
from observer.errors import ConfigError
from observer.fit.parameters import rounded


def write_back(text: str, values: Mapping[str, float]) -> str:
    """Return the text with the values of the given keys replaced or added.

    Keys are dotted, a source going by its name. Comments, order and spacing stay. Values are rounded to five
    digits, far below any interval. Raises `ConfigError` for a source that the text does not have.
    """
    document = tomlkit.parse(text)
    for key, value in values.items():
        table, last = _owner(document, key)
        table[last] = rounded(value)
    return tomlkit.dumps(document)


def with_effects(text: str, effects: Sequence[EffectTable]) -> str:
    """Return the text with an `[[effect]]` table more for each effect."""
    if not effects:
        return text
    document = tomlkit.parse(text)
    tables = document.setdefault("effect", tomlkit.aot())
    for effect in effects:
        table = tomlkit.table()
        for key, value in effect.model_dump(exclude_unset=True, exclude_none=True).items():
            table[key] = rounded(value) if isinstance(value, float) else value
        tables.append(table)
    return tomlkit.dumps(document)


def _owner(document: Any, key: str) -> tuple[Any, str]:
    """The table that holds a key, made where it is not there yet, and the key's last part."""
    head, *middle, last = key.split(".")
    section = document.setdefault(head, tomlkit.table())
    if isinstance(section, AoT | Array):
        name = ".".join(middle)
        for entry in section:
            if entry["name"] == name:
                return entry, last
        raise ConfigError(f'{key}: the configuration has no {head} called "{name}"')
    for part in middle:
        section = section.setdefault(part, tomlkit.table())
    return section, last
