"""What is known of an effect stands in its class, and a constant of nature in one file: nowhere else."""

from __future__ import annotations

import ast
import math
from collections.abc import Iterator
from pathlib import Path

import pytest

from observer import units
from observer.effects.catalogue import KINDS, LIBRARY
from observer.model.cycle import PHASES
from observer.physics import constants

ROOT = Path(__file__).parents[2]
PRODUCT = [p for package in ("observer", "drivers") for p in sorted((ROOT / package).rglob("*.py"))]
OF_EFFECTS = {effect.__module__ for effect in LIBRARY}
ELSEWHERE = [p for p in PRODUCT if not p.is_relative_to(ROOT / "observer" / "effects")]
WORDS = set(KINDS) - set(PHASES)  # a dwell is a phase of a log as well
ABSOLUTE_ZERO = ROOT / "observer" / "tables" / "quantities.py"  # the range of a temperature, not a conversion
SIMULATED = ROOT / "drivers" / "simulated"  # written anew, for it is to test the rest


def parsed(path: Path) -> ast.Module:
    return ast.parse(path.read_text(encoding="utf-8"))


def imported(tree: ast.Module) -> Iterator[str]:
    """Yield modules and names that a file imports, dotted."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            yield str(node.module)
            yield from (f"{node.module}.{alias.name}" for alias in node.names)


def constants_in(tree: ast.Module) -> Iterator[object]:
    """Yield every literal of a file, products and quotients with π as numbers."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Constant):
            yield node.value
        elif isinstance(node, ast.BinOp) and ast.unparse(node).endswith(("pi / 30", "pi / 30.0")):
            yield math.pi / 30


def known_of_effects(tree: ast.Module) -> set[str]:
    """What a file knows of single effects: their modules, and their kinds as words."""
    words = {value for value in constants_in(tree) if isinstance(value, str)}
    return (OF_EFFECTS & set(imported(tree))) | (WORDS & words)


def constants_of_nature(tree: ast.Module) -> set[float]:
    """The constants of nature that a file holds by itself, also in other digits."""
    known = [v for module in (constants, units) for v in vars(module).values() if isinstance(v, float)]
    numbers = {value for value in constants_in(tree) if isinstance(value, float)}
    return {v for v in numbers if any(math.isclose(v, k, rel_tol=2e-3) for k in known)}


def test_nothing_else_knows_an_effect() -> None:
    known = {path: known_of_effects(parsed(path)) for path in ELSEWHERE}
    assert {path: words for path, words in known.items() if words} == {}


def test_a_constant_of_nature_stands_once() -> None:
    held = {p: constants_of_nature(parsed(p)) for p in PRODUCT if not p.is_relative_to(SIMULATED)}
    files = {Path(constants.__file__), Path(units.__file__), ABSOLUTE_ZERO}
    assert {path for path, numbers in held.items() if numbers} == files
    assert held[ABSOLUTE_ZERO] == {units.ZERO_DEGC_K}


@pytest.mark.parametrize(
    "text",
    [
        "from observer.effects.heat import MotorHeat",
        "from observer.effects import heat",
        "import observer.effects.film as film",
        'wanted = kind == "motor_heat"',
        'names = {"radiation": 1}',
    ],
)
def test_what_would_know_an_effect_is_seen(text: str) -> None:
    assert known_of_effects(ast.parse(text))


@pytest.mark.parametrize("text", ["speed_rpm * math.pi / 30", "5.67e-8", "T + 273.15", "g = 9.81"])
def test_a_constant_by_hand_is_seen(text: str) -> None:
    assert constants_of_nature(ast.parse(text))


def test_every_effect_is_described_in_full() -> None:
    for effect in LIBRARY:
        own = effect.model_fields.keys()
        assert effect.parameters.keys() <= own, effect
        assert ("target" in own) == (effect.targets is not None), effect
        for key, known in effect.parameters.items():
            low, high = effect.bounds(key)
            resolved = known.on(1.0)
            assert low <= max(low, resolved.low) < min(high, resolved.high) <= high, key
            assert resolved.scale > 0.0, key
        assert any(p.neutral is not None for p in effect.parameters.values()), effect
