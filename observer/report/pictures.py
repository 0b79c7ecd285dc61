"""Pictures of results: overview of a replay or a simulation, heat history, forecast.

Each file is written completely or not at all.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from observer.config import Config
from observer.forecast.ahead import Ahead
from observer.forecast.document import Forecast, thinned
from observer.frames import FloatArray, Inputs
from observer.history.history import HeatHistory
from observer.model.build import grid_of
from observer.model.realise import realise
from observer.report import panels
from observer.report.collect import Decimator, ReplaySamples
from observer.report.style import QUIET, RC, colour, duration_text, elapsed

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


WIDTH_PX, HEIGHT_PX, DPI = 1600, 1200, 100
_PLACES_IN_FORECAST = 5
_SENSORS_HEIGHT, _HEAT_HEIGHT = 2.6, 2.4


@dataclass(frozen=True, slots=True)
class PanelPage:
    """Stacked axes over one time axis `t` (n,), each with narrow axes for its key beside it."""

    t: FloatArray
    axes: list[Axes]
    keys: list[Axes]


def write_overview(path: Path, config: Config, samples: ReplaySamples, title: str) -> None:
    """Draw heats, field, thermal error and innovations of a replay; `title` says of what."""
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
    """Draw heats by law, field, thermal error and sensors of a simulation; `title` says of what."""
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
) -> Iterator[PanelPage]:
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
        yield PanelPage(t, axes, keys)
        _save(figure, path)


def _save(figure: Figure, path: Path) -> None:
    part = path.with_name(path.name + ".part")
    try:
        figure.savefig(part, format="png")
        os.replace(part, path)
    finally:
        part.unlink(missing_ok=True)


def write_heat_history(
    path: Path, config: Config, history: HeatHistory, blocks: Sequence[Inputs], title: str, method: str
) -> None:
    """Draw a panel for each heat and one for the sensors; `title` says of what, `method` by which method.

    `blocks` are the inputs that the history was made from.
    """
    names = [s.name for s in config.source if s.estimate]
    samples = _samples(config, history, blocks)
    heights = (*(_HEAT_HEIGHT for _ in names), _SENSORS_HEIGHT)
    with page_of(path, config, title, samples, method, heights) as page:
        for i, name in enumerate(names):
            _heat(page.axes[i], page.keys[i], page.t, samples, i, name)
        _sensors(page.axes[-1], page.keys[-1], page.t, config, samples, history)


def _samples(config: Config, history: HeatHistory, blocks: Sequence[Inputs]) -> Decimator:
    """The history (m_e heats) and the inputs it was made from, thinned to what a page can show."""
    samples, begin = Decimator(), 0
    estimated = np.flatnonzero([s.estimate for s in config.source])
    for block in blocks:
        here = slice(begin, begin + len(block))
        begin += len(block)
        samples.add(
            {
                "time_s": block.time_s,
                "heat_W": history.heat_W[here],
                "sigma_W": history.heat_sigma_W[here],
                "law_W": block.law_W[:, estimated],
                "measured_degC": np.where(block.usable, block.y_degC, np.nan),
            }
        )
    return samples


def _heat(axes: Axes, key: Axes, t: FloatArray, samples: Decimator, i: int, name: str) -> None:
    heat, law, ink = samples.last("heat_W")[:, i], samples.last("law_W")[:, i], colour(i)
    reach = panels.Z95 * samples.last("sigma_W")[:, i]
    axes.axhline(0.0, color=QUIET, lw=0.7)
    band = axes.fill_between(t, heat - reach, heat + reach, color=ink, alpha=0.18, lw=0)
    low_W, high_W = samples.low("heat_W")[:, i], samples.high("heat_W")[:, i]
    axes.fill_between(t, low_W, high_W, color=ink, alpha=0.35, lw=0)
    handles, labels = [*axes.plot(t, heat, color=ink), band], [name, "95 %"]
    shown = [heat]
    if np.any(law):
        handles += axes.plot(t, law, color=QUIET, lw=1.0, ls=(0, (4, 2)))
        labels.append("by its law")
        shown.append(law)
    panels.limits_of(axes, _with_usual_band(np.column_stack(shown), heat, reach))
    axes.set(title=f"Heat of {name}", ylabel="W")
    panels.key_of(key, handles, labels)


def _with_usual_band(values: FloatArray, heat: FloatArray, reach: FloatArray) -> FloatArray:
    """The values and as much of the band as is usual: a wide start or end must not flatten everything."""
    usual = np.nanmedian(reach) if np.isfinite(reach).any() else 0.0
    return np.column_stack([values, heat - usual, heat + usual])


def _sensors(
    axes: Axes, key: Axes, t: FloatArray, config: Config, samples: Decimator, history: HeatHistory
) -> None:
    """Measured temperatures; the key says how far each is from what the heats explain."""
    used = np.maximum(np.isfinite(history.residual_K).sum(axis=0), 1)
    rms_K = np.sqrt(np.nansum(history.residual_K**2, axis=0) / used)
    measured_degC = samples.last("measured_degC")
    handles, labels = [], []
    for i, sensor in enumerate(config.sensor):
        handles += axes.plot(t, measured_degC[:, i], color=colour(i), lw=1.0)
        labels.append(f"{sensor.name}, {rms_K[i]:.2g} K")
    panels.limits_of(axes, measured_degC)
    axes.set(title="Measured temperatures", ylabel="°C")
    panels.key_of(key, handles, labels, title="unexplained, rms")


def write_forecast(path: Path, title: str, position_m: FloatArray, found: Forecast, within_um: float) -> None:
    """Draw a panel of temperatures and, where it is known, one of the thermal error at some places."""
    import matplotlib as mpl  # noqa: PLC0415 - slow to import
    from matplotlib.backends.backend_agg import FigureCanvasAgg  # noqa: PLC0415
    from matplotlib.figure import Figure  # noqa: PLC0415

    has_error = found.ahead.error_um.shape[1] > 0
    with mpl.rc_context(RC):
        figure = Figure(figsize=(12.0, 8.5 if has_error else 5.0), dpi=110, layout="constrained")
        FigureCanvasAgg(figure)
        figure.suptitle(f"{title}\n{found.program.text}", x=0.01, ha="left", fontweight="bold")
        axes = figure.subplots(2 if has_error else 1, 1, sharex=True, squeeze=False)[:, 0].tolist()
        a, s = found.ahead, found.settled
        _panel(axes[0], a, position_m, a.field_degC, a.field_sigma_K, s.field_degC)
        axes[0].set(title="Temperature, with 95 %; dashes: where it settles", ylabel="°C")
        if has_error:
            _panel(axes[1], a, position_m, a.error_um, a.error_sigma_um, s.error_um)
            axes[1].set(title="Thermal error, with 95 %; dashes: where it settles", ylabel="µm")
        _mark(axes, found, within_um)
        axes[-1].set_xlabel("time from now, min")
        _save(figure, path)


def _panel(
    axes: Axes, a: Ahead, position_m: FloatArray, values: FloatArray, sigma: FloatArray, settled: FloatArray
) -> None:
    t = a.time_s / 60.0
    for i, j in enumerate(thinned(len(position_m), _PLACES_IN_FORECAST)):
        reach, ink = panels.Z95 * sigma[:, j], colour(i)
        axes.fill_between(t, values[:, j] - reach, values[:, j] + reach, color=ink, alpha=0.15, lw=0)
        axes.plot(t, values[:, j], color=ink, label=f"{1000 * position_m[j]:.0f} mm")
        axes.axhline(settled[j], color=ink, lw=0.9, ls=(0, (5, 4)), alpha=0.8)
    axes.set_xlim(0.0, t[-1])
    axes.legend(loc="center left", bbox_to_anchor=(1.0, 0.5))


def _mark(axes: Sequence[Axes], found: Forecast, within_um: float) -> None:
    """Where the travel is within the limit: a line within the picture, words beside it."""
    after_s = found.settled.after_s
    if after_s is None:
        return
    label = f"within {within_um:g} µm of settled after {after_s / 60:.0f} min"
    if 0.0 < after_s <= found.ahead.time_s[-1]:
        for row in axes:
            row.axvline(after_s / 60.0, color=QUIET, lw=1.2)
    axes[-1].annotate(label, (0.99, 1.02), xycoords="axes fraction", ha="right", va="bottom", color=QUIET)
