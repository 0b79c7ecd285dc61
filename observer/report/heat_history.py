"""`heat.png`: the heats over a whole log, each with its 95 % band, and the temperatures that tell them."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from observer.config import Config
from observer.frames import FloatArray, Inputs
from observer.history.history import HeatHistory
from observer.report.collect import Decimator
from observer.report.overview import page_of
from observer.report.panels import Z95, key_of, limits_of
from observer.report.style import QUIET, colour

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_SENSORS_HEIGHT, _HEAT_HEIGHT = 2.6, 2.4


def write_heat_history(
    path: Path, config: Config, history: HeatHistory, blocks: Sequence[Inputs], title: str, method: str
) -> None:
    """Draw a panel for each heat and one for the sensors; `title` says of what, `method` by which method.

    `blocks` are the inputs that the history was made from. The file is written whole or not at all.
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
    reach = Z95 * samples.last("sigma_W")[:, i]
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
    limits_of(axes, _with_usual_band(np.column_stack(shown), heat, reach))
    axes.set(title=f"Heat of {name}", ylabel="W")
    key_of(key, handles, labels)


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
    limits_of(axes, measured_degC)
    axes.set(title="Measured temperatures", ylabel="°C")
    key_of(key, handles, labels, title="unexplained, rms")
