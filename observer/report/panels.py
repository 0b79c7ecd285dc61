"""The panels of a picture; each draws one thing on its axes and its legend on the narrow axes beside it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from observer.config.machine import Config
from observer.forecast.document import thinned
from observer.frames import EstimateQuality, FloatArray, Quality
from observer.report.appearance import MM_PER_M, TEMPERATURE_COLOURS

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes


INK, QUIET, FAINT = "#1b1f24", "#6b7280", "#e2e5e9"
CATEGORIES = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#444444")
"""Okabe & Ito (2008), without yellow, which is lost on white."""
QUALITY = ("#cfe8dc", "#E69F00", "#D55E00", "#444444")
"""Of a sensor, by rising severity."""
ESTIMATE_QUALITY = ("#cfe8dc", "#9ecae9", *QUALITY[1:])
"""The same of an estimate, which may also be starting."""
ORDERED_MAP = "viridis"

RC: dict[Any, Any] = {
    "font.family": "DejaVu Sans",
    "font.size": 11.0,
    "text.color": INK,
    "axes.edgecolor": "#b6bcc5",
    "axes.labelcolor": INK,
    "axes.linewidth": 0.8,
    "axes.grid": True,
    "axes.axisbelow": True,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.titlelocation": "left",
    "axes.titlesize": 12.0,
    "axes.titleweight": "bold",
    "axes.titlepad": 7.0,
    "grid.color": FAINT,
    "grid.linewidth": 0.8,
    "legend.frameon": False,
    "legend.fontsize": 10.5,
    "legend.handlelength": 1.5,
    "lines.linewidth": 1.6,
    "xtick.color": QUIET,
    "ytick.color": QUIET,
    "xtick.labelsize": 10.0,
    "ytick.labelsize": 10.0,
    "figure.facecolor": "white",
    "savefig.facecolor": "white",
}


def colour(index: int) -> str:
    """Return the colour of a category; they repeat after seven."""
    return CATEGORIES[index % len(CATEGORIES)]


def ordered_colours(count: int) -> list[Any]:
    """Return `count` colours of rising lightness for things in an order, such as positions."""
    import matplotlib as mpl  # noqa: PLC0415 - slow to import

    return list(mpl.colormaps[ORDERED_MAP](np.linspace(0.08, 0.8, count)))


def elapsed(time_s: FloatArray) -> tuple[FloatArray, str]:
    """Return the time since the first sample and its unit.

    Args:
        time_s: Increasing times (n,).

    Returns:
        Times (n,) in `s` up to five minutes, `min` up to four hours, else `h`.
    """
    since_s = time_s - time_s[0]
    span_s = float(since_s[-1])
    for unit, seconds, up_to_s in (("s", 1.0, 300.0), ("min", 60.0, 4 * 3600.0)):
        if span_s <= up_to_s:
            return since_s / seconds, unit
    return since_s / 3600.0, "h"


def duration_text(seconds: float) -> str:
    """Return a duration in words: seconds below five minutes, then minutes, then hours with minutes."""
    minutes, rest = divmod(round(seconds), 60)
    if minutes < 5:
        return f"{seconds:.0f} s"
    hours, minutes = divmod(minutes + (rest >= 30), 60)
    return f"{hours} h {minutes:02d} min" if hours else f"{minutes} min"


Z95 = 1.96
LANE = 0.38
DASHED: dict[str, Any] = {"lw": 1.0, "ls": (0, (4, 2)), "alpha": 0.9}
_BAD = (Quality.MISSING, Quality.STALE, Quality.REJECTED)


class Panel(NamedTuple):
    """Axes over a time, and narrow axes for the key beside them.

    Attributes:
        t: Times (n,) in the unit of the axis.
        axes: The axes for the curves.
        key: The axes for their legend, or for a colour bar.
    """

    t: FloatArray
    axes: Axes
    key: Axes

    def curves(
        self, values: FloatArray, names: Sequence[str], inks: Sequence[Any],
        reach: FloatArray | None = None, **style: Any,
    ) -> None:  # fmt: skip
        """Draw columns over time.

        Args:
            values: Columns (n, c).
            names: Labels for the key, c; empty ones do not appear there.
            inks: Colours, c.
            reach: Half-width (n, c) of a band around each curve; None for no bands.
            style: Options of matplotlib's `plot`.
        """
        for i, (name, ink) in enumerate(zip(names, inks, strict=True)):
            if reach is not None:
                self.band(values[:, i] - reach[:, i], values[:, i] + reach[:, i], ink, 0.18)
            self.axes.plot(self.t, values[:, i], color=ink, label=name, **style)

    def band(self, low: FloatArray, high: FloatArray, ink: Any, alpha: float) -> None:
        """Shade the area between two columns (n,), without a label for the key.

        Args:
            low: Lower edge.
            high: Upper edge; where one of the two is NaN nothing is shaded.
            ink: Colour.
            alpha: Opacity, 0 to 1.
        """
        self.axes.fill_between(self.t, low, high, color=ink, alpha=alpha, lw=0)

    def explain(
        self, handles: Sequence[Artist] = (), labels: Sequence[str] = (), title: str | None = None
    ) -> None:
        """Draw the key: of the labelled curves, then of other marks.

        Args:
            handles: Marks to add, such as those of `sample` and `shade`.
            labels: Their labels.
            title: Heading of the key; None for none.
        """
        curves, names = self.axes.get_legend_handles_labels()
        self.key.axis("off")
        self.key.legend(
            [*curves, *handles], [*names, *labels], loc="center left", borderaxespad=0.0,
            bbox_to_anchor=(0.0, 0.5), title=title, alignment="left",
        )  # fmt: skip

    def limits(self, *values: FloatArray) -> None:
        """Set the vertical limits by the finite values of some arrays, of any shapes.

        A wide band at the start then does not flatten everything. Without a finite value nothing changes.
        """
        all_values = np.concatenate([v.ravel() for v in values])
        if not np.isfinite(all_values).any():
            return  # nothing was ever known
        low, high = float(np.nanmin(all_values)), float(np.nanmax(all_values))
        pad = 0.12 * max(high - low, 1e-6 + 0.01 * abs(high))
        self.axes.set_ylim(low - pad, high + pad)

    def sample(self, **style: Any) -> Artist:
        """Return a line for the key that is not drawn."""
        return self.axes.plot([], [], **style)[0]

    def shade(self) -> Artist:
        """Return a band for the key that is not drawn."""
        return self.axes.fill_between([], [], color=QUIET, alpha=0.25, lw=0)


class HeatCurves(NamedTuple):
    """Estimated heats over n samples.

    Attributes:
        names: Names of the sources, c.
        inks: Their colours, c.
        heat_W: Heats (n, c).
        sigma_W: Their standard deviations (n, c).
        law_W: Heats by their laws (n, c); a column of zeros is not drawn.
        extremes_W: Lowest and highest values between the samples, each (n, c).
    """

    names: Sequence[str]
    inks: Sequence[Any]
    heat_W: FloatArray
    sigma_W: FloatArray
    law_W: FloatArray
    extremes_W: tuple[FloatArray, FloatArray]


def heats(panel: Panel, curves: HeatCurves, title: str = "Heat entering the screw") -> None:
    """Draw heats with 95 % bands, the extremes between samples, and their laws as thin dashes.

    The vertical limits follow the usual width of the bands, not their width at the start.

    Args:
        panel: The panel.
        curves: The heats; σ is NaN where it is unknown.
        title: Title of the panel.
    """
    heat_W, law_W, reach_W = curves.heat_W, curves.law_W, Z95 * curves.sigma_W
    for low_W, high_W, ink in zip(curves.extremes_W[0].T, curves.extremes_W[1].T, curves.inks, strict=True):
        panel.band(low_W, high_W, ink, 0.35)
    panel.curves(heat_W, curves.names, curves.inks, reach_W)
    with_law = np.flatnonzero(law_W.any(axis=0)).tolist()
    for i in with_law:
        panel.axes.plot(panel.t, law_W[:, i], color=curves.inks[i], **DASHED)
    usual_W = np.nanmedian(reach_W, axis=0) if np.isfinite(reach_W).any() else 0.0
    panel.limits(law_W[:, with_law], heat_W - usual_W, heat_W + usual_W)
    panel.axes.set(title=title, ylabel="W")
    by_law = [panel.sample(color=QUIET, **DASHED)] if len(with_law) else []
    panel.explain([*by_law, panel.shade()], [*["by its law"] * len(by_law), "95 %"])


def laws(panel: Panel, names: Sequence[str], law_W: FloatArray) -> None:
    """Draw heats by their laws; lines that coincide differ in width, so that all can be seen.

    Args:
        panel: The panel.
        names: Names of the sources, m.
        law_W: Heats (n, m).
    """
    for i, name in enumerate(names):
        # of lines that coincide the lower one shows at both sides of the upper one
        panel.curves(law_W[:, [i]], [name], [colour(i)], lw=1.6 + 1.4 * (len(names) - 1 - i))
    panel.limits(law_W)
    panel.axes.set(title="Heat entering the screw, by its laws", ylabel="W")
    panel.explain()


def field(panel: Panel, position_m: FloatArray, field_degC: FloatArray, config: Config) -> None:
    """Draw the temperature over time and position as an image, with a colour bar.

    Args:
        panel: The panel; its key takes the colour bar.
        position_m: Places (g,).
        field_degC: Temperatures (n, g).
        config: Its sensors on the screw are marked, and its nuts' strokes are bracketed.
    """
    from matplotlib.colors import LinearSegmentedColormap  # noqa: PLC0415 - slow to import

    axes = panel.axes
    image = axes.pcolormesh(
        panel.t, position_m * MM_PER_M, field_degC.T, shading="gouraud", rasterized=True,
        cmap=LinearSegmentedColormap.from_list("temperature", TEMPERATURE_COLOURS),
    )  # fmt: skip
    axes.grid(visible=False)
    for sensor in config.sensor:
        if sensor.position_m is None:
            continue
        y_mm = sensor.position_m * MM_PER_M
        axes.axhline(y_mm, color="white", lw=0.7, ls=(0, (1, 4)), alpha=0.8)
        axes.annotate(
            f" {sensor.name} ", (0, y_mm), xycoords=("axes fraction", "data"), va="center", ha="left",
            fontsize=8.5, color=INK,
            bbox={"boxstyle": "rarrow,pad=0.12", "fc": "white", "ec": "none", "alpha": 0.85},
        )  # fmt: skip
    across = axes.get_yaxis_transform()
    for source in config.source:
        if source.stroke_m is None:
            continue
        low_mm, high_mm = (x_m * MM_PER_M for x_m in source.stroke_m)
        bracket = [0.985, 0.992, 0.992, 0.985], [low_mm, low_mm, high_mm, high_mm]
        axes.plot(*bracket, color="white", lw=1.6, transform=across)
        axes.annotate(
            f"{source.name}'s stroke", (0.98, (low_mm + high_mm) / 2), xycoords=across, rotation=90,
            va="center", ha="right", fontsize=8.5, color="white",
        )  # fmt: skip
    axes.set(title="Temperature of the screw", ylabel="position, mm")
    axes.figure.colorbar(image, cax=panel.key, label="°C")
    panel.key.grid(visible=False)


def at_positions(
    panel: Panel, position_m: FloatArray, values: FloatArray, sigma: FloatArray | None, title: str, unit: str,
    settled: FloatArray | None = None,
) -> None:  # fmt: skip
    """Draw a quantity over time at up to five positions.

    Args:
        panel: The panel.
        position_m: Places (g,).
        values: The quantity (n, g).
        sigma: Its standard deviation (n, g), drawn as 95 % bands; None for none.
        title: Title of the panel.
        unit: Unit of the values.
        settled: The final value at each place, (g,), drawn as dashes; None for none.
    """
    chosen = thinned(len(position_m), 6)[:0:-1] or [0]
    inks, names = ordered_colours(len(chosen))[::-1], [f"{position_m[i] * MM_PER_M:.0f} mm" for i in chosen]
    reach = None if sigma is None else Z95 * sigma[:, chosen]
    panel.curves(values[:, chosen], names, inks, reach)
    panel.limits(values[:, chosen], np.zeros(0) if settled is None else settled[chosen])
    for i, ink in zip(chosen, inks, strict=True) if settled is not None else ():
        panel.axes.axhline(settled[i], color=ink, lw=0.9, ls=(0, (5, 4)), alpha=0.8)  # type: ignore[index]
    panel.axes.set(title=title, ylabel=unit)
    shades = [] if sigma is None else [panel.shade()]
    panel.explain(shades, ["95 %"] * len(shades), title="at")


def innovations(
    panel: Panel, names: Sequence[str], extremes_K: tuple[FloatArray, FloatArray], quality: FloatArray,
    noise_K: float,
) -> None:  # fmt: skip
    """Draw innovations in K, each sensor in its own lane on one scale, and a bar where it was not good.

    The scale holds nearly all values, and three times the noise at least. Values beyond are drawn at its end.

    Args:
        panel: The panel.
        names: Names of the sensors, s.
        extremes_K: Smallest and largest innovation between the samples, each (n, s).
        quality: Codes of the sensors' quality (n, s).
        noise_K: Largest noise of a sensor.
    """
    t, axes, lanes = panel.t, panel.axes, len(names)
    limit_K = scale_limit(extremes_K, 3.0 * noise_K)
    for i in range(lanes):
        centre, ink = lanes - 1 - i, colour(i)
        axes.axhline(centre, color="#d3d7dd", lw=0.7, zorder=1)
        for edge in (-LANE, LANE):
            axes.axhline(centre + edge, color=QUIET, lw=0.7, ls=(0, (1, 2)), zorder=1)
        bottom, top = (centre + np.clip(v[:, i] * LANE / limit_K, -LANE, LANE) for v in extremes_K)
        panel.band(bottom, top, ink, 0.45)
        axes.plot(t, (bottom + top) / 2, color=ink, lw=0.7)
        for level in _BAD:
            times = t[quality[:, i] == int(level)]
            axes.plot(
                times, np.full(len(times), centre - 0.46), "|", ms=5, mew=1.2, color=QUALITY[int(level)]
            )
    axes.set_yticks(range(lanes), names[::-1])
    axes.set_ylim(-0.55, lanes - 0.45)
    axes.grid(visible=False, axis="y")
    axes.set_title("Innovations: measured less predicted one step before, K")
    levels = [level for level in _BAD if np.any(quality == int(level))]
    bars = [panel.sample(marker="s", ls="", ms=7, color=QUALITY[int(level)]) for level in levels]
    edges = panel.sample(color=QUIET, lw=0.7, ls=(0, (1, 2)))
    panel.explain([edges, *bars], [f"±{limit_K:g} K", *(level.label for level in levels)])


def scale_limit(values: Sequence[FloatArray], least: float) -> float:
    """Return the end of a scale that 99.5 % of the values lie within, rounded up.

    Args:
        values: Arrays of any shapes; NaN is left out.
        least: The smallest end.
    """
    size = np.concatenate([np.abs(v[np.isfinite(v)]) for v in values])
    most = max(float(np.quantile(size, 0.995)) if len(size) else 0.0, least)
    power = 10.0 ** np.floor(np.log10(most))
    return float(next(r * power for r in (1, 1.5, 2, 3, 4, 5, 7.5, 10) if r * power >= 0.999 * most))


def quality_strip(panel: Panel, quality: FloatArray) -> None:
    """Draw the quality codes (n,) of the estimate as a coloured strip; each ends at its sample."""
    from matplotlib.colors import ListedColormap  # noqa: PLC0415 - slow to import
    from matplotlib.patches import Patch  # noqa: PLC0415

    t = panel.t
    edges = np.concatenate([[t[0] - (t[1] - t[0] if len(t) > 1 else 1.0)], t])  # each ends at its sample
    panel.axes.pcolormesh(
        edges, [0.0, 1.0], quality[None, :], cmap=ListedColormap(list(ESTIMATE_QUALITY)), vmin=-0.5,
        vmax=len(ESTIMATE_QUALITY) - 0.5, rasterized=True,
    )  # fmt: skip
    panel.axes.set_yticks([0.5], ["quality"])
    panel.axes.grid(visible=False)
    qualities = sorted({int(EstimateQuality.GOOD), *np.unique(quality).astype(int).tolist()})
    patches = [Patch(color=ESTIMATE_QUALITY[q]) for q in qualities]
    panel.explain(patches, [EstimateQuality(q).label for q in qualities])


def sensors(
    panel: Panel, names: Sequence[str], measured_degC: FloatArray, predicted_degC: FloatArray | None = None,
    key: str | None = None,
) -> None:  # fmt: skip
    """Draw measured temperatures, faint where predicted ones are drawn as well.

    Args:
        panel: The panel.
        names: Names of the sensors, s.
        measured_degC: Readings (n, s), NaN where missing.
        predicted_degC: Predictions (n, s); None for none.
        key: Heading of the names; None for none.
    """
    inks, blank = [colour(i) for i in range(len(names))], [""] * len(names)
    title = "Measured temperatures"
    if predicted_degC is None:
        panel.curves(measured_degC, names, inks, lw=1.0)
    else:
        is_measured = np.isfinite(measured_degC).any()
        panel.curves(measured_degC, blank, inks, lw=0.8, alpha=0.45)
        panel.curves(predicted_degC, names, inks)
        title = "Sensors: predicted (bold) and measured (faint)" if is_measured else "Sensors, predicted"
    panel.limits(measured_degC, np.zeros(0) if predicted_degC is None else predicted_degC)
    panel.axes.set(title=title, ylabel="°C")
    panel.explain(title=key)
