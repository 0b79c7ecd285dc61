"""Draw the figure of docs/discovery.md, what some answers look like: `make figures`."""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE.parents[1]))

from observer import discover  # noqa: E402
from observer.discovery.discover import Discovery  # noqa: E402
from tests.truth.machine.effects import Effect  # noqa: E402
from tests.truth.machine.generate import Case, write_case  # noqa: E402

if TYPE_CHECKING:
    from matplotlib.axes import Axes

INKS = ("#2f6db5", "#c2571a", "#3b8f5a", "#8a5fa8", "#20242a")
STYLES: dict[str, Any] = {"without any effect": (0, (2, 2)), "with the best explanation": "-"}
LOSS = Effect("end_conduction", "right", {"conductance_W_K": 0.15})


class Shown(NamedTuple):
    """A machine whose answer is shown, and what its panel is called."""

    title: str
    case: Case


SHOWN = (
    Shown(
        "t5 reads 2.4 K too little",
        Case(
            "typical.sensor_bias.t5", (Effect("sensor_bias", "t5", {"offset_K": -2.4}),), 12000, typical=True
        ),
    ),
    Shown(
        "the room cools by 4 K, and the log says that it does not",
        Case("figure.room", (Effect("ambient_drift", None, {"rate_K_h": -1.5}),), 12000, typical=True),
    ),
    Shown(
        "rows 1 min apart, heat lost at the right end",
        Case("minutes.end_conduction", (LOSS,), 901, faults=("minutes",)),
    ),
    Shown(
        "grease that changes halfway: in no library",
        Case("figure.grease", (Effect("grease_step", None, {"factor": 0.5}),), 12000),
    ),
)


def searched(case: Case) -> Discovery:
    """Search the logs of a machine."""
    with tempfile.TemporaryDirectory() as scratch:
        logs = write_case(case, Path(scratch))
        config = Path(scratch) / "config.toml"
        return discover(config, logs)._found.found


def residuals(axes: Axes, found: Discovery) -> None:
    """Measured minus predicted on the log held back: without any effect, and with what was found."""
    run = found.problem.forward.runs[-1].ticks
    fits = (found.search.null.config, found.verdict.fit.config)
    for config, style in zip(fits, STYLES.values(), strict=True):
        error_K = run.measured_degC - found.problem.forward(config)[-1]
        for sensor, column, ink in zip(found.problem.config.sensor, error_K.T, INKS, strict=True):
            label = sensor.name if style == "-" else None
            axes.plot(run.time_s / 60.0, column, color=ink, lw=1.1, ls=style, label=label)
    axes.axhline(0.0, color="#8a9099", lw=0.8)
    axes.set_ylabel("measured − predicted, K")


def answer(found: Discovery) -> str:
    """The verdict and what it names, in a line."""
    named = [" and ".join(c.name for c in each) for each in found.verdict.sets]
    names = f": {' or '.join(named)}" if named else ""
    doubts = f"; {found.suspects[0].what} in doubt" if found.suspects else ""
    return f"{found.verdict.kind}{names}{doubts}".replace("_", " ")


def draw() -> Figure:
    """Each answer on the log held back, and the test cycle that would decide the last."""
    figure = Figure(figsize=(13, 9), layout="constrained")
    FigureCanvasAgg(figure)
    grid = figure.add_gridspec(3, 2, height_ratios=(3, 3, 1.1))
    for number, shown in enumerate(SHOWN):
        found = searched(shown.case)
        print(f"{shown.title}: {found.verdict.reason}")
        axes = figure.add_subplot(grid[number // 2, number % 2])
        residuals(axes, found)
        axes.set_title(f"{shown.title}\n{answer(found)}", fontsize=10, loc="left")
        axes.set_xlabel("time of the log held back, min")
        if number == 0:
            axes.legend(frameon=False, fontsize=8, ncols=5, loc="center right", bbox_to_anchor=(1.0, 0.42))
        if number == 1:
            for label, style in STYLES.items():
                axes.plot([], [], color="#20242a", lw=1.1, ls=style, label=label)
            axes.legend(
                handles=axes.get_lines()[-len(STYLES) :], frameon=False, fontsize=8, loc="upper right"
            )
        if found.experiment is not None:
            cycle = figure.add_subplot(grid[2, number % 2])
            ends_min = np.cumsum([0.0, *(p.duration_s / 60.0 for p in found.experiment.phases)])
            cycle.stairs([p.speed_rpm for p in found.experiment.phases], ends_min, color="#20242a", lw=1.4)
            sigma = found.experiment.separation_sigma
            cycle.set_title(
                f"the test that would decide {'the first' if number == 0 else 'the last'}: "
                f"separates the answers by {sigma:.1f} σ",
                fontsize=10,
                loc="left",
            )
            cycle.set_xlabel("time of the test, min")
            cycle.set_ylabel("rpm")
    return figure


if __name__ == "__main__":
    draw().savefig(HERE / "discovery-cases.png", dpi=110)
