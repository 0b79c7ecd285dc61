"""The figures of docs/limits.md are those of the campaigns' rows in docs/."""

from __future__ import annotations

import csv
from collections.abc import Callable, Iterable
from pathlib import Path
from statistics import mean

import pytest

DOCS = Path(__file__).parents[2] / "docs"
PAGE = (DOCS / "limits.md").read_text(encoding="utf-8")
Row = dict[str, str]
GROUPS = {
    "five along the screw": "rough",
    "the same, after a calibration": "rough, calibrated",
    "nut and both housings": "rough, on housings",
    "the same, links 20 % off": "the same, links 20 % off",
}


def _rows(name: str) -> list[Row]:
    with (DOCS / name).open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def _mean_and_worst(rows: Iterable[Row], column: str, digits: int) -> str:
    values = [float(row[column]) for row in rows]
    return f"{mean(values):.{digits}f} ({max(values):.{digits}f})"


@pytest.mark.parametrize("words", GROUPS)
def test_what_a_set_of_sensors_reaches(words: str) -> None:
    """Mean over the machines and, in brackets, the worst one; then the share of 95 % intervals that hold."""
    rows = [r for r in _rows("learning/results.csv") if r["group"] == GROUPS[words] and r["learns"] == "yes"]
    of: Callable[[str], list[Row]] = lambda quantity: [r for r in rows if r["quantity"] == quantity]  # noqa: E731
    cells = [
        words,
        str(len(of("error"))),
        _mean_and_worst(of("error"), "rms", 1),
        _mean_and_worst(of("field"), "rms", 1),
        _mean_and_worst(of("nut"), "rms", 1),
        f"{100 * mean(float(r['covered']) for r in of('error')):.0f} %",
    ]
    assert f"| {' | '.join(cells)} |" in PAGE


def test_the_first_hour_as_init_configures_it() -> None:
    rows = [r for r in _rows("first-day/results.csv") if r["shift_h"] == "1"]
    figures = [_mean_and_worst(rows, "rms_um", 1), f"{mean(abs(float(r['last_um'])) for r in rows):.0f} µm"]
    assert all(figure in PAGE for figure in figures), figures


@pytest.mark.parametrize("ahead_min", [10, 30, 60])
def test_how_far_a_forecast_is_off(ahead_min: int) -> None:
    rows = [r for r in _rows("forecast/results.csv") if float(r["ahead_min"]) == ahead_min]
    off, stays = (mean(float(r[c]) ** 2 for r in rows) ** 0.5 for c in ("rms_um", "stays_um"))
    assert f"| {ahead_min} min | {off:.1f} | {stays:.1f} |" in PAGE


@pytest.mark.parametrize("name", ["results", "typical", "housings"])
def test_how_many_hidden_effects_are_found(name: str) -> None:
    """A case counts once, by its last run; effects outside the library are none that could be named."""
    last = {r["name"]: r for r in _rows(f"campaign/{name}.csv")}.values()
    hidden = [r for r in last if r["hidden"] and r["group"] not in {"outside", "absent"}]
    right = sum(r["outcome"] == "right" for r in hidden)
    wrong = sum(r["outcome"] in ("wrong", "wrong_set", "extra") for r in last)
    assert f"| {right} of {len(hidden)} | {wrong} of {len(last)} |" in PAGE
