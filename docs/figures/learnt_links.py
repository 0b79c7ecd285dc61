"""Draw what is learnt of links in a day, beside the truth, for docs/evidence/learning.md: `make figures`."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from observer.estimate.pipeline import MachineModel
from observer.report.panels import CATEGORIES
from tests.learning.cover import estimates
from tests.learning.housings import HOUSED_CONFIG, draw_housed
from tests.learning.machines import config_of, day
from tests.truth.machine.housings import CONTACT_W_K, NUT_AIR_W_K

HERE = Path(__file__).parent
SEED, NUMBER, RUN, OFF = 45000, 8, "a", 0.2


def draw(target: Path) -> None:
    """Each link of a machine whose links are 20 % off: as learnt, with 95 %, and as it is."""
    machine, config = draw_housed(SEED, NUMBER, OFF), config_of(HOUSED_CONFIG)
    one = day(machine, SEED, NUMBER, RUN)
    learning = MachineModel.of(config, learns=True).plant.learning
    if learning is None:
        raise RuntimeError("the estimator of this configuration learns nothing")
    found, hours = estimates(config, one), (one.time_s - one.time_s[0]) / 3600.0
    physics = machine.machine.physics
    true = [*(physics.body_W_K / CONTACT_W_K), physics.nut_body_air_W_K / NUT_AIR_W_K]
    figure = Figure(figsize=(8.0, 4.4), layout="constrained")
    panels = figure.subplots(2, 2, sharex=True, sharey=True)
    for axes, link, factor in zip(panels.flat, config.link, true, strict=True):
        at = learning.names.index(f"{link.key}.factor")
        mean, reach = found.learned[:, at], 1.96 * found.learned_sigma[:, at]
        axes.fill_between(hours, mean - reach, mean + reach, color=CATEGORIES[0], alpha=0.2, lw=0.0)
        axes.plot(hours, mean, color=CATEGORIES[0], lw=1.2, label="learnt, with 95 %")
        axes.axhline(factor, color="black", lw=1.2, label="true")
        runs = np.where(one.speed_rpm > 0.0, 0.52, np.nan)
        axes.plot(hours, runs, color="0.5", lw=4.0, solid_capstyle="butt", label="the machine runs")
        axes.set_title(" – ".join(link.between).replace("_", " "), fontsize="medium")
        axes.set_ylim(0.5, 1.6)
        axes.spines[["top", "right"]].set_visible(False)
        axes.margins(x=0.0)
    panels[0, 1].legend(loc="upper right", frameon=False, fontsize="small")
    figure.supxlabel("hours", fontsize="medium")
    figure.supylabel("conductance, of that configured", fontsize="medium")
    FigureCanvasAgg(figure).print_png(str(target))


if __name__ == "__main__":
    draw(HERE / "learnt-links.png")
