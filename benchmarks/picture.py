"""The ratios kept from run to run, drawn with one panel a benchmark: `make figures`."""

from __future__ import annotations

import math
from collections.abc import Sequence
from datetime import date
from hashlib import sha256
from pathlib import Path
from textwrap import fill

from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from benchmarks.history import PLACE, ROOT, Kept, read

PICTURE = Path("docs/figures/benchmarks.png")
COLUMNS = 4
COLOUR = {"more": "tab:blue", "less": "tab:orange"}


def draw(source: Path = ROOT / PLACE, target: Path = ROOT / PICTURE) -> Figure:
    """Draw a file of ratios. The picture contains the file's digest: an outdated one is recognised."""
    kept = read(source)
    works = list(dict.fromkeys(row.work for row in kept))
    dates = sorted({row.date for row in kept})
    lines = math.ceil(len(works) / COLUMNS)
    figure = Figure(figsize=(10.0, 2.0 * lines), layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.subplots(lines, COLUMNS, squeeze=False).ravel()
    for panel, work in zip(axes, works, strict=False):
        _panel(panel, work, [row for row in kept if row.work == work], dates)
    for panel in axes[len(works) :]:
        panel.remove()
    figure.savefig(target, dpi=80, metadata={"Software": None, "Source": digest(source)})
    return figure


def digest(source: Path) -> str:
    """The SHA-256 of a file of ratios."""
    return sha256(source.read_bytes()).hexdigest()


def _panel(axes: Axes, work: str, rows: Sequence[Kept], dates: Sequence[str]) -> None:
    """Ratio over date, from zero; several runs of one day lie side by side."""
    better = rows[-1].better
    axes.plot(_days(rows), [row.ratio for row in rows], "o-", markersize=4, color=COLOUR[better])
    axes.set_title(fill(work, 32), fontsize=7.5)
    axes.set_ylabel(f"ratio, {better} is better", fontsize=7)
    first, last = (date.fromisoformat(each).toordinal() for each in (dates[0], dates[-1]))
    axes.set_xlim(first - 0.5, last + 0.5)
    axes.set_xticks([first, last], [dates[0], dates[-1]])
    axes.set_ylim(0, 1.15 * max(row.ratio for row in rows))
    axes.tick_params(labelsize=7)
    axes.grid(alpha=0.3)


def _days(rows: Sequence[Kept]) -> list[float]:
    """Each row's day as a number; several runs of a day are spread over it."""
    of_day = [[other for other in rows if other.date == row.date] for row in rows]
    return [
        date.fromisoformat(row.date).toordinal() + (runs.index(row) + 0.5) / len(runs) - 0.5
        for row, runs in zip(rows, of_day, strict=True)
    ]


if __name__ == "__main__":
    draw()
