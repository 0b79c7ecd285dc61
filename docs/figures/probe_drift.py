"""Draw the figure of docs/explanation/probe-drift.md: `make figures`."""

from __future__ import annotations

import sys
from pathlib import Path

from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

HERE = Path(__file__).parent
sys.path[:0] = [str(HERE.parents[1]), str(HERE.parent / "examples")]

from probe_drift import drift  # noqa: E402

RUNS = HERE.parents[1] / "tests" / "data" / "probe-drift"


def draw() -> Figure:
    """Every run with what is predicted of it from half time on, and 95 %."""
    figure = Figure(figsize=(13, 5.6), layout="constrained")
    FigureCanvasAgg(figure)
    panels = figure.subplots(2, 4, sharex=True)
    for axes, path in zip(panels.flat, sorted(RUNS.glob("*.json.gz")), strict=True):
        one = drift(path)
        late, minutes = one.time_s > 0.5 * one.time_s[-1], one.time_s / 60.0
        low, high = (one.predicted_um + sign * 1.96 * one.sigma_um for sign in (-1.0, 1.0))
        axes.fill_between(
            minutes[late], low[late], high[late], color="#2f6db5", alpha=0.18, lw=0, label="95 %"
        )
        axes.plot(minutes[late], one.predicted_um[late], color="#2f6db5", lw=1.6, label="predicted")
        axes.plot(minutes, one.probe_um, color="#20242a", lw=1.0, label="measured")
        axes.axvline(minutes[late][0], color="#8a9099", lw=0.8, ls=(0, (3, 3)))
        axes.set_title(path.name.split(".")[0], fontsize=10)
    for axes in panels[1]:
        axes.set_xlabel("time, min")
    for axes in panels[:, 0]:
        axes.set_ylabel("probe, µm")
    panels[0, 0].legend(frameon=False, fontsize=8, loc="lower right")
    return figure


if __name__ == "__main__":
    draw().savefig(HERE / "probe-drift.png", dpi=110)
