"""Draw what a bed that expands too does to the thermal error: `make figures`."""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

import observer
from observer.frames import FloatArray

HERE = Path(__file__).parent
RIG = HERE.parents[1] / "tests" / "data" / "rig"
BED = '\n[bed]\nexpansion_1_K = 10e-6\nchannel = "bed_degC"\n'
WARMER_K = 2.0
"""By how much the bed warms during the log, evenly: the sun on it, or the hall's heating."""


def errors_um() -> tuple[FloatArray, dict[str, FloatArray]]:
    """Return the hours of the rig's log, and the error at the screw's far end: of the screw alone, and
    against a bed of cast iron that warms meanwhile.
    """
    log = observer.read_log(RIG / "run_c.csv.gz")
    since_s = log.time_s - log.time_s[0]
    columns = {"time_s": log.time_s, **{name: log[name] for name in log.channels}}
    columns["bed_degC"] = columns["ambient_degC"][0] + WARMER_K * since_s / since_s[-1]
    found = {}
    with tempfile.TemporaryDirectory() as folder:
        for name, bed in (("the screw alone", ""), ("against the bed", BED)):
            config = Path(folder) / "machine.toml"
            config.write_text((RIG / "config.toml").read_text() + bed)
            estimates = observer.load(config).replay(columns)
            found[name] = np.asarray(estimates["error_1000_um"])
    return np.asarray(estimates.time_s - estimates.time_s[0]) / 3600.0, found


def draw_bed(target: Path) -> None:
    """Draw both over the hours."""
    hours, found = errors_um()
    picture = Figure(figsize=(8.0, 3.6), layout="constrained")
    FigureCanvasAgg(picture)
    axes = picture.subplots()
    for (name, error_um), colour in zip(found.items(), ("#0072b2", "#d55e00"), strict=True):
        axes.plot(hours, error_um, color=colour)
        axes.annotate(
            name,
            (hours[-1], error_um[-1]),
            xytext=(4, 0),
            textcoords="offset points",
            va="center",
            color=colour,
        )
    axes.set(xlabel="hours", ylabel="thermal error at 1000 mm, µm", xlim=(0.0, 1.22 * hours[-1]))
    axes.spines[["top", "right"]].set_visible(False)
    picture.savefig(target, dpi=110)


if __name__ == "__main__":
    draw_bed(HERE / "bed.png")
