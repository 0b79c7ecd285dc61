"""Judges a result of the workflow by what was hidden."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from tests.truth.machine.effects import LIBRARY
from tests.truth.machine.entries import Entry

Name = tuple[str, str | None]
"""An effect's kind and target."""

WRONG = ("wrong", "extra", "wrong_set", "failed")
"""Outcomes that claim what is not so, or nothing at all: see `outcome_of`."""

SCALES = {"position_m": 1.0, "from_m": 1.0, "to_m": 1.0, "inlet_degC": 20.0}
"""What an error of a place (the screw's length) or of a temperature (a usual rise) is measured by.

Any other parameter's error is measured by its true value.
"""


@dataclass(frozen=True)
class Estimate:
    """One parameter that was found: its relative error, and whether the interval holds the truth."""

    key: str
    error: float
    covered: bool


def hidden_names(entry: Entry) -> frozenset[Name]:
    """The names a search can find: what is hidden and in its library."""
    return frozenset(
        (e.kind, e.target) for e in entry.case.effects if e.kind in LIBRARY and e.kind not in entry.without
    )


def found_names(result: Mapping[str, Any]) -> frozenset[Name]:
    """The effects that a result names."""
    return frozenset((e["kind"], e.get("target")) for e in result["effects"])


def outcome_of(entry: Entry, result: Mapping[str, Any]) -> str:
    """What a result amounts to.

    right: names all that is hidden and no more; partly: some of it and no more; extra: all of it and more;
    wrong: something that is not hidden; in_set, wrong_set: doubts among names with or without the true one;
    none, unknown, not_identifiable as the verdict says, where nothing is claimed besides.
    """
    hidden, found, verdict = hidden_names(entry), found_names(result), str(result["verdict"])
    one_physics = entry.doubt is not None and entry.doubt.same
    alike = [frozenset({name}) for name in entry.doubt.alike] if entry.doubt and one_physics else []
    if verdict == "ambiguous":
        listed = any(_same(names, each) for names in result["alternatives"] for each in (hidden, *alike))
        return "in_set" if hidden and listed else "wrong_set"
    if verdict == "named" and found in alike:
        return "right"
    if verdict == "named" or (verdict == "unknown" and found):
        if not found <= hidden:
            return "extra" if hidden and hidden < found else "wrong"
        return "right" if found == hidden and verdict == "named" else "partly"
    return verdict


def _same(names: Sequence[str | Mapping[str, Any]], hidden: frozenset[Name]) -> bool:
    """Whether the names of one alternative are those hidden; a name without target fits any."""
    given = sorted((_name_of(n) for n in names), key=str)
    true = sorted(hidden, key=str)
    return len(given) == len(true) and all(
        kind == true_kind and target in (None, true_target)
        for (kind, target), (true_kind, true_target) in zip(given, true, strict=True)
    )


def _name_of(name: str | Mapping[str, Any]) -> Name:
    """Read "kind", "kind at target" or {"kind": …, "target": …}."""
    if isinstance(name, Mapping):
        return name["kind"], name.get("target")
    kind, _, target = name.partition(" at ")
    return kind, target or None


def is_good(entry: Entry, outcome: str) -> bool:
    """Whether an outcome is what an honest and able search answers."""
    doubt = entry.doubt
    match entry.group:
        case "null":
            good = ["none"]
        case "faulty" | "typical" | "minutes" | "gain" | "torque" | "air" if not entry.case.effects:
            good = ["none"]
        case "one log" if not entry.case.effects:
            good = ["none", "not_identifiable"]
        case "housings":
            good = ["right", "in_set", "unknown"] if entry.case.effects else ["none"]
        case "outside" | "absent":
            good = ["unknown"]
        case "ambiguous":
            nameable = doubt is not None and (doubt.same or doubt.distinguishable)
            good = ["in_set", "not_identifiable", *(["right"] if nameable else [])]
        case "poor":
            unseen = doubt is not None and doubt.unseen
            good = ["right", "in_set", "not_identifiable", *(["none"] if unseen else [])]
        case _:
            good = ["right", "in_set"]
    return outcome in good


def estimates(entry: Entry, result: Mapping[str, Any]) -> list[Estimate]:
    """Errors of the parameters of the effects that are named rightly."""
    found = {(e["kind"], e.get("target")): e["parameters"] for e in result["effects"]}
    return [
        _estimate(f"{effect.kind}.{key}", key, true, found[effect.kind, effect.target][key])
        for effect in entry.case.effects
        if (effect.kind, effect.target) in found
        for key, true in effect.parameters.items()
        if key in found[effect.kind, effect.target]
    ]


def _estimate(name: str, key: str, true: float, given: Mapping[str, Any]) -> Estimate:
    low, high = given["ci95"]
    error = (given["value"] - true) / SCALES.get(key, abs(true))
    return Estimate(name, error, low <= true <= high)


def is_localised(result: Mapping[str, Any], sensors: Sequence[str], phases: Sequence[str]) -> bool:
    """Whether the place named first is one of the sensors and phases where the hidden thing shows most."""
    if not result["where"]:
        return False
    first = result["where"][0]
    return first["sensor"] in sensors and first["phase"] in phases
