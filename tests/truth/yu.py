"""Yu's responses of the screw: steady exponentials, the step and its product form, any periodic end."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from scipy.special import erfc

from tests.truth.bar import Bar, FloatArray
from tests.truth.kuznetsov import fin_1_m


def steady(bar: Bar, left_K: float, right_K: float, position_m: FloatArray) -> FloatArray:
    """C_1 e^{mx} + C_2 e^{−mx} with the constants of two known end rises (7)."""
    m, L = fin_1_m(bar), bar.length_m
    C1, C2 = np.linalg.solve([[1.0, 1.0], [math.exp(m * L), math.exp(-m * L)]], [left_K, right_K])
    return np.asarray(C1 * np.exp(m * position_m) + C2 * np.exp(-m * position_m))


def product(bar: Bar, rise_K: float, position_m: FloatArray, time_s: float) -> FloatArray:
    """The paper's (8) for a long screw: its steady rise times the step response without a film."""
    spread = math.sqrt(bar.diffusivity_m2_s * time_s)
    return rise_K * np.exp(-fin_1_m(bar) * position_m) * erfc(position_m / (2.0 * spread))


def step_with_film(bar: Bar, rise_K: float, position_m: FloatArray, time_s: float) -> FloatArray:
    """What (8) stands for: the face of a long screw with a film jumps by a rise (C&J §4.2, half-space).

    ½ [e^{−mx} erfc(x/2√(αt) − m√(αt)) + e^{mx} erfc(x/2√(αt) + m√(αt))].
    """
    m, spread = fin_1_m(bar), math.sqrt(bar.diffusivity_m2_s * time_s)
    z = position_m / (2.0 * spread)
    falling = np.exp(-m * position_m) * erfc(z - m * spread)
    return 0.5 * rise_K * (falling + np.exp(m * position_m) * erfc(z + m * spread))


def periodic(
    bar: Bar,
    harmonics: Sequence[tuple[float, float]],
    omega_1_s: float,
    position_m: float,
    time_s: FloatArray,
) -> FloatArray:
    """Rise at a depth under a face that moves as Σ T_n cos(n ω t − φ_n), harmonics (T_n, φ_n) (10), (14).

    Each dies out as e^{−x√(nω/2α)} and lags by x√(nω/2α) (12). (11) adds the mean to the amplitude: that is
    the peak.
    """
    total = np.zeros_like(time_s)
    for n, (size_K, phase) in enumerate(harmonics, 1):
        depth = position_m * math.sqrt(n * omega_1_s / (2.0 * bar.diffusivity_m2_s))
        total += size_K * math.exp(-depth) * np.cos(n * omega_1_s * time_s - depth - phase)
    return total
