"""Draw the nut's heat beside a coolant that drifts, its inlet measured or constant: `make figures`."""

from __future__ import annotations

from pathlib import Path

from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from observer.report.panels import CATEGORIES
from tests.learning.cooled import CONSTANT, MEASURED, cooled, estimates

HERE = Path(__file__).parent
SEED, NUMBER = 56_000, 0


def draw(target: Path) -> None:
    """The inlet above the heat that is found, beside the true one."""
    one = cooled(SEED, NUMBER, "a")
    hours = one.day.time_s / 3600.0
    figure = Figure(figsize=(8.0, 4.6), layout="constrained")
    above, below = figure.subplots(2, 1, sharex=True, height_ratios=(1.0, 2.0))
    above.plot(hours, one.inlet_degC, color="0.3", lw=0.8)
    above.set_ylabel("inlet, °C")
    below.plot(hours, one.day.heat_W[:, 0], color="black", lw=1.2, label="true")
    for inlet, words, colour in (
        (CONSTANT, "inlet taken as 20 °C", CATEGORIES[1]),
        (MEASURED, "inlet measured", CATEGORIES[0]),
    ):
        below.plot(hours, estimates(one.log, inlet).heat_W[:, 0], color=colour, lw=1.0, label=words)
    below.set_xlabel("hours")
    below.set_ylabel("heat of the nut, W")
    below.legend(frameon=False, loc="upper left")
    for axes in (above, below):
        axes.margins(x=0.0)
        axes.spines[["top", "right"]].set_visible(False)
    FigureCanvasAgg(figure).print_png(str(target))


if __name__ == "__main__":
    draw(HERE / "coolant.png")
