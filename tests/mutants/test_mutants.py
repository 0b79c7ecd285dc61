"""The mutants listed in the documents have reasons, and the generator of mutants works."""

from __future__ import annotations

from campaigns.mutants import record
from campaigns.mutants.nearest import NEAREST, ROOT
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
