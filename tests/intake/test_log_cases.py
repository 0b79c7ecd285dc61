"""Files as recorders write them give the values that they hold, or a question; never something else."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from observer.errors import LogError
from observer.library.given import recorded
from tests.intake.rod import import_file, rod

FOLDER = Path(__file__).parents[1] / "data" / "log-cases"
CASES: list[dict[str, Any]] = json.loads((FOLDER / "expected.json").read_text(encoding="utf-8"))


def name_of(case: dict[str, Any]) -> str:
    return "-".join([case["file"], *case.get("log", {})])


def configured(folder: Path, case: dict[str, Any]):
    channels = case.get("values", {"t1_degC": 0}) | case.get("words", {})
    sensors = case.get("sensors", 2 if "t2_degC" in channels or "t2_degC" in case.get("columns", {}) else 1)
    return rod(folder, case.get("log", {}), case.get("columns", {}), sensors)


@pytest.mark.parametrize("case", [c for c in CASES if "refused" not in c and "asked" not in c], ids=name_of)
def test_a_recorders_file_gives_the_values_that_it_holds(tmp_path, case):
    log = recorded(FOLDER / case["file"], configured(tmp_path, case))
    if "rows" in case:
        assert len(log) == case["rows"]
    if "first_s" in case:
        assert log.time_s[0] == pytest.approx(case["first_s"], abs=1e-3)
    if "apart_s" in case:
        np.testing.assert_allclose(np.diff(log.time_s), case["apart_s"], atol=1e-4)
    for channel, value in case.get("values", {}).items():
        assert log[channel][np.isfinite(log[channel])][0] == pytest.approx(value, abs=1e-4)
    counts = {
        words.column: sum(w.cells for w in log.words if w.column == words.column) for words in log.words
    }
    assert counts == case.get("words", {})
    for words in case.get("doubts", []):
        assert any(words in doubt for doubt in log.doubts), log.doubts
    if case.get("doubts") == []:
        assert log.doubts == ()


@pytest.mark.parametrize("case", [c for c in CASES if "refused" in c], ids=name_of)
def test_a_file_that_is_not_understood_is_refused_with_the_key_that_settles_it(tmp_path, case):
    with pytest.raises(LogError) as caught:
        recorded(FOLDER / case["file"], configured(tmp_path, case))
    for words in case["refused"]:
        assert words in str(caught.value)


@pytest.mark.parametrize("case", [c for c in CASES if "refused" in c or "asked" in c], ids=name_of)
def test_import_writes_nothing_where_a_file_is_not_understood(tmp_path, case):
    out = tmp_path / "log.parquet"
    with pytest.raises(LogError) as caught:
        import_file(FOLDER / case["file"], configured(tmp_path, case)).write(out)
    for words in case.get("refused") or case["asked"]:
        assert words in str(caught.value)
    assert not out.exists()
