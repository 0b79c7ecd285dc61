"""Draw how far the thermal error is off without a probe, with one, and with a scale: `make figures`."""

from __future__ import annotations

from pathlib import Path

from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from observer.report.panels import CATEGORIES
from tests.learning.housings import HOUSED_CONFIG
from tests.learning.probing import PROBE, SCALE, estimates, probed, scaled_log
from tests.truth.machine.machine import stream

HERE = Path(__file__).parent
SEED, NUMBER = 9400, 0


def draw(target: Path) -> None:
    """How far the thermal error at the far end is off, of a machine with sensors on nut and housings."""
    one = probed(SEED, NUMBER, "a", housed=True)
    scaled = scaled_log(one.day, stream(SEED, "scale", str(NUMBER)))
    figure = Figure(figsize=(9.6, 3.8), layout="constrained")
    panels = figure.subplots(1, 3, sharey=True)
    hours = one.day.time_s / 3600.0
    for axes, title, log, text in (
        (panels[0], "thermocouples on nut and housings", one.log, HOUSED_CONFIG),
        (panels[1], "… and a probing cycle an hour", one.log, HOUSED_CONFIG + PROBE),
        (panels[2], "… and a scale beside the axis", scaled, HOUSED_CONFIG + SCALE),
    ):
        found = estimates(log, text)
        off_um = found.error_um[:, -1] - one.day.error_um[:, -1]
        reach_um = 1.96 * found.error_sigma_um[:, -1]
        axes.fill_between(hours, off_um - reach_um, off_um + reach_um, color=CATEGORIES[0], alpha=0.2, lw=0.0)
        axes.plot(hours, off_um, color=CATEGORIES[0], lw=1.0, label="found less true, with 95 %")
        axes.axhline(0.0, color="black", lw=0.8)
        axes.set_title(title, fontsize=9)
        axes.set_xlabel("hours")
        axes.margins(x=0.0)
        axes.spines[["top", "right"]].set_visible(False)
    for at_s in one.cycles_s:
        panels[1].axvline(at_s / 3600.0, color="0.6", lw=0.8, ls=":")
    panels[0].set_ylabel("thermal error at 1000 mm: off by, µm")
    panels[0].legend(frameon=False, loc="upper left", fontsize=8)
    FigureCanvasAgg(figure).print_png(str(target))


if __name__ == "__main__":
    draw(HERE / "probing.png")
