"""The gain in thermal error by a change of the model: the error of predictions without and with it, on
the proof.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from observer.config.machine import Config
from observer.fit.problem import Problem
from observer.frames import FloatArray

PLACES = 41
UM_PER_M = 1e6


class Worth(NamedTuple):
    """The error of a predicted thermal error on the proof, before and after.

    Each is taken at the place within the strokes where its root mean square is largest.

    Attributes:
        before_rms_um: Rms before, µm.
        after_rms_um: Rms after, µm.
        before_largest_um: Largest magnitude at that place before, µm.
        after_largest_um: The same after, µm.
        before_position_m: That place before, m.
        after_position_m: That place after, m.
    """

    before_rms_um: float
    after_rms_um: float
    before_largest_um: float
    after_largest_um: float
    before_position_m: float
    after_position_m: float


def worth_of(problem: Problem, before: Config, after: Config) -> Worth | None:
    """Return the error of `after` compared with `before`; None without an expansion coefficient or a sensor
    on the screw.

    The screw is free and held at its left end: u(x) = α ∫₀ˣ ΔT dx. After, ΔT is measured minus predicted,
    linear between the sensors and constant beyond the outermost, their own offsets included. Before, the
    difference of both predicted fields is added to it. So an error that only a sensor shows is not counted as
    one of the screw.

    Args:
        problem: Data, of which the proof counts.
        before: Configuration without the change.
        after: Configuration with it.
    """
    screw, evidence = problem.config.screw, problem.evidence
    place_m = np.array([np.nan if s.position_m is None else s.position_m for s in problem.config.sensor])
    rows = evidence.proof & np.isfinite(place_m)[evidence.sensor]
    if screw.expansion_1_K is None or not rows.any():
        return None
    x_m, run = np.linspace(0.0, screw.length_m, PLACES), int(evidence.run[rows][0])
    means = np.unique(evidence.mean[rows])
    error_K, remains_K = problem.error_K(after), np.empty((len(means), PLACES))
    for i, mean in enumerate(means.tolist()):
        of_mean = np.flatnonzero(rows & (evidence.mean == mean))
        of_mean = of_mean[np.argsort(place_m[evidence.sensor[of_mean]])]
        remains_K[i] = np.interp(x_m, place_m[evidence.sensor[of_mean]], error_K[of_mean])
    lacks_K = _means(problem, after, x_m, run)[means] - _means(problem, before, x_m, run)[means]
    growth_um_K = UM_PER_M * screw.expansion_1_K * (x_m[1] - x_m[0])
    before_um, after_um = (growth_um_K * _running_sum(K) for K in (remains_K + lacks_K, remains_K))
    inside, most = _within_strokes(problem.config, x_m), []
    for error_um in (before_um, after_um):
        rms_um = np.sqrt(np.mean(error_um**2, axis=0))
        worst = int(np.argmax(np.where(inside, rms_um, -1.0)))
        most.append((float(rms_um[worst]), float(np.abs(error_um[:, worst]).max()), float(x_m[worst])))
    (before_rms, before_most, before_m), (after_rms, after_most, after_m) = most
    return Worth(before_rms, after_rms, before_most, after_most, before_m, after_m)


def _running_sum(values: FloatArray) -> FloatArray:
    """Return the trapezoidal sum (b, P) from the first column to each, in steps."""
    steps = 0.5 * (values[:, 1:] + values[:, :-1])
    return np.asarray(np.cumsum(np.pad(steps, ((0, 0), (1, 0))), axis=1))


def _means(problem: Problem, config: Config, x_m: FloatArray, run: int) -> FloatArray:
    """Return the predicted field (b, P) of a run in half-minute means, °C."""
    mean = problem.forward.runs[run].ticks.mean
    sums = np.zeros((int(mean.max()) + 1, len(x_m)))
    np.add.at(sums, mean, problem.forward.fields(config, x_m)[run][0])
    return np.asarray(sums / np.maximum(np.bincount(mean), 1)[:, None])


def _within_strokes(config: Config, x_m: FloatArray) -> FloatArray:
    """Return which positions (P,) a nut reaches; all of them if no stroke is configured."""
    strokes = [s.stroke_m for s in config.source if s.stroke_m is not None]
    inside = [(x_m >= low) & (x_m <= high) for low, high in strokes]
    reached = np.any(inside, axis=0) if inside else np.ones(len(x_m), dtype=bool)
    return np.asarray(reached if reached.any() else ~reached)
