"""One name, one meaning: among the classes of the product, and within each of its modules."""

from __future__ import annotations

import ast
from collections import Counter, defaultdict
from functools import cache
from pathlib import Path

ROOT = Path(__file__).parents[2]


@cache
def parsed() -> dict[str, ast.Module]:
    """Every file of the product."""
    paths = [p for package in ("observer", "drivers") for p in sorted((ROOT / package).rglob("*.py"))]
    return {str(p.relative_to(ROOT)): ast.parse(p.read_text(encoding="utf-8")) for p in paths}


def test_no_class_name_has_two_meanings() -> None:
    places = defaultdict(list)
    for path, tree in parsed().items():
        for node in ast.walk(tree):
            if isinstance(node, ast.ClassDef):
                places[node.name].append(path)
    assert len(places) > 100
    assert {name: where for name, where in places.items() if len(where) > 1} == {}


def test_no_module_binds_a_constant_twice() -> None:
    """The later value would take the place of the earlier one, without a word."""
    twice = {}
    for path, tree in parsed().items():
        names: Counter[str] = Counter()
        for node in tree.body:
            targets = node.targets if isinstance(node, ast.Assign) else []
            names.update(target.id for target in targets if isinstance(target, ast.Name))
        if again := [name for name, count in names.items() if count > 1]:
            twice[path] = again
    assert twice == {}
