"""Pictures of results: overview of a replay or a simulation, heat history, forecast.

Each is drawn on a figure and returns its panels; `written` makes a figure that becomes a file, completely or
not at all, and `shown` one that a notebook or a window displays.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from observer.config.machine import Config
from observer.files.folders import results_in
from observer.forecast.document import Forecast
from observer.frames import FloatArray, Inputs
from observer.history.history import HeatHistory
from observer.model.build import grid_of
from observer.model.realise import realise
from observer.report import panels
from observer.report.collect import Decimator, ReplaySamples
from observer.report.panels import QUIET, RC, HeatCurves, Panel, colour, duration_text, elapsed

if TYPE_CHECKING:
    from matplotlib.figure import Figure

WIDTH_PX, HEIGHT_PX, DPI = 1600, 1200, 100


def draw_overview(figure: Figure, config: Config, samples: ReplaySamples, title: str) -> list[Panel]:
    """Draw heats, field, thermal error, innovations and quality of a replay.

    Without an expansion coefficient the third panel shows temperatures. Displacement sensors have no
    innovation here, since their unit differs.

    Args:
        figure: An empty figure.
        config: The machine.
        samples: The collected blocks, at least one row.
        title: The replayed log.

    Returns:
        The panels from the top.
    """
    layout, last, note = samples.layout, samples.last, f"{100 * samples.good:.1f} % of good quality"
    page = _page_of(figure, config, title, samples, note, (3.0, 3.2, 2.6, 2.6, 0.28))
    heats, field, error, innovations, quality = page
    inks = [colour(i) for i in range(len(layout.sources))]
    extremes_W = samples.low("heat_W"), samples.high("heat_W")
    curves = HeatCurves(layout.sources, inks, last("heat_W"), last("heat_sigma_W"), last("law_W"), extremes_W)
    panels.heats(heats, curves)
    panels.field(field, layout.position_m, last("field_degC"), config)
    values, sigma = ("error_um", "error_sigma_um") if layout.has_error else ("field_degC", "field_sigma_K")
    panels.at_positions(
        error, layout.position_m, last(values), last(sigma), *_error_or_field(layout.has_error, config)
    )
    thermal = [unit == "K" for unit in layout.units]  # a displacement's are of another unit
    panels.innovations(
        innovations, [n for n, is_thermal in zip(layout.sensors, thermal, strict=True) if is_thermal],
        (samples.low("innovation_K")[:, thermal], samples.high("innovation_K")[:, thermal]),
        samples.high("sensor_quality")[:, thermal],
        max(s.noise_K for s in config.sensor if s.kind == "temperature"),
    )  # fmt: skip
    panels.quality_strip(quality, samples.high("quality"))
    return page


def draw_simulation(figure: Figure, config: Config, samples: Decimator, title: str) -> list[Panel]:
    """Draw heats by law, field, thermal error and sensors of a simulation.

    Args:
        figure: An empty figure.
        config: The machine.
        samples: Blocks as `collect.simulated` gives them, at least one row.
        title: The simulated program.

    Returns:
        The panels from the top.
    """
    last, position_m = samples.last, grid_of(config)
    has_error = last("error_um").shape[1] > 0
    page = _page_of(figure, config, title, samples, "open loop", (2.4, 3.2, 2.6, 3.0))
    heats, field, error, sensors = page
    sources, law_W = [s.name for s in realise(config).config.source], last("law_W")
    # effects may add some
    heat = [j for j in range(len(sources)) if j < len(config.source) or law_W[:, j].any()]
    panels.laws(heats, [sources[j] for j in heat], law_W[:, heat])
    panels.field(field, position_m, last("field_degC"), config)
    values = last("error_um" if has_error else "field_degC")
    panels.at_positions(error, position_m, values, None, *_error_or_field(has_error, config))
    names = [s.name for s in config.sensor]
    panels.sensors(sensors, names, last("measured_degC"), last("predicted_degC"))
    return page


def _error_or_field(has_error: bool, config: Config) -> tuple[str, str]:
    """Title and unit of the panel of the thermal error, or of the temperature."""
    screw = "free screw" if config.supports is None else "screw between its supports"
    return (f"Thermal error of the {screw}", "µm") if has_error else ("Temperature", "°C")


def draw_heat_history(
    figure: Figure, config: Config, history: HeatHistory, blocks: Sequence[Inputs], title: str, method: str
) -> list[Panel]:
    """Draw a panel for each heat and one for the sensors.

    Args:
        figure: An empty figure.
        config: The machine.
        history: Heats (K, m_e) and residuals of a whole log.
        blocks: The inputs that the history was made from, K steps in all.
        title: The log.
        method: The method, for the note at the top.

    Returns:
        The panels from the top.
    """
    names = [s.name for s in config.source if s.estimate]
    samples = _samples(config, history, blocks)
    page = _page_of(figure, config, title, samples, method, (*(2.4 for _ in names), 2.6))
    for i, name in enumerate(names):
        heat, sigma, law = (samples.last(key)[:, [i]] for key in ("heat_W", "sigma_W", "law_W"))
        extremes_W = samples.low("heat_W")[:, [i]], samples.high("heat_W")[:, [i]]
        page[i].axes.axhline(0.0, color=QUIET, lw=0.7)
        curves = HeatCurves([name], [colour(i)], heat, sigma, law, extremes_W)
        panels.heats(page[i], curves, f"Heat of {name}")
    used = np.maximum(np.isfinite(history.residual_K).sum(axis=0), 1)
    rms_K = np.sqrt(np.nansum(history.residual_K**2, axis=0) / used).tolist()
    sensors = [f"{s.name}, {rms:.2g} K" for s, rms in zip(config.sensor, rms_K, strict=True)]
    panels.sensors(page[-1], sensors, samples.last("measured_degC"), key="unexplained, rms")
    return page


def _samples(config: Config, history: HeatHistory, blocks: Sequence[Inputs]) -> Decimator:
    """The history (m_e heats) and its inputs, thinned to the resolution of a page."""
    samples, begin = Decimator(), 0
    estimated = np.flatnonzero([s.estimate for s in config.source])
    for block in blocks:
        rows = slice(begin, begin + len(block))
        begin += len(block)
        samples.add(
            {
                "time_s": block.time_s,
                "heat_W": history.heat_W[rows],
                "sigma_W": history.heat_sigma_W[rows],
                "law_W": block.law_W[:, estimated],
                "measured_degC": np.where(block.usable, block.y_degC, np.nan),
            }
        )
    return samples


def draw_forecast(
    figure: Figure, title: str, position_m: FloatArray, forecast: Forecast, within_um: float
) -> list[Panel]:
    """Draw a panel of temperatures and, where it is known, one of the thermal error at some positions.

    Args:
        figure: An empty figure.
        title: Machine, axis and log.
        position_m: Places (g,).
        forecast: The time ahead and the settled state.
        within_um: Distance from the settled error at which it counts as settled.

    Returns:
        One panel or two.
    """
    ahead, settled, t = forecast.ahead, forecast.settled, forecast.ahead.time_s / 60.0
    has_error = ahead.error_um.shape[1] > 0
    page = _panels(figure, title, forecast.program.text, t, "time from now, min", (1.0,) * (1 + has_error))
    words = "with 95 %; dashes: where it settles"
    panels.at_positions(
        page[0], position_m, ahead.field_degC, ahead.field_sigma_K, f"Temperature, {words}", "°C",
        settled.field_degC,
    )  # fmt: skip
    if has_error:
        panels.at_positions(
            page[1], position_m, ahead.error_um, ahead.error_sigma_um, f"Thermal error, {words}", "µm",
            settled.error_um,
        )  # fmt: skip
    if (after_s := settled.after_s) is None:
        return page
    label = f"within {within_um:g} µm of settled after {after_s / 60:.0f} min"
    for panel in page if 0.0 < after_s <= ahead.time_s[-1] else ():
        panel.axes.axvline(after_s / 60.0, color=QUIET, lw=1.2)
    page[-1].axes.annotate(
        label, (0.99, 1.02), xycoords="axes fraction", ha="right", va="bottom", color=QUIET
    )
    return page


def _page_of(
    figure: Figure, config: Config, title: str, samples: Decimator, note: str, heights: tuple[float, ...]
) -> list[Panel]:
    """The empty panels of samples."""
    time_s = samples.last("time_s")
    t, unit = elapsed(time_s)
    heading = f"{config.machine.name}, axis {config.machine.axis}: {title}"
    note = f"{duration_text(float(time_s[-1] - time_s[0]))}, {samples.rows:,} steps, {note}"
    return _panels(figure, heading, note, t, f"time since the start, {unit}", heights)


def _panels(
    figure: Figure, heading: str, note: str, t: FloatArray, time: str, heights: tuple[float, ...]
) -> list[Panel]:
    """Empty panels of these heights, below a heading."""
    figure.set_layout_engine("constrained", rect=(0.0, 0.0, 1.0, 0.955), hspace=0.03)
    ratios = {"height_ratios": heights, "width_ratios": (1.0, 0.02)}
    grid = figure.subplots(len(heights), 2, squeeze=False, sharex="col", gridspec_kw=ratios)
    page = [Panel(t, axes, key) for axes, key in grid]
    for panel in page:
        panel.axes.tick_params(labelbottom=panel is page[-1], length=3)
    page[0].axes.set_xlim(t[0], t[-1] if len(t) > 1 else t[0] + 1.0)
    page[-1].axes.set_xlabel(time)
    figure.text(0.01, 0.987, heading, ha="left", va="top", fontsize=17, fontweight="bold")
    figure.text(0.99, 0.983, note, ha="right", va="top", color=QUIET)
    return page


@contextmanager
def written(path: Path, **options: Any) -> Iterator[Figure]:
    """Give a figure to draw on, and write it after the block in the format that its name ends with.

    Args:
        path: The file, in a folder that `results_in` has made.
        options: Of the figure; without them it has 1600 by 1200 pixels.
    """
    import matplotlib as mpl  # noqa: PLC0415 - slow to import
    from matplotlib.backends.backend_agg import FigureCanvasAgg  # noqa: PLC0415
    from matplotlib.figure import Figure  # noqa: PLC0415

    with mpl.rc_context(RC):
        figure = Figure(dpi=DPI, **{"figsize": (WIDTH_PX / DPI, HEIGHT_PX / DPI)} | options)
        FigureCanvasAgg(figure)
        yield figure
        figure.savefig(path, format=path.suffix[1:] or "png")


@contextmanager
def drawn(path: Path, width: float, height: float) -> Iterator[Figure]:
    """Give a figure to draw on, and write it whole after the block in the format that its name ends with.

    Args:
        path: The file: .png, .svg or .pdf.
        width: In hundreds of pixels.
        height: In hundreds of pixels.

    Raises:
        UserError: The folder cannot be written; this is noticed before the block.
    """
    with (
        results_in(path.absolute().parent) as part,
        written(part / path.name, figsize=(width, height), layout="constrained") as figure,
    ):
        yield figure


@contextmanager
def shown() -> Iterator[Figure]:
    """Give a figure of pyplot to draw on; a notebook or a window displays it as any other."""
    import matplotlib as mpl  # noqa: PLC0415 - slow to import
    from matplotlib import pyplot  # noqa: PLC0415

    with mpl.rc_context(RC):
        yield pyplot.figure(figsize=(WIDTH_PX / DPI, HEIGHT_PX / DPI), dpi=DPI)
