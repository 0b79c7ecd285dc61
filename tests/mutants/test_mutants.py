"""The mutants listed in the documents have reasons, and the generator of mutants works."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from campaigns.mutants import record
from campaigns.mutants.nearest import NEAREST, ROOT
from campaigns.mutants.record import Count, Results, Survivor
from tests.bits.cases import CASES

FEW = 0.10
"""Part of the mutants tried that may survive."""


def test_every_module_and_its_nearest_tests_exist() -> None:
    for module, nearest in NEAREST.items():
        assert (ROOT / module).is_file(), module
        for test in nearest.tests:
            if test.startswith("tests/"):
                assert (ROOT / test.split("::")[0]).exists(), test
            if test.endswith("]"):
                assert test.split("[")[1].removesuffix("]") in CASES, test


def test_every_survivor_has_its_reason() -> None:
    unexplained = [s for s in record.survivors() if s.reason in ("", record.WITHOUT_REASON)]
    assert not unexplained


def test_what_survivors_change_is_still_in_the_code() -> None:
    """Else the list is of another program: run `make mutants` again."""
    for survivor in record.survivors():
        code = " ".join((ROOT / survivor.module).read_text(encoding="utf-8").split())
        assert " ".join(survivor.diff.split(" → ")[0].split()) in code, survivor


def test_few_survive_and_the_tables_agree() -> None:
    counted, listed = record.counts(), record.survivors()
    assert sum(c.survived for c in counted) <= FEW * sum(c.tried for c in counted)
    for count in counted:
        assert sum(s.module == count.module for s in listed) == count.survived, count.module


def test_the_page_shows_the_tables() -> None:
    shown = record.PAGE.read_text(encoding="utf-8").split(record.MARK)[1]
    assert shown == record.page_end(record.counts())


def test_a_stopped_run_continues(tmp_path: Path) -> None:
    results = Results(tmp_path / "results.jsonl")
    assert results.survived("module", "digest", "AddNot", 3) is None
    results.add("module", "digest", "AddNot", 3, survived=True)
    results.add("module", "digest", "AddNot", 4, survived=False)
    again = Results(tmp_path / "results.jsonl")
    assert again.survived("module", "digest", "AddNot", 3) is True
    assert again.survived("module", "digest", "AddNot", 4) is False
    assert again.survived("module", "other digest", "AddNot", 3) is None, "the module has changed since"


def test_reasons_outlive_a_run_and_other_modules_are_left() -> None:
    old = [
        Survivor("a.py", 3, "AddNot", "x → y", "equivalent"),
        Survivor("a.py", 4, "AddNot", "gone → killed since", "equivalent"),
        Survivor("b.py", 1, "AddNot", "x → y", "of another module"),
    ]
    found = [replace(old[0], line=9, reason="–"), Survivor("a.py", 1, "AddNot", "new → newer", "–")]
    merged = record.merged(found, old, {"a.py"})
    assert [(s.module, s.line, s.reason) for s in merged] == [
        ("a.py", 1, "–"), ("a.py", 9, "equivalent"), ("b.py", 1, "of another module"),
    ]  # fmt: skip


def test_the_page_counts_together() -> None:
    end = record.page_end([Count("a.py", 50, 30, 1), Count("b.py", 20, 10, 0)])
    assert end == "\n40 mutants of 2 modules were tried; 1 survived, 2.5 %.\n"


SOURCE = '''
from dataclasses import dataclass

@dataclass(frozen=True)
class Box:
    length_m: float = 2.0

def area(width_m: float | None, box: Box) -> float | None:
    """1 + 1."""
    for a, b in zip([1], [2], strict=True):
        if width_m is not None and a < b:
            return width_m * box.length_m
    return None
'''


def test_mutants_change_what_the_code_does_and_nothing_else() -> None:
    pytest.importorskip("cosmic_ray")
    from campaigns.mutants.mutate import change, mutants_of, mutated

    made = [(m, mutated(SOURCE, m)) for m in mutants_of("box.py", SOURCE)]
    changes = {change(SOURCE, source) for _, source in made}
    assert "return width_m * box.length_m → return width_m / box.length_m" in changes
    assert "if width_m is not None and a < b: → if width_m is not None and a <= b:" in changes
    assert "if width_m is not None and a < b: → if width_m is not None or a < b:" in changes
    assert any(c.startswith("length_m: float = 2.0 →") for c in changes)
    unread = ("@dataclass", "def area", "1 + 1")
    assert not [c for c in changes if c.startswith(unread) or "strict=False" in c]
    for mutant, source in made:
        assert SOURCE.splitlines()[mutant.line - 1] != source.splitlines()[mutant.line - 1]


def test_a_sample_is_drawn_by_its_seed() -> None:
    pytest.importorskip("cosmic_ray")
    from campaigns.mutants.mutate import mutants_of, sample

    every = list(mutants_of("box.py", SOURCE))
    assert sample(every, 5, 1) == sample(every, 5, 1) != sample(every, 5, 2)
    assert len(set(sample(every, 5, 1))) == 5
    assert set(sample(every, 1000, 1)) == set(every)
