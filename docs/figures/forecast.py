"""Draw what 28 minutes of a warm-up say of the next hours, beside what came: `make figures`."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from campaigns.forecast import warming
from observer.report.panels import CATEGORIES
from tests.learning.machines import draw as draw_machine
from tests.truth.machine.cycles import STEP_s

HERE = Path(__file__).parent
GROUP, NUMBER, HOURS = "rough", 0, 4.0


def draw(target: Path) -> None:
    """The thermal error at the far end: the truth, and with 95 % what log and live state say of it."""
    group = warming.GROUPS[GROUP]
    one = draw_machine(group.seed, NUMBER, group.rough)
    whole, live, now_s = warming.forecasts(group, one, group.seed, NUMBER, HOURS)
    true_um = warming.path(one, group.seed, NUMBER, now_s)[1][:, -1]
    begin_s = warming.REST_S
    figure = Figure(figsize=(8.0, 3.8), layout="constrained")
    axes = figure.subplots()
    for found, words, colour in (
        (live, "from the live state", CATEGORIES[1]),
        (whole, "from the log", CATEGORIES[0]),
    ):
        hours = (now_s - begin_s + found.ahead.time_s) / 3600.0
        mean, reach = found.ahead.error_um[:, -1], 1.96 * found.ahead.error_sigma_um[:, -1]
        axes.fill_between(hours, mean - reach, mean + reach, color=colour, alpha=0.2, lw=0.0)
        axes.plot(hours, mean, color=colour, lw=1.2, label=f"forecast {words}, with 95 %")
    shown = round((now_s + 3600.0 * HOURS) / STEP_s)
    axes.plot(
        (np.arange(shown) * STEP_s - begin_s) / 3600.0, true_um[:shown], color="black", lw=1.2, label="true"
    )
    axes.axvline((now_s - begin_s) / 3600.0, color="0.4", lw=0.8)
    axes.set_xlabel("hours of running")
    axes.set_ylabel("thermal error at 1000 mm, µm")
    axes.margins(x=0.0)
    axes.legend(loc="lower right", frameon=False)
    axes.spines[["top", "right"]].set_visible(False)
    FigureCanvasAgg(figure).print_png(str(target))


if __name__ == "__main__":
    draw(HERE / "forecast-warm-up.png")
