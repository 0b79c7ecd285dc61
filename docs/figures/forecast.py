"""Draw what 28 minutes of a warm-up say of the next hours, beside what came: `make figures`."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from campaigns.forecast import warming
from campaigns.forecast.trial import WARMING_SEED
from observer.report.panels import CATEGORIES
from tests.learning.machines import draw as draw_machine
from tests.truth.machine.cycles import STEP_s

HERE = Path(__file__).parent
NUMBER, HOURS = 0, 4.0
PANELS = {
    "rough": "as its configuration says",
    "sensors compared, calibrated the day before": "sensors compared, and calibrated the day before",
}
"""The same machine, and what is known of it."""


def draw(target: Path) -> None:
    """The thermal error at the far end: the truth, and with 95 % what log and live state say of it."""
    figure = Figure(figsize=(9.0, 3.8), layout="constrained")
    for axes, (group, title) in zip(figure.subplots(1, 2, sharey=True), PANELS.items(), strict=True):
        draw_one(axes, group)
        axes.set_title(title, fontsize="medium")
    figure.axes[0].set_ylabel("thermal error at 1000 mm, µm")
    figure.axes[0].legend(loc="lower right", frameon=False, fontsize="small")
    FigureCanvasAgg(figure).print_png(str(target))


def draw_one(axes: Axes, name: str) -> None:
    """What is forecast of the machine of one group."""
    group = warming.GROUPS[name]
    one = draw_machine(WARMING_SEED, NUMBER, group.rough)
    whole, live, now_s = warming.forecasts(group, one, WARMING_SEED, NUMBER, HOURS)
    true_um = warming.path(one, WARMING_SEED, NUMBER, now_s)[1][:, -1]
    begin_s = warming.REST_S
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
    axes.margins(x=0.0)
    axes.spines[["top", "right"]].set_visible(False)


if __name__ == "__main__":
    draw(HERE / "forecast-warm-up.png")
