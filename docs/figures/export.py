"""Draw how far the exported observer is from the service's on the shipped rig: `make figures`."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from observer.align.aligner import AlignPlan
from observer.estimate.pipeline import MachineModel
from observer.estimate.replay import estimates_of
from observer.export.data import observer_form
from observer.export.reference import run, sampled
from observer.files.logs import read_log
from observer.frames import EstimateBlock
from observer.installation import load
from observer.report.panels import CATEGORIES

HERE = Path(__file__).parent
RIG = HERE.parents[1] / "tests" / "data" / "rig"
PLACE_M, HEAT = 0.8, 0


def draw(target: Path) -> None:
    """Thermal error at the end of the travel and heat of the nut by both, and their difference."""
    config = load(RIG / "config.toml")
    log = read_log(RIG / "run_c.csv.gz", config.channels)
    samples = sampled(log, config.channels, config.estimator.period_s)
    reduced = run(observer_form(config), samples)
    machine = MachineModel.of(config, learns=True)
    parts = estimates_of(log, AlignPlan.of(config), machine.pipeline(), lambda _done, _total: None)
    whole = EstimateBlock.joined([block for _, block in parts])

    at = int(np.argmin(np.abs(machine.plant.layout.position_m - PLACE_M)))
    figure = Figure(figsize=(8.0, 5.0), layout="constrained")
    error, heat = figure.subplots(2, 1, sharex=True)
    drawn = (
        (error, "thermal error at 800 mm, µm", whole.error_um[:, at], reduced["error_um"][:, at]),
        (heat, "heat of the nut, W", whole.heat_W[:, HEAT], reduced["heat_W"][:, HEAT]),
    )
    for panel, label, service, exported in drawn:
        panel.plot(whole.time_s / 60.0, service, color=CATEGORIES[0], label="service")
        panel.plot(samples.time_s / 60.0, exported, color=CATEGORIES[1], lw=0.8, label="exported")
        panel.set_ylabel(label)
        panel.margins(x=0.0)
        for side in ("top", "right"):
            panel.spines[side].set_visible(False)
    error.legend(frameon=False)
    heat.set_xlabel("time, min")
    FigureCanvasAgg(figure).print_png(str(target))


if __name__ == "__main__":
    draw(HERE / "export.png")
