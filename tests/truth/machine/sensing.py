"""From section means to what a log shows: lag, contact, offset, noise, rounding."""

from __future__ import annotations

import numpy as np

from tests.truth.machine.compiling import cached
from tests.truth.machine.machine import Machine
from tests.truth.machine.physics import FloatArray

NOISE_K = 0.05


@cached()
def lagged(value: FloatArray, step_s: float, lag_s: FloatArray) -> FloatArray:
    """First-order lag of each column of (K + 1, P), exact for a value linear between samples."""
    out = value.copy()
    for p in range(value.shape[1]):
        if lag_s[p] <= 0.0:
            continue
        fade = np.exp(-step_s / lag_s[p])
        mean = lag_s[p] / step_s * (1.0 - fade)
        for k in range(1, len(value)):
            old, new = value[k - 1, p], value[k, p]
            out[k, p] = fade * out[k - 1, p] + (mean - fade) * old + (1.0 - mean) * new
    return out


def true_readings(
    machine: Machine, section_degC: FloatArray, air_degC: FloatArray, contact: FloatArray, step_s: float
) -> FloatArray:
    """What the sensors would show without noise and rounding, (K + 1, P)."""
    felt = air_degC[:, None] + contact * (section_degC - air_degC[:, None])
    time_h = np.arange(len(section_degC))[:, None] * step_s / 3600.0
    felt = felt - machine.toward_air * (felt - air_degC[:, None])
    return lagged(felt, step_s, machine.lag_s) + machine.offset_K + machine.drift_K_h * time_h


def shown(reading_degC: FloatArray, rng: np.random.Generator, step_K: float = 0.01) -> FloatArray:
    """Readings with white noise, rounded to the step of the module."""
    noisy = reading_degC + NOISE_K * rng.standard_normal(reading_degC.shape)
    return np.round(noisy / step_K) * step_K
