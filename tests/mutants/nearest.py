"""Which tests stand nearest to a module: what a mutant of it is put to."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).parents[2]


@dataclass(frozen=True, slots=True)
class Nearest:
    """Arguments to pytest; `compiled` where the kernels must run compiled to be through in a minute.

    Interpreted, a kernel takes up to a thousand times as long, but compiling it takes up to a minute and
    each mutant has to be compiled anew: with small tests the interpreter wins.
    """

    tests: tuple[str, ...]
    compiled: bool = False


def _at(*tests: str, compiled: bool = False) -> Nearest:
    return Nearest(tests, compiled)


NEAREST: dict[str, Nearest] = {
    "observer/model/discretise.py": _at("tests/estimators/test_discretise.py"),
    "observer/model/rod/path.py": _at("tests/model/test_path.py"),
    "observer/service/align.py": _at("tests/service/test_align.py", "tests/service/test_can_log.py"),
    "observer/service/evening.py": _at("tests/service/test_evening.py"),
    "observer/service/stuck.py": _at("tests/service/test_align.py"),
    "observer/publish/codec.py": _at("tests/publish/test_codec.py"),
    "observer/discovery/phases.py": _at("tests/discovery/test_phases.py"),
    "observer/discovery/proof.py": _at("tests/discovery/test_verdict.py"),
    "observer/discovery/verdict.py": _at("tests/discovery/test_verdict.py"),
}
