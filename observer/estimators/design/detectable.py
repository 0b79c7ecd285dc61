"""How large a fault of a sensor must be to be noticed, and within what time: the filter's σ over a shift.

A jump is compared with the innovations of the estimate (`observer.kernels.screening`). A slow fault is
compared with a filter that does not use the sensor (`observer.estimators.bank`). A fault counts as noticed if
noise hides it in at most one case of twenty.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from observer.config.machine import Config
from observer.estimators.bank import DUE_S
from observer.estimators.design.spread import NotDefined, spread
from observer.estimators.fault_search import MISFIT
from observer.frames import FloatArray
from observer.kernels.screening import DRIFT_K_S, JUMP_SIGMA, LASTS_S, LASTS_SAMPLES, LEAST_JUMP_K
from observer.model.plant import Plant

PROBABLY_SIGMA = 1.64
"""By so many standard deviations beyond a limit, a fault is beyond it 95 % of the time."""
SLOW_SIGMA = MISFIT + PROBABLY_SIGMA
_UNUSED_K2 = 1e8
"""Variance with which a reading corrects nothing."""


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


def noticed(config: Config, plant: Plant) -> Noticed | NotDefined:
    """Return the smallest faults of each sensor that are noticed in 95 % of the cases.

    σ are means over the standard shift. A jump must exceed the screening's limit by 1.64 σ, a slow fault
    `MISFIT` by as much.

    Args:
        config: The machine; its estimator is a Kalman filter.
        plant: The model with its tolerances (`build_plant` with `learns`). Without tolerances slow faults are
            NaN.

    Returns:
        The faults, or the reason why they are not computed.
    """
    s, sample_s = plant.rows.sensors, config.reading_s
    sigmas = spread(config, [plant], sample_s)
    slow_K = slow_faults_K(config, plant, range(s)) if plant.learnt else np.full(s, np.nan)
    if isinstance(sigmas, NotDefined):
        return sigmas
    if isinstance(slow_K, NotDefined):
        return slow_K
    sigma_K = np.sqrt(sigmas.reading_K[0] ** 2 + plant.noise_R_K2)
    limit_K = np.maximum(JUMP_SIGMA * sigma_K, LEAST_JUMP_K) + DRIFT_K_S * sample_s
    within_s = np.array([_decided_s(period_s) for period_s in sample_s.tolist()])
    return Noticed(limit_K + PROBABLY_SIGMA * sigma_K, within_s, slow_K)


def slow_faults_K(config: Config, plant: Plant, sensors: Sequence[int]) -> FloatArray | NotDefined:
    """Return the smallest slow faults of r sensors that are noticed in 95 % of the cases, K, (r,).

    Args:
        config: The machine; its estimator is a Kalman filter.
        plant: The model with its tolerances.
        sensors: Their numbers. The filter that each is compared with uses all others.

    Returns:
        The faults, or the reason why they are not computed.
    """
    left_out = np.eye(plant.rows.sensors, dtype=np.bool_)[list(sensors)]
    without = [replace(plant, noise_R_K2=np.where(row, _UNUSED_K2, plant.noise_R_K2)) for row in left_out]
    sigmas = spread(config, without, np.maximum(config.reading_s, DUE_S))
    if isinstance(sigmas, NotDefined):
        return sigmas
    return SLOW_SIGMA * np.sqrt(sigmas.reading_K[left_out] ** 2 + plant.noise_R_K2[list(sensors)])


def _decided_s(sample_s: float) -> float:
    """Return the longest time from the start of a jump to its detection, s.

    It is the time that the jump must last, plus one sample period, because it may begin just after a sample.
    """
    lasted_s, samples = 0.0, 1
    while samples < LASTS_SAMPLES or lasted_s < LASTS_S:
        lasted_s, samples = lasted_s + sample_s, samples + 1
    return lasted_s + sample_s
