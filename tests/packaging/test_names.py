"""One name, one meaning: among the classes of the product, and within each of its modules."""

from __future__ import annotations

import ast
from collections import Counter, defaultdict
from pathlib import Path

ROOT = Path(__file__).parents[2]


def test_no_class_name_has_two_meanings() -> None:
    places = defaultdict(list)
    for package in ("observer", "drivers"):
        for path in sorted((ROOT / package).rglob("*.py")):
            for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
                if isinstance(node, ast.ClassDef):
                    places[node.name].append(str(path.relative_to(ROOT)))
    assert len(places) > 100
    assert {name: where for name, where in places.items() if len(where) > 1} == {}


def test_no_module_binds_a_constant_twice() -> None:
    """The later value would take the place of the earlier one, without a word."""
    twice = {}
    for package in ("observer", "drivers"):
        for path in sorted((ROOT / package).rglob("*.py")):
            names: Counter[str] = Counter()
            for node in ast.parse(path.read_text(encoding="utf-8")).body:
                targets = node.targets if isinstance(node, ast.Assign) else []
                names.update(target.id for target in targets if isinstance(target, ast.Name))
            if again := [name for name, count in names.items() if count > 1]:
                twice[str(path.relative_to(ROOT))] = again
    assert twice == {}
