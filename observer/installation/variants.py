"""Variants of a configuration: a file of named overrides by dotted path, each checked as a configuration is.

[inputs]                            # what lasts in every variant, unless it says otherwise
ambient_degC = 20.0

[variant."two fixed ends"]
supports.mounting = "L-III"         # entries of lists go by their names: source.nut.torque_Nm
without = ["sensor.t3"]             # taken away before anything is put

[sweep.speed]                       # a list of values makes a variant of each, several make a grid
inputs.screw_speed_rpm = [500, 1000, 1500]
"""

from __future__ import annotations

import copy
import itertools
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from observer.errors import ConfigError, meant
from observer.installation import Installation, parse
from observer.model.settle import check_inputs

MOST_VARIANTS = 50
"""More cannot be read side by side."""
_TABLES = ("inputs", "variant", "sweep")
_INPUTS, _WITHOUT = "inputs", "without"
_NAMES = {"effect": "kind", "link": "between"}
"""What an entry of a list goes by; all others have a name."""


@dataclass(frozen=True, slots=True)
class Variant:
    """A variant of a configuration.

    Attributes:
        name: As in the file, or made of a sweep's values.
        config: The configuration with the overrides.
        inputs: Constant values by input channel, in the channel's unit.
        changed: The dotted keys that it overrides or removes.
    """

    name: str
    config: Installation
    inputs: Mapping[str, float]
    changed: tuple[str, ...]


def variants_of(table: Mapping[str, Any], place: str, base: Mapping[str, Any]) -> tuple[Variant, ...]:
    """Return the variants in a table, in its order, sweeps last; at most 50.

    Args:
        table: The content of a variants' file.
        place: The file, named in errors.
        base: The table of the configuration that they override.

    Raises:
        ConfigError: The table is empty or invalid, or a variant is; the sentence names variant, key and
            remedy.
    """
    for key in table:
        if key not in _TABLES:
            raise ConfigError(
                f'{place}: "{key}" is not a table of a variants file; give inputs, variant or sweep'
            )
    named = list(_named(table, place))
    if not named:
        raise ConfigError(f"{place}: nothing to compare; give a table [variant.NAME] or [sweep.NAME]")
    if len(named) > MOST_VARIANTS:
        raise ConfigError(
            f"{place}: {len(named)} variants are more than the {MOST_VARIANTS} that can be compared at once; "
            "shorten a sweep"
        )
    common = _table(table.get(_INPUTS, {}), f"{place}: {_INPUTS}")
    variants = tuple(_variant(name, overrides, base, common, place) for name, overrides in named)
    for name in (v.name for v in variants):
        if sum(v.name == name for v in variants) > 1:
            raise ConfigError(f'{place}: two variants are called "{name}"; give each its own name')
    return variants


def _named(table: Mapping[str, Any], place: str) -> Iterator[tuple[str, Mapping[str, Any]]]:
    """Yield each variant's name and overrides; a sweep's variants are named by their values."""
    for name, named_table in _table(table.get("variant", {}), f"{place}: variant").items():
        yield name, _table(named_table, f'{place}: variant "{name}"')
    for name, named_table in _table(table.get("sweep", {}), f"{place}: sweep").items():
        sweep_place = f'{place}: sweep "{name}"'
        swept = list(_leaves(_table(named_table, sweep_place)))
        if not swept:
            raise ConfigError(
                f"{sweep_place}: sweeps nothing; give a key a list of values, or remove the table"
            )
        for path, values in swept:
            if not isinstance(values, list) or not values:
                raise ConfigError(
                    f"{sweep_place}: {'.'.join(path)}: give a list of values, one for each variant"
                )
        for values in itertools.product(*(values for _, values in swept)):
            named = [f"{path[-1]} {_short(v)}" for (path, _), v in zip(swept, values, strict=True)]
            words = f"{name}: {', '.join(named)}" if len(named) > 1 else f"{name} {_short(values[0])}"
            yield words, _nested([p for p, _ in swept], values)


def _short(value: Any) -> str:
    return f"{value:g}" if isinstance(value, float) else str(value)


def _table(value: Any, place: str) -> Mapping[str, Any]:
    if not isinstance(value, Mapping):
        raise ConfigError(f"{place}: is not a table; write its keys below it, as in supports.gap_m = 1e-5")
    return value


def _leaves(table: Mapping[str, Any], path: tuple[str, ...] = ()) -> Iterator[tuple[tuple[str, ...], Any]]:
    for key, value in table.items():
        if isinstance(value, Mapping):
            yield from _leaves(value, (*path, key))
        else:
            yield (*path, key), value


def _nested(paths: list[tuple[str, ...]], values: tuple[Any, ...]) -> dict[str, Any]:
    table: dict[str, Any] = {}
    for (*owners, last), value in zip(paths, values, strict=True):
        owner = table
        for key in owners:
            owner = owner.setdefault(key, {})
        owner[last] = value
    return table


def _variant(
    name: str, own_table: Mapping[str, Any], base: Mapping[str, Any], common: Mapping[str, Any], place: str
) -> Variant:
    """Return a variant: `base` without the removed keys, with the overrides of `own_table`.

    `common` inputs hold unless the variant has its own. Raises `ConfigError`, which names `place` and
    variant.
    """
    variant_place = f'{place}: variant "{name}"'
    overrides = {key: value for key, value in own_table.items() if key not in (_INPUTS, _WITHOUT)}
    table = copy.deepcopy(dict(base))
    without = own_table.get(_WITHOUT, [])
    if not isinstance(without, list) or not all(isinstance(path, str) for path in without):
        raise ConfigError(f'{variant_place}: {_WITHOUT}: give a list of keys, as ["sensor.t3", "supports"]')
    for path in without:
        _remove(table, path, variant_place)
    _apply_overrides(table, overrides, variant_place)
    config = parse(table, variant_place)
    inputs = dict(common) | dict(_table(own_table.get(_INPUTS, {}), f"{variant_place}: {_INPUTS}"))
    check_inputs(config, inputs, f"{variant_place}: {_INPUTS}")
    changed = (*without, *(".".join(path) for path, _ in _leaves(own_table) if path[0] != _WITHOUT))
    return Variant(name, config, {c: float(v) for c, v in inputs.items()}, changed)


def _apply_overrides(table: dict[str, Any], overrides: Mapping[str, Any], place: str) -> None:
    """Apply overrides to a configuration's table; entries of lists of tables are addressed by their names."""
    for key, value in overrides.items():
        current = table.get(key)
        if isinstance(value, Mapping) and (_is_list(current) or key in ("effect", "sensor", "node", "link")):
            entries = table.setdefault(key, [])
            for name, entry_overrides in value.items():
                _override_entry(entries, key, name, _table(entry_overrides, f"{place}: {key}.{name}"), place)
        elif isinstance(value, Mapping) and isinstance(current, dict):
            _apply_overrides(current, value, place)
        else:
            table[key] = value


def _is_list(value: Any) -> bool:
    return isinstance(value, list) and all(isinstance(entry, dict) for entry in value)


def _entry_name(key: str, entry: Mapping[str, Any]) -> str:
    """Return the name of a list's entry; a link's has both its ends."""
    name = entry.get(_NAMES.get(key, "name"), "")
    return " - ".join(map(str, name)) if isinstance(name, list) else str(name)


def _override_entry(
    entries: list[Any], key: str, name: str, overrides: Mapping[str, Any], place: str
) -> None:
    """Override the named entry, or add an entry that gives its own name. Raises `ConfigError` for an
    unknown one.
    """
    matching = [entry for entry in entries if _entry_name(key, entry) == name]
    if not matching and _entry_name(key, overrides) == name:
        entries.append(dict(overrides))
        return
    if not matching:
        raise ConfigError(
            f"{place}: {key}.{name}: {_unknown(entries, key, name)}; a new one gives its name too"
        )
    for entry in matching:
        _apply_overrides(entry, overrides, place)


def _unknown(entries: list[Any], key: str, name: str) -> str:
    names = [_entry_name(key, entry) for entry in entries]
    return f'no {key} is called "{name}"{meant(name, names)}; there are {", ".join(names) or "none"}'


def _remove(table: dict[str, Any], path: str, place: str) -> None:
    """Remove a key, a table or an entry. Raises `ConfigError` where it does not exist."""
    owner: Any = table
    parts = path.split(".")
    for i, part in enumerate(parts):
        if isinstance(owner, dict) and _is_list(owner.get(part)) and i + 1 < len(parts):
            entries, name = owner[part], ".".join(parts[i + 1 :])
            whole = [entry for entry in entries if _entry_name(part, entry) == name]
            if whole:
                owner[part] = [entry for entry in entries if entry not in whole]
                return
            entry = next((e for e in entries if _entry_name(part, e) == parts[i + 1]), None)
            if entry is None:
                raise ConfigError(f"{place}: {_WITHOUT}: {path}: {_unknown(entries, part, name)}")
            _remove(entry, ".".join(parts[i + 2 :]), place)
            return
        if not isinstance(owner, dict) or part not in owner:
            raise ConfigError(
                f'{place}: {_WITHOUT}: the configuration does not give "{path}"; remove it here'
            )
        if i + 1 == len(parts):
            del owner[part]
            return
        owner = owner[part]
