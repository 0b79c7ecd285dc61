"""The picture of an estimator: its poles, and how it follows a heat, in time and by frequency."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from observer.estimators.design.response import HeatResponse, heat_response
from observer.installation import Installation
from observer.model.build import build_plant
from observer.report.panels import QUIET, colour
from observer.report.pictures import drawn

if TYPE_CHECKING:
    from matplotlib.axes import Axes

LEAST_1_S = 1e-7
"""Slower poles are drawn at the edge, as 0."""
NEARLY = 0.02
"""Part of a step to which an estimate has come when it counts as settled."""


def write_responses(path: Path, config: Installation, found: dict[str, Any]) -> None:
    """Draw what `findings` has of poles, and the responses of the configuration's estimator."""
    plant = build_plant(config)
    answer = heat_response(plant, config.estimator)
    with drawn(path, 14.0, 9.0) as figure:
        (poles, step), (gain, phase) = figure.subplots(2, 2)
        figure.suptitle(
            f"{config.machine.name}, axis {config.machine.axis}: {found['estimator']} estimator",
            weight="bold",
        )
        _poles(poles, found)
        if answer is None:
            for axes in (step, gain, phase):
                axes.set_axis_off()
            step.text(0.0, 0.9, "No gain works, so there is no response.", transform=step.transAxes)
        else:
            _responses(step, gain, phase, answer, plant.layout.sources)


def _poles(axes: Axes, found: dict[str, Any]) -> None:
    """Each set of poles on a line of its own; complex ones as rings."""
    reached = [
        complex(*p)
        for p in zip(found["poles_reached_1_s"], found["poles_reached_imaginary_1_s"], strict=True)
    ]
    rows = {"plant": found["eigenvalues_1_s"], "requested": found["poles_requested_1_s"], "reached": reached}
    kept = {name: np.array(values, dtype=complex) for name, values in rows.items() if len(values)}
    for i, values in enumerate(kept.values()):
        real, ring = np.maximum(-values.real, LEAST_1_S), np.abs(values.imag) > 1e-3 * np.abs(values.real)
        axes.plot(real[~ring], np.full((~ring).sum(), -i), "x", ms=9, mew=1.6, color=colour(i))
        axes.plot(real[ring], np.full(ring.sum(), -i), "o", ms=8, mfc="none", mew=1.6, color=colour(i))
        growing = int((values.real > LEAST_1_S).sum())
        if growing:
            axes.text(1.0, -i + 0.15, f"{growing} unstable", transform=axes.get_yaxis_transform(), ha="right")
    axes.set_xscale("log")
    axes.set_yticks([-i for i in range(len(kept))], list(kept))
    axes.set_ylim(-len(kept) + 0.5, 0.5)
    axes.set(title="Poles (ring: complex; far left: 0)", xlabel="rate −Re, 1/s")


def _responses(step: Axes, gain: Axes, phase: Axes, answer: HeatResponse, names: tuple[str, ...]) -> None:
    away = np.abs(answer.step - 1.0).max(axis=1) > NEARLY
    until_s = 1.3 * answer.time_s[min(int(np.flatnonzero(away)[-1]) + 1, len(away) - 1) if away.any() else 0]
    for i, name in enumerate(names):
        style: dict[str, Any] = {"color": colour(i), "label": name}
        step.plot(np.append(0.0, answer.time_s), np.append(0.0, answer.step[:, i]), **style)
        gain.loglog(answer.frequency_rad_s, np.abs(answer.transfer[:, i]), **style)
        phase.semilogx(
            answer.frequency_rad_s, np.degrees(np.unwrap(np.angle(answer.transfer[:, i]))), **style
        )
    step.axhline(1.0, color=QUIET, lw=0.8)
    gain.axhline(1.0, color=QUIET, lw=0.8)
    gain.axhline(np.sqrt(0.5), color=QUIET, lw=0.8, ls=(0, (4, 2)))
    step.set(title="Estimate after a step of 1 W", xlabel="time, s", ylabel="W", xlim=(0.0, until_s))
    gain.set(title="Estimated over true heat (dashes: −3 dB)", xlabel="frequency, rad/s", ylabel="W/W")
    gain.set_ylim(bottom=max(gain.get_ylim()[0], 1e-3))
    phase.set(title="Phase", xlabel="frequency, rad/s", ylabel="°")
    step.legend(loc="best")
