"""Ratios are kept by commit, and a run is compared with the last of them."""

from __future__ import annotations

import io
from pathlib import Path

import pytest
from PIL import Image
from rich.console import Console

from benchmarks import history, picture
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
    assert found.kept_text == f"{before:.3g} × (aaaaaaaaaa)"
    assert ("red" in found.shown) is worse


def test_the_last_kept_of_the_same_work_counts() -> None:
    newer = Kept("2026-11-02", "bbbbbbbbbb", "step", 20.0)
    found, other = compare([step(16.0), latency(1.0)], [OLD, newer])
    assert found.before == newer
    assert found.worse
    assert (other.before, other.kept_text, other.worse) == (None, "", False)


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
        [OLD, Kept("2026-11-01", "aaaaaaaaaa", "latency", 2.0, "less")],
        [step(17.0)],
        "2026-11-03",
        "aaaaaaaaaa",
    )
    assert kept == [
        Kept("2026-11-01", "aaaaaaaaaa", "latency", 2.0, "less"),
        Kept("2026-11-03", "aaaaaaaaaa", "step", 17.0),
    ]  # fmt: skip
    assert merged([OLD], [step(17.0)], "2026-11-03", "b")[0] == OLD


def test_kept_rows_are_read_back(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(history, "_commit", lambda: "cccccccccc")
    path = tmp_path / "benchmarks" / "history.csv"
    assert read(path) == []
    keep([step(16.123456), Result("informs", "1 s"), latency(1.5)], path)
    assert [(k.commit, k.work, k.ratio, k.better) for k in read(path)] == [
        ("cccccccccc", "step", 16.12, "more"), ("cccccccccc", "latency", 1.5, "less"),
    ]  # fmt: skip


def test_the_table_shows_what_was_kept() -> None:
    rows = [step(10.0)]
    out = Console(file=io.StringIO(), width=200)
    out.print(render(rows, "", [each.shown for each in compare(rows, [OLD])]))
    assert "16 × (aaaaaaaaaa)" in out.file.getvalue()  # type: ignore[attr-defined]


def test_every_ratio_kept_in_the_repository_can_be_read() -> None:
    assert all(row.ratio > 0 and row.commit and row.work for row in read())


def test_every_ratio_kept_is_in_the_picture(tmp_path: Path) -> None:
    kept, target = read(), tmp_path / "benchmarks.png"
    drawn = {
        " ".join(panel.get_title().split()): (list(panel.lines[0].get_ydata()), panel.get_ylabel())
        for panel in picture.draw(target=target).axes
    }
    assert drawn == {
        work: ([row.ratio for row in kept if row.work == work], f"ratio, {better} is better")
        for work, better in {row.work: row.better for row in kept}.items()
    }
    with Image.open(target) as image:
        assert image.width == 800


def test_runs_of_one_day_lie_side_by_side(tmp_path: Path) -> None:
    path = tmp_path / "history.csv"
    days = ["2026-11-01", "2026-11-03", "2026-11-03", "2026-11-04"]
    lines = [f"{day},{k:010},step,{k + 1},more" for k, day in enumerate(days)]
    path.write_text("\n".join(["date,commit,work,ratio,better", *lines]), encoding="utf-8")
    (panel,) = picture.draw(path, tmp_path / "benchmarks.png").axes
    x = panel.lines[0].get_xdata()
    assert list(x - x[0]) == [0.0, 1.75, 2.25, 3.0]
    assert list(panel.lines[0].get_ydata()) == [1.0, 2.0, 3.0, 4.0]
