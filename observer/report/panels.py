"""The panels of an overview; each draws one thing on its axes and its legend on the narrow axes beside it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from observer.config import Config
from observer.frames import EstimateQuality, FloatArray, Quality
from observer.report.style import ESTIMATE_QUALITY, FIELD_MAP, INK, QUALITY, QUIET, colour, ordered_colours

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes

Z95 = 1.96
MM_PER_M = 1000.0
LANE = 0.38
_BAD = (Quality.MISSING, Quality.STALE, Quality.REJECTED)


def heats(
    axes: Axes, key: Axes, t: FloatArray, names: Sequence[str], heat_W: FloatArray, sigma_W: FloatArray,
    law_W: FloatArray, extremes_W: tuple[FloatArray, FloatArray],
) -> None:  # fmt: skip
    """Estimated heats with 95 % bands, and their laws as thin dashes."""
    for i, name in enumerate(names):
        reach = Z95 * sigma_W[:, i]
        axes.fill_between(t, heat_W[:, i] - reach, heat_W[:, i] + reach, color=colour(i), alpha=0.18, lw=0)
        axes.fill_between(t, extremes_W[0][:, i], extremes_W[1][:, i], color=colour(i), alpha=0.35, lw=0)
        axes.plot(t, heat_W[:, i], color=colour(i), label=name)
        if np.any(law_W[:, i]):
            axes.plot(t, law_W[:, i], color=colour(i), lw=1.0, ls=(0, (4, 2)), alpha=0.9)
    limits_of(axes, np.hstack([heat_W, law_W]))
    axes.set(title="Heat entering the screw", ylabel="W")
    handles, labels = axes.get_legend_handles_labels()
    if np.any(law_W):
        handles += axes.plot([], [], color=QUIET, lw=1.0, ls=(0, (4, 2)))
        labels.append("by its law")
    handles.append(axes.fill_between([], [], color=QUIET, alpha=0.25, lw=0))
    key_of(key, handles, [*labels, "95 %"])


def laws(axes: Axes, key: Axes, t: FloatArray, names: Sequence[str], law_W: FloatArray) -> None:
    """Heats by their laws."""
    for i, name in enumerate(names):
        # of lines that coincide the lower one shows at both sides of the upper one
        axes.plot(t, law_W[:, i], color=colour(i), label=name, lw=1.6 + 1.4 * (len(names) - 1 - i))
    limits_of(axes, law_W)
    axes.set(title="Heat entering the screw, by its laws", ylabel="W")
    key_of(key, *axes.get_legend_handles_labels())


def field(
    axes: Axes, bar: Axes, t: FloatArray, position_m: FloatArray, field_degC: FloatArray, config: Config
) -> None:
    """The temperature over time and position, with the sensors' places and the nuts' strokes."""
    image = axes.pcolormesh(
        t, position_m * MM_PER_M, field_degC.T, cmap=FIELD_MAP, shading="gouraud", rasterized=True
    )
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
    for source in config.source:
        if source.stroke_m is not None:
            _stroke(axes, source.stroke_m[0] * MM_PER_M, source.stroke_m[1] * MM_PER_M, source.name)
    axes.set(title="Temperature of the screw", ylabel="position, mm")
    axes.figure.colorbar(image, cax=bar, label="°C")
    bar.grid(visible=False)


def _stroke(axes: Axes, low_mm: float, high_mm: float, name: str) -> None:
    """A bracket inside the right edge over the stretch that a nut travels."""
    place = axes.get_yaxis_transform()
    axes.plot(
        [0.985, 0.992, 0.992, 0.985],
        [low_mm, low_mm, high_mm, high_mm],
        color="white",
        lw=1.6,
        transform=place,
    )
    axes.annotate(
        f"{name}'s stroke", (0.98, (low_mm + high_mm) / 2), xycoords=place, rotation=90, va="center",
        ha="right", fontsize=8.5, color="white",
    )  # fmt: skip


def at_positions(
    axes: Axes, key: Axes, t: FloatArray, position_m: FloatArray, values: FloatArray, sigma: FloatArray | None
) -> None:
    """A quantity over time at up to five positions, with 95 % bands if σ is given."""
    chosen = np.unique(np.linspace(0, len(position_m) - 1, min(6, len(position_m))).round().astype(int))[1:]
    for i, ink in zip(chosen, ordered_colours(len(chosen)), strict=True):
        axes.plot(t, values[:, i], color=ink, label=f"{position_m[i] * MM_PER_M:.0f} mm")
        if sigma is not None:
            reach = Z95 * sigma[:, i]
            axes.fill_between(t, values[:, i] - reach, values[:, i] + reach, color=ink, alpha=0.2, lw=0)
    limits_of(axes, values[:, chosen])
    handles, labels = axes.get_legend_handles_labels()
    if sigma is not None:
        handles.insert(0, axes.fill_between([], [], color=QUIET, alpha=0.3, lw=0))
        labels.insert(0, "95 %")
    key_of(key, handles[::-1], labels[::-1], title="at")


def surprises(
    axes: Axes, key: Axes, t: FloatArray, names: Sequence[str], extremes: tuple[FloatArray, FloatArray],
    quality: FloatArray, gate: float,
) -> None:  # fmt: skip
    """Innovation / σ, each sensor in its own lane between its gates, and a bar where it was not good."""
    lanes = len(names)
    for i in range(lanes):
        centre, ink = lanes - 1 - i, colour(i)
        axes.axhline(centre, color="#d3d7dd", lw=0.7, zorder=1)
        for edge in (-LANE, LANE):
            axes.axhline(centre + edge, color=QUIET, lw=0.7, ls=(0, (1, 2)), zorder=1)
        bottom, top = (centre + np.clip(v[:, i] * LANE / gate, -LANE, LANE) for v in extremes)
        axes.fill_between(t, bottom, top, color=ink, alpha=0.45, lw=0)
        axes.plot(t, (bottom + top) / 2, color=ink, lw=0.7)
        for level in _BAD:
            here = t[quality[:, i] == int(level)]
            axes.plot(here, np.full(len(here), centre - 0.46), "|", ms=5, mew=1.2, color=QUALITY[int(level)])
    axes.set_yticks(range(lanes), names[::-1])
    axes.set_ylim(-0.55, lanes - 0.45)
    axes.grid(visible=False, axis="y")
    axes.set_title("Innovations, in standard deviations between the gates")
    gates = axes.plot([], [], color=QUIET, lw=0.7, ls=(0, (1, 2)))
    seen = [level for level in _BAD if np.any(quality == int(level))]
    bars = [axes.plot([], [], "s", ms=7, color=QUALITY[int(level)])[0] for level in seen]
    key_of(key, [*gates, *bars], [f"gate, ±{gate:g} σ", *(level.label for level in seen)])


def quality_strip(axes: Axes, key: Axes, t: FloatArray, quality: FloatArray) -> None:
    """The quality of the estimate as a coloured strip."""
    from matplotlib.colors import ListedColormap  # noqa: PLC0415 - slow to import
    from matplotlib.patches import Patch  # noqa: PLC0415

    axes.pcolormesh(
        _edges(t),
        [0.0, 1.0],
        quality[None, :],
        cmap=ListedColormap(list(ESTIMATE_QUALITY)),
        vmin=-0.5,
        vmax=len(ESTIMATE_QUALITY) - 0.5,
        rasterized=True,
    )
    axes.set_yticks([0.5], ["quality"])
    axes.grid(visible=False)
    seen = sorted({int(EstimateQuality.GOOD), *np.unique(quality).astype(int).tolist()})
    patches = [Patch(color=ESTIMATE_QUALITY[q]) for q in seen]
    key_of(key, patches, [EstimateQuality(q).label for q in seen])


def predictions(
    axes: Axes,
    key: Axes,
    t: FloatArray,
    names: Sequence[str],
    predicted_degC: FloatArray,
    measured_degC: FloatArray,
) -> None:
    """The sensors as predicted, and as measured where the program has their channels."""
    some = np.isfinite(measured_degC).any()
    for i, name in enumerate(names):
        axes.plot(t, measured_degC[:, i], color=colour(i), lw=0.8, alpha=0.45)
        axes.plot(t, predicted_degC[:, i], color=colour(i), label=name)
    limits_of(axes, np.hstack([predicted_degC, measured_degC]) if some else predicted_degC)
    axes.set(
        title="Sensors: predicted (bold) and measured (faint)" if some else "Sensors, predicted", ylabel="°C"
    )
    key_of(key, *axes.get_legend_handles_labels())


def key_of(axes: Axes, handles: Sequence[Artist], labels: Sequence[str], title: str | None = None) -> None:
    """A legend alone on its axes."""
    axes.axis("off")
    axes.legend(
        handles, labels, loc="center left", borderaxespad=0.0, bbox_to_anchor=(0.0, 0.5), title=title,
        alignment="left",
    )  # fmt: skip


def limits_of(axes: Axes, values: FloatArray) -> None:
    """Limits from the values themselves, so that a wide band at the start does not flatten everything."""
    if not np.isfinite(values).any():
        return  # nothing was ever known
    low, high = float(np.nanmin(values)), float(np.nanmax(values))
    pad = 0.12 * max(high - low, 1e-6 + 0.01 * abs(high))
    axes.set_ylim(low - pad, high + pad)


def _edges(t: FloatArray) -> FloatArray:
    """Edges (n+1,) of cells that end at the samples."""
    first = t[0] - (t[1] - t[0] if len(t) > 1 else 1.0)
    return np.concatenate([[first], t])
