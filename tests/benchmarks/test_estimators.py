"""The page that shows how to compare an estimator: its ten lines get a row beside the others."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

from benchmarks import estimators
from benchmarks.estimators import main, measured
from tests.docs.console import blocks
from tests.learning.machines import Day, Rough, day, draw

PAGE = Path(__file__).parents[2] / "docs" / "how-to" / "add-an-estimator.md"
ROWS = 1200


@pytest.fixture
def mine(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> str:
    (code,) = (body for _, language, body in blocks(PAGE) if language == "python")
    (tmp_path / "mine.py").write_text(code, encoding="utf-8")
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delitem(sys.modules, "mine", raising=False)
    return "mine:Mine"


@pytest.fixture(scope="module")
def part() -> Day:
    """Twenty minutes of a machine's day."""
    whole = day(draw(1, 0, Rough()), 1, 0, "a")
    return Day(*(column[:ROWS] for column in whole))


def test_the_ten_lines_of_the_page_get_a_row(mine: str, part: Day) -> None:
    found, kalman = measured(mine, [part]), measured("kalman", [part])
    assert found.keys() == kalman.keys()
    for row in (found, kalman):
        assert all(np.isfinite(value) and value > 0.0 for value in row.values())
        assert row["heats_covered"] <= 1.0
    assert found["field_rms"] != kalman["field_rms"]
    # what is off in these machines is far more than the noise: who knows nothing of it is too sure
    assert found["field_covered"] < kalman["field_covered"]


def test_a_class_that_is_not_there_is_a_sentence(
    mine: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(estimators, "OWN", ())  # which come first
    assert main(["--estimator", "mine:Nothing", "--machines", "1"]) == 2
    assert "mine has no class Nothing" in capsys.readouterr().err
