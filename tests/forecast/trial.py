"""The campaign of forecasts: rough machines of the independent truth, each forecast cold and warm.

Their work goes on as it was, with the variation that work has. A row is one forecast at one of its moments:
how many of its 95 % intervals hold the truth, how far off it is, and how far "it stays as it is" would be.
Rows that are there already are not run again.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from rich.console import Console

from tests.forecast.days import AT_S, KINDS, Forecast, drawn_day, forecasts
from tests.learning.machines import Day
from tests.resumable import go_on, read_rows, show

FIRST_SEED = 9100
MACHINES = 24
Z95 = 1.96
COLUMNS = (
    "machine", "work", "start", "ahead_min", "covered_field", "covered_error", "rms_K", "stays_K", "sigma_K",
    "rms_um", "stays_um", "sigma_um", "settles_s",
)  # fmt: skip
DOCS = Path(__file__).parents[2] / "docs"
RESULTS, PAGE = DOCS / "forecast" / "results.csv", DOCS / "explanation" / "forecast.md"
MARKS = ("<!-- the campaign's table, written by tests.forecast.trial -->", "<!-- its end -->")


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


def _rms(values: np.ndarray) -> float:  # type: ignore[type-arg]
    return float(np.sqrt(np.mean(values**2)))


def tried(number: int) -> list[dict[str, str]]:
    """One machine's rows."""
    one, rows = drawn_day(FIRST_SEED, number), []
    for start, found in forecasts(one).items():
        for at_s in AT_S:
            settles = "" if found.after_s is None else f"{found.after_s:.0f}"
            cells = (
                str(number), KINDS[number % len(KINDS)], start, f"{at_s / 60:.0f}",
                *(f"{value:.4f}" for value in judged(one, found, at_s)), settles,
            )  # fmt: skip
            rows.append(dict(zip(COLUMNS, cells, strict=True)))
    return rows


def table(rows: list[dict[str, str]]) -> str:
    """The campaign in a table, a line for each moment, and for each kind of work at an hour."""
    lines = [
        "| ahead | work | forecasts | 95 % hold: temperature | thermal error | off, rms | if it stayed | σ "
        "| off, rms | if it stayed | σ |",
        "|---|---|---|---|---|---|---|---|---|---|---|",
    ]
    for minutes, kinds in (*((f"{a / 60:.0f}", KINDS) for a in AT_S), *(("60", (k,)) for k in KINDS)):
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


def main() -> None:
    """Run what is missing, and write the table into the page."""
    done = {int(r["machine"]) for r in read_rows(RESULTS)}
    go_on([i for i in range(MACHINES) if i not in done], tried, RESULTS, Console(stderr=True), workers=1)
    show(PAGE, table(read_rows(RESULTS)), MARKS)


if __name__ == "__main__":
    main()
