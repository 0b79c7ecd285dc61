"""Draw what a search says of displacements, on a machine of the independent truth: `make figures`."""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

import observer
from observer.installation import write_back

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE.parents[1]))
from tests.discovery.grown import Moved, write_grown  # noqa: E402
from tests.truth.machine.generate import Case  # noqa: E402

PROBE = "probe_900_um"
EXPANSION = "screw.expansion_1_K"


def draw_displacement(target: Path) -> None:
    """A screw that expands 15 % more than configured: its probe in the log that was held back, and what the
    temperatures make of it with the coefficient as configured and as found.
    """
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        logs = write_grown(Case("grown", seed=5), Moved(expansion=0.15), folder / "logs")
        config = folder / "logs" / "config.toml"
        found = observer.load(config).discover([observer.read_log(log) for log in logs]).document
        (cause,) = found["displacements"]["causes"]
        values = {key: entry["value"] for key, entry in found["calibrated"].items()}
        log, lines = observer.read_log(logs[-1]), {}
        for words, more in (("as configured", {}), ("as found", {EXPANSION: cause["value"]})):
            config.write_text(write_back(config.read_text(), values | more))
            lines[f"predicted, {words}"] = np.asarray(observer.load(config).simulate(log)[PROBE])
    hours, measured = (log.time_s - log.time_s[0]) / 3600.0, np.asarray(log[PROBE])
    there = np.isfinite(measured)
    measured = measured - np.nanmean(measured[:60])  # from where the probe was set to zero
    figure = Figure(figsize=(9.0, 3.6), layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.subplots()
    axes.plot(hours[there], measured[there], ".", ms=3, color="0.6", label="measured")
    for line, colour in zip(lines.items(), ("#d55e00", "#0072b2"), strict=True):
        axes.plot(hours, line[1] - line[1][:60].mean(), color=colour, label=line[0])
    axes.set(xlabel="time, h", ylabel="displacement at 900 mm, µm", title="The log that was held back")
    axes.legend()
    figure.savefig(target, dpi=100)


if __name__ == "__main__":
    draw_displacement(HERE / "displacement-found.png")
