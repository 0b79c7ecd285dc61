"""How large a fault of a sensor must be to be noticed, and within what time: covariances over a shift.

A jump is held against the innovations of the estimate (`observer.kernels.screening`), a slow fault against
what a filter that never had the sensor expects of it (`observer.estimators.bank`). What is noticed is what is
beyond the limit by as much as chance takes from it in one case of twenty.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from observer.estimators.bank import DUE_S
from observer.estimators.design.spread import MOST_WORK, moments
from observer.estimators.fault_search import MISFIT
from observer.frames import FloatArray
from observer.kernels.screening import DRIFT_K_S, JUMP_SIGMA, LASTS_S, LASTS_SAMPLES, LEAST_JUMP_K
from observer.model.cycle import Stage
from observer.model.plant import Plant

PROBABLY_SIGMA = 1.64
"""By so many standard deviations beyond a limit, a fault is beyond it 95 % of the time."""
SLOW_SIGMA = MISFIT + PROBABLY_SIGMA
JUMP_STEP_S, SLOW_STEP_S = 10.0, 30.0
"""Steps over the shift: what is known from one sample to the next takes short ones."""


class Noticed(NamedTuple):
    """Of each sensor, (s,): the least jump that is noticed, K, within what time, s, and the least fault that
    comes slowly, K, NaN where nothing looks for it.
    """

    jump_K: FloatArray
    within_s: FloatArray
    slow_K: FloatArray


def noticed(plant: Plant, shift: Sequence[Stage], sample_s: FloatArray) -> Noticed | None:
    """Return what is noticed of sensors that have a sample every `sample_s` (s,).

    The plant is one that knows its tolerances (`build_plant` with `learns`). Slow faults are those of sensors
    that other sensors hold a model against; a model without tolerances is trusted for none. None where it
    would take long.
    """
    s = plant.rows.sensors
    sigma_K = _of_readings(plant, shift, np.ones((1, s)), sample_s, JUMP_STEP_S)
    own_K: FloatArray | None = np.full((s, s), np.nan)
    if plant.learnt and sigma_K is not None:
        own_K = _of_readings(plant, shift, 1.0 - np.eye(s), np.maximum(sample_s, DUE_S), SLOW_STEP_S)
    if sigma_K is None or own_K is None:
        return None
    limit_K = np.maximum(JUMP_SIGMA * sigma_K[0], LEAST_JUMP_K) + DRIFT_K_S * sample_s
    return Noticed(
        limit_K + PROBABLY_SIGMA * sigma_K[0],
        np.array([_decided_s(each) for each in sample_s.tolist()]),
        SLOW_SIGMA * own_K.diagonal(),
    )


def slow_fault_K(plant: Plant, shift: Sequence[Stage], sample_s: FloatArray, sensor: int) -> float | None:
    """Return the least slow fault of one sensor that is noticed; None where it would take long."""
    others = np.ones((1, plant.rows.sensors))
    others[0, sensor] = 0.0
    sigma_K = _of_readings(plant, shift, others, np.maximum(sample_s, DUE_S), SLOW_STEP_S)
    return None if sigma_K is None else SLOW_SIGMA * float(sigma_K[0, sensor])


def _of_readings(
    plant: Plant, shift: Sequence[Stage], uses: FloatArray, every_s: FloatArray, step_s: float
) -> FloatArray | None:
    """Mean σ (v, s) of each reading about what a filter expects of it that takes those which `uses` (v, s)
    names, each every so many s, `every_s` (s,). None where it would take long.
    """
    a = plant.parameters
    n = len(plant.decay_1_s) + int(plant.estimated.sum()) + len(a.kind)
    if n**3 * len(uses) * sum(stage.duration_s for stage in shift) / step_s > MOST_WORK:
        return None
    weight_1_K = uses * np.sqrt(step_s / (every_s * plant.noise_R_K2))
    found, sigma = [], np.tile(a.sigma, (len(uses), 1))
    for now in moments(plant, a, shift, sigma, None, step_s, weight_1_K):
        rows = now.H.reshape(-1, now.H.shape[-1])
        variance_K2 = ((rows @ now.P) * rows).sum(axis=-1).reshape(len(uses), *now.H.shape[:2])
        found.append(np.sqrt(variance_K2.mean(axis=1) + plant.noise_R_K2))
    return np.asarray(np.mean(found, axis=0))


def _decided_s(sample_s: float) -> float:
    """How long after it began a jump is decided at the latest: the samples that it must last, and that it
    may begin just after one.
    """
    lasted_s, samples = 0.0, 1
    while samples < LASTS_SAMPLES or lasted_s < LASTS_S:
        lasted_s, samples = lasted_s + sample_s, samples + 1
    return lasted_s + sample_s
