"""Draw the thermal error with an infrared sensor at the screw, as it may be described: `make figures`."""

from __future__ import annotations

from pathlib import Path

from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from observer.report.panels import CATEGORIES
from tests.learning.machines import GRID_M
from tests.learning.pyrometer import EMISSIVITY, EMISSIVITY_SIGMA, ENDS, MIDDLE, estimated, looked_at

HERE = Path(__file__).parent
SEED, NUMBER = 53_000, 0


def draw(target: Path) -> None:
    """What sensor and screw read, and the thermal error at the far end, true and found."""
    one = looked_at(SEED, NUMBER, "a")
    hours, middle = one.day.time_s / 3600.0, len(GRID_M) // 2
    figure = Figure(figsize=(9.6, 3.8), layout="constrained")
    left, right = figure.subplots(1, 2)
    for values, words, colour in (
        (one.day.field_degC[:, middle], "screw at 500 mm", "black"),
        (one.pyrometer_degC, "infrared sensor", CATEGORIES[1]),
        (one.day.air_degC, "air", "0.6"),
    ):
        left.plot(hours, values, color=colour, lw=1.0, label=words)
    left.set_ylabel("°C")
    right.plot(hours, one.day.error_um[:, -1], color="black", lw=1.2, label="true")
    part = one.described(shows_tolerance=EMISSIVITY_SIGMA / EMISSIVITY)
    for found, words, colour in (
        (estimated(one, MIDDLE, one.described(shows=1.0)), "taken for a thermocouple", CATEGORIES[1]),
        (estimated(one, ENDS), "without it", "0.6"),
        (estimated(one, MIDDLE, part), "shows 0.3 ± 0.05, with 95 %", CATEGORIES[0]),
    ):
        right.plot(hours, found.error_um[:, -1], color=colour, lw=1.0, label=words)
    reach_um = 1.96 * found.error_sigma_um[:, -1]
    mean_um = found.error_um[:, -1]
    right.fill_between(hours, mean_um - reach_um, mean_um + reach_um, color=CATEGORIES[0], alpha=0.2, lw=0.0)
    right.set_ylabel("thermal error at 1000 mm, µm")
    for axes in (left, right):
        axes.set_xlabel("hours")
        axes.margins(x=0.0)
        axes.legend(frameon=False, loc="upper left", fontsize=8)
        axes.spines[["top", "right"]].set_visible(False)
    FigureCanvasAgg(figure).print_png(str(target))


if __name__ == "__main__":
    draw(HERE / "pyrometer.png")
