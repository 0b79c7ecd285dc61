"""Kuznetsov's rod with a heat at each end: the image series of its field and of its growth, and their limit.

Written from the Laplace transform of his equations (6) and (7). With p = √(s/α + m²) a heat Q_1 at x = 0
gives Q_1/(k A s p) Σ_n [e^{−p(2nL+x)} + e^{−p(2(n+1)L−x)}], whose inverse is the series (8) with
U = √a (2nL + x): the print's (2nL − x) in the list below (8) is a slip that his later list corrects.
"""

from __future__ import annotations

import math

import numpy as np
from scipy.special import erf, erfc, erfcx

from tests.truth.bar import Bar, FloatArray


def fin_1_m(bar: Bar) -> float:
    """m = √(4 h/(k d))."""
    return math.sqrt(4.0 * bar.convection_W_m2K / (bar.conductivity_W_mK * bar.diameter_m))


def field(
    bar: Bar, left_W: float, right_W: float, position_m: FloatArray, time_s: float, images: int = 40
) -> FloatArray:
    """Rise (P,) at a time after both heats were switched on (8); the film must not be zero."""
    total = np.zeros_like(position_m)
    for heat_W, x in ((left_W, position_m), (right_W, bar.length_m - position_m)):
        for n in range(images):
            for path in (2 * n * bar.length_m + x, 2 * (n + 1) * bar.length_m - x):
                total += heat_W * _image(bar, path, time_s)
    return total / (2.0 * bar.conductance_Wm_K * fin_1_m(bar))


def growth(
    bar: Bar, left_W: float, right_W: float, position_m: FloatArray, time_s: float, images: int = 40
) -> FloatArray:
    """∫_0^x of the field, K m, (P,): each image integrated in closed form, as in (15) to (26)."""
    L, total = bar.length_m, np.zeros_like(position_m)
    for n in range(images):
        near, far = 2 * n * L, 2 * (n + 1) * L
        total += left_W * (_grown(bar, near + position_m, time_s) - _grown(bar, near, time_s))
        total += left_W * (_grown(bar, far, time_s) - _grown(bar, far - position_m, time_s))
        odd = (2 * n + 1) * L
        total += right_W * (_grown(bar, odd, time_s) - _grown(bar, odd - position_m, time_s))
        total += right_W * (_grown(bar, odd + position_m, time_s) - _grown(bar, odd, time_s))
    return total / (2.0 * bar.conductance_Wm_K * fin_1_m(bar))


def _terms(bar: Bar, path_m: FloatArray | float, time_s: float) -> tuple[FloatArray, FloatArray]:
    """e^{−ms} erfc(z − β) and e^{ms} erfc(z + β), z = s/(2√(αt)), β = m√(αt); neither overflows."""
    m, spread = fin_1_m(bar), math.sqrt(bar.diffusivity_m2_s * time_s)
    s = np.asarray(path_m, dtype=float)
    z, beta = s / (2.0 * spread), m * spread
    return np.exp(-m * s) * erfc(z - beta), np.exp(m * s - (z + beta) ** 2) * erfcx(z + beta)


def _image(bar: Bar, path_m: FloatArray, time_s: float) -> FloatArray:
    falling, rising = _terms(bar, path_m, time_s)
    return falling - rising


def _grown(bar: Bar, path_m: FloatArray | float, time_s: float) -> FloatArray:
    """An antiderivative of an image along its path."""
    m, spread = fin_1_m(bar), math.sqrt(bar.diffusivity_m2_s * time_s)
    falling, rising = _terms(bar, path_m, time_s)
    both = math.exp(-((m * spread) ** 2)) * erf(np.asarray(path_m) / (2.0 * spread))
    return -(falling + rising + 2.0 * both) / m


def steady_growth(bar: Bar, left_W: float, right_W: float, position_m: FloatArray) -> FloatArray:
    """∫_0^x of the steady field, K m, (P,): the first part of (31).

    (31) prints a minus before Q_1 where its own derivation (29) has a plus; both heats enter the rod.
    """
    m, L = fin_1_m(bar), bar.length_m
    right = np.sinh(m * position_m) / math.sinh(m * L)
    left = 1.0 - np.sinh(m * (L - position_m)) / math.sinh(m * L)
    return (right_W * right + left_W * left) / (bar.conductance_Wm_K * m**2)


def steady_displacement_um(
    bar: Bar,
    heats_W: tuple[float, float],
    stiffness_N_m: tuple[float, float],
    modulus_Pa: float,
    position_m: FloatArray,
) -> FloatArray:
    """U(x) at rest between two elastic supports (31), µm."""
    EF = modulus_Pa * bar.area_m2
    j1, j2 = stiffness_N_m
    total = 1.0 / (1.0 / j1 + 1.0 / j2 + bar.length_m / EF)
    free = steady_growth(bar, *heats_W, position_m)
    whole = sum(heats_W) / (bar.conductance_Wm_K * fin_1_m(bar) ** 2)
    return 1e6 * bar.expansion_1_K * (free - total * (1.0 / j1 + position_m / EF) * whole)


def share_past_a_support(
    m1_1_m: float, length1_m: float, m2_1_m: float, length2_m: float, end_1_m: float
) -> float:
    """Share of a heat at a support that flows into the long part (9), beside an overhang with a face film.

    `end_1_m` is h_end/k. The overhang's D_m is right in (9), but the K_Q that it prints,
    D_m/(1 + (m_1/m_2) D_m th(m_1 L_1)), is no share: it must be multiplied by (m_1/m_2) th(m_1 L_1).
    """
    K = (m2_1_m + end_1_m) / (m2_1_m - end_1_m)
    D = (K * math.exp(2 * length2_m * m2_1_m) + 1) / (K * math.exp(2 * length2_m * m2_1_m) - 1)
    inner = m1_1_m / m2_1_m * D * math.tanh(m1_1_m * length1_m)
    return inner / (1.0 + inner)


def displacement_um(
    bar: Bar,
    heats_W: tuple[float, float],
    stiffness_N_m: tuple[float, float],
    modulus_Pa: float,
    preload_N: float,
    gap_m: float,
    position_m: FloatArray,
    time_s: float,
) -> FloatArray:
    """U(x), µm, (P,), at a time after both heats were switched on, between supports of which the second has
    play, by the force that closes each of the three stages: while the pre-tension P lasts both hold; then the
    screw grows across the gap; then both hold what grows on (12), (13).
    """
    EF = modulus_Pa * bar.area_m2
    j1, j2 = stiffness_N_m
    compliance = 1.0 / j1 + 1.0 / j2 + bar.length_m / EF
    free_m = bar.expansion_1_K * growth(bar, *heats_W, position_m, time_s)
    whole_m = float(bar.expansion_1_K * growth(bar, *heats_W, np.array([bar.length_m]), time_s)[0])
    slack_m = preload_N * compliance
    if whole_m <= slack_m:
        less_N = whole_m / compliance
    elif whole_m <= slack_m + gap_m:
        less_N = preload_N
    else:
        less_N = preload_N + (whole_m - slack_m - gap_m) / compliance
    return 1e6 * (free_m - less_N * (1.0 / j1 + position_m / EF))
