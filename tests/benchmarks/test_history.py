"""Ratios are kept by commit, and a run is compared with the last of them."""

from __future__ import annotations

import io
from pathlib import Path

import pytest
from rich.console import Console

from benchmarks import history
from benchmarks.history import Kept, compare, keep, merged, named, read
from benchmarks.table import Result, judged, render

OLD = Kept("2026-11-01", "aaaaaaaaaa", "step", 16.0)


def step(ratio: float) -> Result:
    return judged("step", "1 µs", "filterpy 20 µs", ratio, at_least=30)


def latency(ratio: float) -> Result:
    return judged("latency", "1 ms", "bare put 0.5 ms", ratio, at_most=2)


@pytest.mark.parametrize(
    ("row", "before", "worse"),
    [
        (step(13.4), 16.0, False),  # 16 / 13.4 = 1.19
        (step(13.3), 16.0, True),
        (step(30.0), 16.0, False),
        (latency(2.3), 2.0, False),
        (latency(2.5), 2.0, True),
        (latency(1.0), 2.0, False),
        (Result("step", "1 µs", "filterpy 20 µs", "1 ×"), 16.0, False),  # it only informs
    ],
)
def test_worse_is_by_more_than_a_fifth_in_its_own_sense(row: Result, before: float, worse: bool) -> None:
    (found,) = compare([row], [Kept("2026-11-01", "aaaaaaaaaa", row.work, before)])
    assert found.worse is worse
    assert found.told == f"{before:.3g} × (aaaaaaaaaa)"
    assert ("red" in found.shown) is worse


def test_the_last_kept_of_the_same_work_counts() -> None:
    newer = Kept("2026-11-02", "bbbbbbbbbb", "step", 20.0)
    found, other = compare([step(16.0), latency(1.0)], [OLD, newer])
    assert found.before == newer
    assert found.worse
    assert (other.before, other.told, other.worse) == (None, "", False)


def test_rows_set_in_are_named_by_the_row_above() -> None:
    rows = [
        Result("a", ""),
        Result("  bare", "", times=1.0, more=False),
        Result("b", ""),
        Result("  bare", ""),
    ]
    assert [row.work for row in named(rows)] == ["a", "a: bare", "b", "b: bare"]
    assert (named(rows)[1].times, named(rows)[1].more) == (1.0, False)


def test_a_commit_measured_again_replaces_itself() -> None:
    kept = merged(
        [OLD, Kept("2026-11-01", "aaaaaaaaaa", "latency", 2.0)], [step(17.0)], "2026-11-03", "aaaaaaaaaa"
    )
    assert kept == [
        Kept("2026-11-01", "aaaaaaaaaa", "latency", 2.0), Kept("2026-11-03", "aaaaaaaaaa", "step", 17.0),
    ]  # fmt: skip
    assert merged([OLD], [step(17.0)], "2026-11-03", "b")[0] == OLD


def test_what_is_kept_is_read_back(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(history, "_commit", lambda: "cccccccccc")
    path = tmp_path / "benchmarks" / "history.csv"
    assert read(path) == []
    keep([step(16.123456), Result("informs", "1 s"), latency(1.5)], path)
    assert [(k.commit, k.work, k.ratio) for k in read(path)] == [
        ("cccccccccc", "step", 16.12), ("cccccccccc", "latency", 1.5),
    ]  # fmt: skip


def test_the_table_shows_what_was_kept() -> None:
    rows = [step(10.0)]
    out = Console(file=io.StringIO(), width=200)
    out.print(render(rows, "", [each.shown for each in compare(rows, [OLD])]))
    assert "16 × (aaaaaaaaaa)" in out.file.getvalue()  # type: ignore[attr-defined]


def test_every_ratio_kept_in_the_repository_can_be_read() -> None:
    assert all(row.ratio > 0 and row.commit and row.work for row in read())
