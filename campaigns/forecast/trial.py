"""The campaign of forecasts: rough machines of the independent truth, each forecast cold and warm.

Their work goes on as it was, with the variation that work has. A row is one forecast at one of its moments:
how many of its 95 % intervals hold the truth, how far off it is, and how far "it stays as it is" would be.
Rows that are there already are not run again.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from rich.console import Console

from campaigns.forecast import warming
from campaigns.forecast.days import AT_S, KINDS, Forecast, drawn_day, forecasts, settles_s
from campaigns.resumable import go_on, read_rows, show
from tests.learning.machines import Day

FIRST_SEED = 9700
MACHINES = 96
SETTLING_SEED, SETTLED = 9800, 24
"""Of so many of them it is measured when they settle, by runs of twelve hours."""
Z95 = 1.96
COLUMNS = (
    "machine",
    "work",
    "start",
    "ahead_min",
    "covered_field",
    "covered_error",
    "rms_K",
    "stays_K",
    "sigma_K",
    "rms_um",
    "stays_um",
    "sigma_um",
)
SETTLING = ("machine", "work", "start", "said_s", "from_s", "to_s", "true_s")
DOCS = Path(__file__).parents[2] / "docs"
RESULTS, PAGE = DOCS / "forecast" / "results.csv", DOCS / "evidence" / "forecast.md"
TIMES = DOCS / "forecast" / "settling.csv"
WARMING = DOCS / "forecast" / "warming.csv"
"""28 minutes of a warm-up."""
MARKS = ("<!-- the campaign's table, written by campaigns.forecast.trial -->", "<!-- its end -->")
WARMING_MARKS = ("<!-- a warm-up, written by campaigns.forecast.trial -->", "<!-- end of a warm-up -->")
TIMES_MARKS = ("<!-- when it settles, written by campaigns.forecast.trial -->", "<!-- end of when -->")


def judged(one: Day, found: Forecast, at_s: float) -> tuple[float, ...]:
    """Covered parts of field and error, then rms, that of what stays, and mean σ, in K and in µm."""
    i = int(np.searchsorted(found.said.time_s, at_s - 1e-6))
    row = int(np.searchsorted(one.time_s, one.time_s[found.now] + found.said.time_s[i]))
    off_K, sigma_K = found.said.field_degC[i] - one.field_degC[row], found.said.field_sigma_K[i]
    off_um, sigma_um = (found.said.error_um[i] - one.error_um[row])[1:], found.said.error_sigma_um[i][1:]
    stays_K = found.field_degC - one.field_degC[row]
    stays_um = (found.error_um - one.error_um[row])[1:]
    return (
        float(np.mean(np.abs(off_K) <= Z95 * sigma_K)), float(np.mean(np.abs(off_um) <= Z95 * sigma_um)),
        _rms(off_K), _rms(stays_K), float(sigma_K.mean()),
        _rms(off_um), _rms(stays_um), float(sigma_um.mean()),
    )  # fmt: skip


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2)))


def tried(number: int) -> list[dict[str, str]]:
    """One machine's rows."""
    one, rows = drawn_day(FIRST_SEED, number), []
    for start, found in forecasts(one).items():
        for at_s in AT_S:
            cells = (
                str(number), KINDS[number % len(KINDS)], start, f"{at_s / 60:.0f}",
                *(f"{value:.4f}" for value in judged(one, found, at_s)),
            )  # fmt: skip
            rows.append(dict(zip(COLUMNS, cells, strict=True)))
    return rows


def settled(number: int) -> list[dict[str, str]]:
    """When one machine settles, by the forecast and in truth."""
    one, kind, rows = drawn_day(SETTLING_SEED, number), KINDS[number % len(KINDS)], []
    for start, found in forecasts(one, settles=True).items():
        now_s = float(one.time_s[found.now])
        true_s = settles_s(SETTLING_SEED, number, now_s)
        between = ("", "") if found.between_s is None else _cells(*found.between_s)
        said = _cells(found.after_s)
        cells = (str(number), kind, start, *said, *between, *_cells(true_s))
        rows.append(dict(zip(SETTLING, cells, strict=True)))
    return rows


def _cells(*values: float | None) -> tuple[str, ...]:
    return tuple("" if v is None else f"{v:.0f}" for v in values)


def settling_table(rows: list[dict[str, str]]) -> str:
    """When it settles, by the sort of work: as said, less the truth, in minutes."""
    lines = [
        "| work | forecasts | true, median | off, median | off, rms | 95 % hold | band, median "
        "| none reported |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for kind in (*KINDS, "all"):
        of = [r for r in rows if kind in ("all", r["work"])]
        reported = [r for r in of if r["said_s"]]
        if not reported:
            continue
        said, low, high, true = (
            np.array([float(r[c]) for r in reported]) / 60.0 for c in ("said_s", "from_s", "to_s", "true_s")
        )
        held = 100.0 * float(np.mean((low <= true + 0.5) & (true - 0.5 <= high)))  # to half a minute
        band, silent = np.median(high - low), len(of) - len(reported)
        off = said - true
        lines.append(
            f"| {kind} | {len(of)} | {np.median(true):.0f} min | {np.median(off):+.0f} min "
            f"| {_rms(off):.0f} min | {held:.0f} % | {band:.0f} min | {silent} |"
        )
    return "\n".join(lines)


def table(rows: list[dict[str, str]]) -> str:
    """The campaign in a table, a line for each moment, and for each kind of work at an hour."""
    lines = [
        "| ahead | work | forecasts | 95 % hold: temperature | thermal error | off, rms | if it stayed | σ "
        "| off, rms | if it stayed | σ |",
        "|---|---|---|---|---|---|---|---|---|---|---|",
    ]
    for minutes, kinds in (
        *((f"{a / 60:.0f}", KINDS) for a in AT_S),
        *(("60", (kind,)) for kind in KINDS),
    ):
        here = [r for r in rows if r["ahead_min"] == minutes and r["work"] in kinds]
        if not here:
            continue
        a = {c: np.array([float(r[c]) for r in here]) for c in COLUMNS[4:12]}
        K = [f"{_rms(a['rms_K']):.2f} K", f"{_rms(a['stays_K']):.2f} K", f"{a['sigma_K'].mean():.2f} K"]
        um = [
            f"{_rms(a['rms_um']):.1f} µm",
            f"{_rms(a['stays_um']):.1f} µm",
            f"{a['sigma_um'].mean():.1f} µm",
        ]
        held = [f"{100 * a[c].mean():.0f} %" for c in ("covered_field", "covered_error")]
        work = "all" if len(kinds) > 1 else kinds[0]
        lines.append(f"| {minutes} min | {work} | {len(here)} | {' | '.join([*held, *K, *um])} |")
    return "\n".join(lines)


def warmed(task: tuple[str, int]) -> list[dict[str, str]]:
    """One machine's warm-up, by group and number."""
    return warming.warmed(warming.GROUPS[task[0]].seed, task)


def main() -> None:
    """Run what is missing, and write the tables into the page."""
    console = Console(stderr=True)
    for one, count, path in ((tried, MACHINES, RESULTS), (settled, SETTLED, TIMES)):
        done = {int(r["machine"]) for r in read_rows(path)}
        go_on([i for i in range(count) if i not in done], one, path, console, workers=1)
    warm = {(r["group"], int(r["machine"])) for r in read_rows(WARMING)}
    tasks = [(name, number) for name, group in warming.GROUPS.items() for number in range(group.machines)]
    go_on([task for task in tasks if task not in warm], warmed, WARMING, console, workers=1)
    show(PAGE, warming.table(read_rows(WARMING)), WARMING_MARKS)
    show(PAGE, table(read_rows(RESULTS)), MARKS)
    show(PAGE, settling_table(read_rows(TIMES)), TIMES_MARKS)


if __name__ == "__main__":
    main()
