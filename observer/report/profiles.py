"""A picture of a log's profiles: thermal error and temperature along the screw at times, and the heats."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from observer.frames import FloatArray
from observer.report.panels import Z95, colour, ordered_colours

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


@dataclass(frozen=True, eq=False)
class Profiles:
    """Profiles along the screw at t times of a log, and its heats.

    Attributes:
        time_s: Times (t,).
        position_m: Places (g,).
        field_degC: Temperatures (t, g).
        field_sigma_K: Their standard deviations (t, g).
        error_um: Thermal error (t, g), NaN without an expansion coefficient.
        error_sigma_um: Its standard deviation (t, g).
        names: Names of the m_e estimated sources.
        heat_W: Heats (t, m_e).
        heat_sigma_W: Their standard deviations (t, m_e).
    """

    time_s: FloatArray
    position_m: FloatArray
    field_degC: FloatArray
    field_sigma_K: FloatArray
    error_um: FloatArray
    error_sigma_um: FloatArray
    names: tuple[str, ...]
    heat_W: FloatArray
    heat_sigma_W: FloatArray


def draw_profiles(figure: Figure, profiles: Profiles) -> None:
    """Draw a curve for each time, with its 95 %, as Li et al. (2022) have it in figure 11.

    The thermal error is left out where it is NaN throughout.
    """
    figure.set_layout_engine("constrained")
    has_error = bool(np.isfinite(profiles.error_um).any())
    above, left, right = figure.subplot_mosaic([["a", "a"], ["b", "c"]]).values()
    x_mm, minutes = 1000.0 * profiles.position_m, (profiles.time_s - profiles.time_s[0]) / 60.0
    first = 0.0 if len(minutes) == 1 else minutes[1] - minutes[0]
    inks = ordered_colours(len(minutes))
    for axes, values, sigma, title in (
        (above, profiles.error_um, profiles.error_sigma_um, "Thermal error, µm"),
        (left, profiles.field_degC, profiles.field_sigma_K, "Temperature, °C"),
    ):
        for k, (curve, spread) in enumerate(zip(values, sigma, strict=True)):
            _curve(axes, x_mm, curve, spread, inks[k], f"{first + minutes[k]:.3g} min")
        axes.set(title=title, xlabel="mm")
    above.set_visible(has_error)
    (above if has_error else left).legend(fontsize=8, ncols=2)
    for j, name in enumerate(profiles.names):
        _curve(right, first + minutes, profiles.heat_W[:, j], profiles.heat_sigma_W[:, j], colour(j), name)
    right.set(title="Heat, W", xlabel="min")
    right.legend(fontsize=8)


def _curve(axes: Axes, x: FloatArray, y: FloatArray, sigma: FloatArray, ink: Any, label: str) -> None:
    axes.fill_between(x, y - Z95 * sigma, y + Z95 * sigma, color=ink, alpha=0.12, lw=0)
    axes.plot(x, y, "o-", ms=3, lw=1.2, color=ink, label=label)
