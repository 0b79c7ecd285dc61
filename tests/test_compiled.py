"""Compiled code that is kept on disk follows every edit of what it was made from, in whatever file."""

import ast
import os
import subprocess
import sys
from pathlib import Path

import pytest

from observer.compiled import fingerprint

HOUSE = Path(__file__).parents[1]

FILES = {
    "numbers_.py": "FACTOR = 2.0\nSHARES = (1.0, 0.5)\n",
    "records.py": (
        "from typing import NamedTuple\n\n\nclass Pair(NamedTuple):\n    first: object\n    second: object\n"
    ),
    "callee.py": """
import numbers_
from numbers_ import FACTOR
from observer.compiled import inlined, rarely


@inlined
def scaled(x):
    return FACTOR * deeper(x)


@rarely
def deeper(x):
    return x + numbers_.SHARES[1]
""",
    "caller.py": """
import numpy as np
from callee import scaled
from observer.compiled import cached_call, cached_loop
from records import Pair


@cached_loop
def run(pair, out):
    for k in range(len(out)):
        out[k] = scaled(pair.first[k]) - later(pair.second[k])


@cached_call
def later(x):
    return 10.0 * x


out = np.zeros(1)
run(Pair(np.array([3.0]), np.array([0.25])), out)
print(out[0], sum(run.stats.cache_misses.values()))
""",
}


@pytest.fixture
def ran(tmp_path):
    """A program of four files, and how it is run: what it prints, and how often its loop was compiled."""
    for name, text in FILES.items():
        (tmp_path / name).write_text(text)
    environment = os.environ | {
        "PYTHONPATH": f"{tmp_path}{os.pathsep}{HOUSE}",
        "NUMBA_CACHE_DIR": str(tmp_path / "cache"),
        "PYTHONDONTWRITEBYTECODE": "1",  # Python itself tells an edit by the second and the size
    }

    def run() -> tuple[float, int]:
        said = subprocess.run(
            [sys.executable, "caller.py"], cwd=tmp_path, env=environment, check=True, capture_output=True
        ).stdout.split()
        return float(said[0]), int(said[1])

    return run


def edit(path, old, new):
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new))


def test_follows_every_edit_and_compiles_nothing_without_one(ran, tmp_path):
    assert ran() == (2.0 * 3.5 - 2.5, 1)
    assert ran() == (2.0 * 3.5 - 2.5, 0)
    edit(tmp_path / "callee.py", "x + ", "x - ")  # a callee of a callee, in another file
    assert ran() == (2.0 * 2.5 - 2.5, 1)
    edit(tmp_path / "numbers_.py", "FACTOR = 2.0", "FACTOR = 4.0")  # a constant that a callee imports
    assert ran() == (4.0 * 2.5 - 2.5, 1)
    edit(tmp_path / "numbers_.py", "0.5", "1.5")  # one that it reaches through a module
    assert ran() == (4.0 * 1.5 - 2.5, 1)
    edit(tmp_path / "records.py", "first: object\n    second", "second: object\n    first")
    assert ran() == (4.0 * (0.25 - 1.5) - 30.0, 1)
    assert ran() == (4.0 * (0.25 - 1.5) - 30.0, 0)
    for name in ("records.py", "caller.py"):  # a record that is no more, of which the files before still tell
        path = tmp_path / name
        path.write_text(path.read_text().replace("Pair", "Both"))
    assert ran() == (4.0 * (0.25 - 1.5) - 30.0, 1)


def test_a_value_without_a_fingerprint_is_refused():
    with pytest.raises(TypeError, match="no fingerprint"):
        fingerprint(_holds_an_object)


THING = object()


def _holds_an_object():
    return THING


ALLOWED = {
    "numba.core.event",  # tells that something is compiled
    "numba.np.arraymath",  # imported early, for what it takes along
}


def test_one_door_to_the_compiler():
    """No module but one has anything of numba's compiling."""
    inside = []
    for path in sorted([*(HOUSE / "observer").rglob("*.py"), *(HOUSE / "drivers").rglob("*.py")]):
        for node in ast.walk(ast.parse(path.read_text())):
            names = [a.name for a in node.names] if isinstance(node, ast.Import) else []
            if isinstance(node, ast.ImportFrom) and node.module:
                names = [f"{node.module}.{a.name}" for a in node.names]
            used = [n for n in names if n.partition(".")[0] == "numba" and n not in ALLOWED]
            if used and path != HOUSE / "observer" / "compiled.py":
                inside.append((str(path.relative_to(HOUSE)), used))
    assert inside == []
