"""Draw what a screw without its sections gets wrong, and the heats of two nuts: `make figures`."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE.parents[1]))

from tests.reference.service_path import open_loop, replay  # noqa: E402
from tests.reference.stepped_cases import Slides, SLIDES_AIR_degC, two_slides, with_true_heats  # noqa: E402

BLUE, ORANGE, GREEN = "#0072b2", "#d55e00", "#009e73"
SEED = 5


def draw_profiles(field: Axes, error: Axes, this: Slides) -> None:
    """Temperature and thermal error at the end of the run: truth, and both models with the true heats."""
    config, last = with_true_heats(this), int(this.turns.sum()) - 1
    uniform = config.model_copy(update={"screw": config.screw.model_copy(update={"section": ()})})
    x_mm = np.linspace(0.0, 1000.0 * config.screw.length_m, 21)
    for axes, true, label in (
        (field, this.field_degC, "temperature, °C"),
        (error, this.error_um, "thermal error, µm"),
    ):
        axes.plot(x_mm, true, "o", ms=4, color="black", label="truth: finite volumes")
        axes.set(xlabel="position, mm", ylabel=label)
    for own, colour, name in ((config, BLUE, "with its sections"), (uniform, ORANGE, "as if uniform")):
        plant, rows = open_loop(own, this.log, SLIDES_AIR_degC)
        field.plot(x_mm, rows[last, plant.rows.field_slice], color=colour, label=name)
        error.plot(x_mm, rows[last, plant.rows.error_slice], color=colour, label=name)
        off_K = np.abs(rows[last, plant.rows.field_slice] - this.field_degC).max()
        off_um = np.abs(rows[last, plant.rows.error_slice] - this.error_um).max()
        print(f"{name}: {off_K:.3f} K, {off_um:.2f} µm off at most")
    field.legend(frameon=False, fontsize=8)


def draw_heats(axes: Axes, this: Slides) -> None:
    """The estimated heat of each nut with 95 %, and the true one."""
    block, minutes = replay(this.config, this.log), this.log.time_s / 60.0
    for j, colour in enumerate((BLUE, GREEN)):
        value, half = block.heat_W[:, j], 1.96 * block.heat_sigma_W[:, j]
        axes.plot(minutes, value, color=colour, label=this.config.source[j].name.replace("_", " "))
        axes.fill_between(minutes, value - half, value + half, color=colour, alpha=0.2, lw=0)
        axes.plot(minutes, this.heat_W[j] * this.turns, "--", color="black", lw=1)
    axes.set(xlabel="minutes; dashed: the true heats", ylabel="heat, W", ylim=(-3.0, 30.0))
    axes.legend(frameon=False, fontsize=8)


def draw_stepped(target: Path) -> None:
    """Draw all three."""
    this = two_slides(SEED)
    picture = Figure(figsize=(11.0, 3.4), layout="constrained")
    FigureCanvasAgg(picture)
    field, error, heats = picture.subplots(1, 3)
    draw_profiles(field, error, this)
    draw_heats(heats, this)
    for axes in (field, error, heats):
        axes.spines[["top", "right"]].set_visible(False)
    picture.savefig(target, dpi=110, metadata={"Software": None})


if __name__ == "__main__":
    draw_stepped(HERE / "stepped.png")
