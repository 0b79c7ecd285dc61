"""How large a fault of a sensor must be to be noticed, and within what time: covariances over a shift.

A jump is compared with the innovations of the estimate (`observer.kernels.screening`). A slow fault is
compared with a filter that does not use the sensor (`observer.estimators.bank`). A fault counts as noticed if
noise hides it in at most one case of twenty.
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
"""Steps over the shift for jumps, which need the σ from one sample to the next, and for slow faults."""


class Noticed(NamedTuple):
    """Smallest noticed faults of each of s sensors.

    Attributes:
        jump_K: A jump that is noticed, K, (s,).
        within_s: Longest time until it is noticed, s, (s,).
        slow_K: A slow fault that is noticed, K, (s,), NaN without a test for it.
    """

    jump_K: FloatArray
    within_s: FloatArray
    slow_K: FloatArray


def noticed(plant: Plant, shift: Sequence[Stage], sample_s: FloatArray) -> Noticed | None:
    """Return the smallest faults of each sensor that are noticed in 95 % of the cases.

    σ are means over the shift. A jump must exceed the screening's limit by 1.64 σ, a slow fault `MISFIT` by
    as much.

    Args:
        plant: The model with its tolerances (`build_plant` with `learns`). Without tolerances slow faults are
            NaN.
        shift: Stages of a day of work.
        sample_s: Time between samples of each sensor, s, (s,).

    Returns:
        The faults, or None if the computation would take long (`spread.MOST_WORK`).
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
        np.array([_decided_s(period_s) for period_s in sample_s.tolist()]),
        SLOW_SIGMA * own_K.diagonal(),
    )


def slow_fault_K(plant: Plant, shift: Sequence[Stage], sample_s: FloatArray, sensor: int) -> float | None:
    """Return the smallest slow fault of one sensor that is noticed in 95 % of the cases, K.

    Args:
        plant: The model with its tolerances.
        shift: Stages of a day of work.
        sample_s: Time between samples of each sensor, s, (s,).
        sensor: Its number. The filter it is compared with uses all others.

    Returns:
        The fault, or None if the computation would take long.
    """
    others = np.ones((1, plant.rows.sensors))
    others[0, sensor] = 0.0
    sigma_K = _of_readings(plant, shift, others, np.maximum(sample_s, DUE_S), SLOW_STEP_S)
    return None if sigma_K is None else SLOW_SIGMA * float(sigma_K[0, sensor])


def _of_readings(
    plant: Plant, shift: Sequence[Stage], uses: FloatArray, every_s: FloatArray, step_s: float
) -> FloatArray | None:
    """Return the mean σ (v, s) of each reading about the expectation of v filters.

    Filters take the readings marked in `uses` (v, s), each `every_s` (s,). Returns None if the computation
    would take long.
    """
    a = plant.parameters
    n = len(plant.decay_1_s) + int(plant.estimated.sum()) + len(a.kind)
    if n**3 * len(uses) * sum(stage.duration_s for stage in shift) / step_s > MOST_WORK:
        return None
    weight_1_K = uses * np.sqrt(step_s / (every_s * plant.noise_R_K2))
    sigmas_K, sigma = [], np.tile(a.sigma, (len(uses), 1))
    for now in moments(plant, a, shift, sigma, None, step_s, weight_1_K):
        rows = now.H.reshape(-1, now.H.shape[-1])
        variance_K2 = ((rows @ now.P) * rows).sum(axis=-1).reshape(len(uses), *now.H.shape[:2])
        sigmas_K.append(np.sqrt(variance_K2.mean(axis=1) + plant.noise_R_K2))
    return np.asarray(np.mean(sigmas_K, axis=0))


def _decided_s(sample_s: float) -> float:
    """Return the longest time from the start of a jump to its detection, s.

    It is the time that the jump must last, plus one sample period, because it may begin just after a sample.
    """
    lasted_s, samples = 0.0, 1
    while samples < LASTS_SAMPLES or lasted_s < LASTS_S:
        lasted_s, samples = lasted_s + sample_s, samples + 1
    return lasted_s + sample_s
