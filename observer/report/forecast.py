"""`forecast.png`: temperatures and thermal error of the next hours with 95 % bands, and where they settle."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from observer.forecast.ahead import Ahead
from observer.forecast.document import Forecast, thinned
from observer.frames import FloatArray
from observer.report.panels import Z95
from observer.report.style import QUIET, RC, colour

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_SHOWN = 5


def write_forecast(path: Path, title: str, position_m: FloatArray, found: Forecast, within_um: float) -> None:
    """Draw a panel of temperatures and, where it is known, one of the thermal error at some places.

    The file is written whole or not at all.
    """
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
    for i, j in enumerate(thinned(len(position_m), _SHOWN)):
        reach, ink = Z95 * sigma[:, j], colour(i)
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
    told = f"within {within_um:g} µm of settled after {after_s / 60:.0f} min"
    if 0.0 < after_s <= found.ahead.time_s[-1]:
        for row in axes:
            row.axvline(after_s / 60.0, color=QUIET, lw=1.2)
    axes[-1].annotate(told, (0.99, 1.02), xycoords="axes fraction", ha="right", va="bottom", color=QUIET)


def _save(figure: Figure, path: Path) -> None:
    part = path.with_name(path.name + ".part")
    try:
        figure.savefig(part, format="png")
        os.replace(part, path)
    finally:
        part.unlink(missing_ok=True)
