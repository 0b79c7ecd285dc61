"""`overview.png`: a replay or a simulation on one page."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from observer.config import Config
from observer.frames import FloatArray
from observer.model.build import grid_of
from observer.model.realise import realise
from observer.report import panels
from observer.report.collect import Decimator, ReplaySamples
from observer.report.style import QUIET, RC, duration_text, elapsed

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

WIDTH_PX, HEIGHT_PX, DPI = 1600, 1200, 100


@dataclass(frozen=True, slots=True)
class Page:
    """Stacked axes over one time axis `t` (n,), each with narrow axes for its key beside it."""

    t: FloatArray
    axes: list[Axes]
    keys: list[Axes]


def write_overview(path: Path, config: Config, samples: ReplaySamples, title: str) -> None:
    """Draw heats, field, thermal error and innovations of a replay; `title` says of what.

    The file is written whole or not at all.
    """
    layout, last, note = samples.layout, samples.last, f"{100 * samples.good:.1f} % of good quality"
    with page_of(path, config, title, samples, note, (3.0, 3.2, 2.6, 2.6, 0.28)) as page:
        t, axes, keys = page.t, page.axes, page.keys
        panels.heats(
            axes[0], keys[0], t, layout.sources, last("heat_W"), last("heat_sigma_W"), last("law_W"),
            (samples.low("heat_W"), samples.high("heat_W")),
        )  # fmt: skip
        panels.field(axes[1], keys[1], t, layout.position_m, last("field_degC"), config)
        shown, sigma = ("error_um", "error_sigma_um") if layout.has_error else ("field_degC", "field_sigma_K")
        panels.at_positions(axes[2], keys[2], t, layout.position_m, last(shown), last(sigma))
        _say_what(axes[2], layout.has_error, config)
        panels.surprises(
            axes[3], keys[3], t, layout.sensors, (samples.low("surprise"), samples.high("surprise")),
            samples.high("sensor_quality"), config.estimator.gate_sigma,
        )  # fmt: skip
        panels.quality_strip(axes[4], keys[4], t, samples.high("quality"))


def write_simulation_overview(path: Path, config: Config, samples: Decimator, title: str) -> None:
    """Draw heats by law, field, thermal error and sensors of a simulation; `title` says of what.

    The file is written whole or not at all.
    """
    last, position_m = samples.last, grid_of(config)
    has_error = last("error_um").shape[1] > 0
    with page_of(path, config, title, samples, "open loop", (2.4, 3.2, 2.6, 3.0)) as page:
        t, axes, keys = page.t, page.axes, page.keys
        sources, law_W = [s.name for s in realise(config).config.source], last("law_W")
        # effects may add some
        heat = [j for j in range(len(sources)) if j < len(config.source) or law_W[:, j].any()]
        panels.laws(axes[0], keys[0], t, [sources[j] for j in heat], law_W[:, heat])
        panels.field(axes[1], keys[1], t, position_m, last("field_degC"), config)
        shown = last("error_um" if has_error else "field_degC")
        panels.at_positions(axes[2], keys[2], t, position_m, shown, None)
        _say_what(axes[2], has_error, config)
        names = [s.name for s in config.sensor]
        panels.predictions(axes[3], keys[3], t, names, last("predicted_degC"), last("measured_degC"))


def _say_what(axes: Axes, has_error: bool, config: Config) -> None:
    """Title and unit of the panel that shows the thermal error, or the temperature where there is none."""
    screw = "free screw" if config.supports is None else "screw between its supports"
    title, unit = (f"Thermal error of the {screw}", "µm") if has_error else ("Temperature", "°C")
    axes.set_title(title)
    axes.set_ylabel(unit)


@contextmanager
def page_of(
    path: Path, config: Config, title: str, samples: Decimator, note: str, heights: tuple[float, ...]
) -> Iterator[Page]:
    """Give an empty page to draw on, with panels of these heights, and write its file once that is done."""
    import matplotlib as mpl  # noqa: PLC0415 - slow to import
    from matplotlib.backends.backend_agg import FigureCanvasAgg  # noqa: PLC0415
    from matplotlib.figure import Figure  # noqa: PLC0415

    time_s = samples.last("time_s")
    t, unit = elapsed(time_s)
    duration = duration_text(float(time_s[-1] - time_s[0]))
    heading = f"{config.machine.name}, axis {config.machine.axis}: {title}"
    with mpl.rc_context(RC):
        figure = Figure(figsize=(WIDTH_PX / DPI, HEIGHT_PX / DPI), dpi=DPI)
        figure.set_layout_engine("constrained", rect=(0.0, 0.0, 1.0, 0.955), hspace=0.03)
        FigureCanvasAgg(figure)
        grid = figure.add_gridspec(len(heights), 2, height_ratios=heights, width_ratios=(1.0, 0.02))
        keys = [figure.add_subplot(grid[row, 1]) for row in range(len(heights))]
        axes = [figure.add_subplot(grid[0, 0])]
        axes += [figure.add_subplot(grid[row, 0], sharex=axes[0]) for row in range(1, len(heights))]
        for row in axes:
            row.tick_params(labelbottom=row is axes[-1], length=3)
        axes[0].set_xlim(t[0], t[-1] if len(t) > 1 else t[0] + 1.0)
        axes[-1].set_xlabel(f"time since the start, {unit}")
        figure.text(0.01, 0.987, heading, ha="left", va="top", fontsize=17, fontweight="bold")
        figure.text(
            0.99, 0.983, f"{duration}, {samples.rows:,} steps, {note}", ha="right", va="top", color=QUIET
        )
        yield Page(t, axes, keys)
        _save(figure, path)


def _save(figure: Figure, path: Path) -> None:
    part = path.with_name(path.name + ".part")
    try:
        figure.savefig(part, format="png", dpi=DPI)
        os.replace(part, path)
    finally:
        part.unlink(missing_ok=True)
