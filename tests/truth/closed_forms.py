"""Closed-form conduction, written from Carslaw & Jaeger, *Conduction of Heat in Solids* (2nd ed., 1959)."""

from __future__ import annotations

import itertools
import math

import mpmath as mp
import numpy as np
from scipy.special import erfc

from tests.truth.bar import Bar, End, FloatArray


def steady_fin(
    bar: Bar,
    ends: tuple[End, End],
    source_m: float,
    heat_W: float,
    position_m: FloatArray,
    *,
    ambient_degC: float = 0.0,
    left_degC: float = 0.0,
    right_degC: float = 0.0,
) -> FloatArray:
    """Steady temperature of a fin with a point heat anywhere, ends of any kind (C&J §4.2).

    Solves θ'' = m² θ on both sides of the source, θ = T − T_amb and m² = h π d/(k A): four constants from the
    two ends, continuity, and the jump −k A [θ'] = q. Without film and with both ends insulated there is no
    steady state.
    """
    mp.mp.dps = 40
    slope = mp.sqrt(mp.mpf(bar.film_W_mK) / mp.mpf(bar.conductance_Wm_K))
    length, source, wall = mp.mpf(bar.length_m), mp.mpf(source_m), mp.mpf(bar.conductance_Wm_K)

    def basis(x: mp.mpf) -> tuple[list[mp.mpf], list[mp.mpf]]:
        """Two solutions of θ'' = m² θ and their derivatives."""
        if slope == 0:
            return [mp.mpf(1), x], [mp.mpf(0), mp.mpf(1)]
        rise, fall = mp.cosh(slope * x), mp.sinh(slope * x)
        return [rise, fall], [slope * fall, slope * rise]

    matrix, right = mp.zeros(4, 4), mp.zeros(4, 1)
    places = ((ends[0], mp.mpf(0), left_degC, -1), (ends[1], length, right_degC, 1))
    for row, (end, x, wanted, outward) in enumerate(places):
        value, gradient = basis(x)
        for i in range(2):
            loss = outward * bar.conductivity_W_mK * gradient[i] + end.coefficient_W_m2K * value[i]
            matrix[row, 2 * row + i] = value[i] if end.kind == "prescribed" else loss
        right[row] = wanted - ambient_degC if end.kind == "prescribed" else 0
    value, gradient = basis(source)
    for i in range(2):
        matrix[2, i], matrix[2, 2 + i] = value[i], -value[i]
        matrix[3, i], matrix[3, 2 + i] = wall * gradient[i], -wall * gradient[i]
    right[3] = heat_W
    constants = mp.lu_solve(matrix, right)

    def temperature(x: float) -> float:
        first = 0 if x <= source_m else 2
        value, _ = basis(mp.mpf(x))
        return float(ambient_degC + constants[first] * value[0] + constants[first + 1] * value[1])

    return np.array([temperature(float(x)) for x in position_m])


def steady_fin_band(
    bar: Bar, ends: tuple[End, End], from_m: float, to_m: float, heat_W: float, position_m: FloatArray
) -> FloatArray:
    """Steady rise of a fin under a heat uniform over a stretch: point heats by Gauss–Legendre quadrature.

    The response to a point has a kink where it stands, so the stretch is cut at each position.
    """
    node, weight = np.polynomial.legendre.leggauss(12)
    rise = np.zeros(len(position_m))
    for i, x in enumerate(position_m):
        cuts = [from_m, *([x] if from_m < x < to_m else []), to_m]
        for low, high in itertools.pairwise(cuts):
            for n, w in zip(node, weight, strict=True):
                source_m = 0.5 * (low + high) + 0.5 * (high - low) * n
                share = 0.5 * (high - low) * w / (to_m - from_m)
                rise[i] += share * steady_fin(bar, ends, source_m, heat_W, np.array([x]))[0]
    return rise


def ierfc(x: FloatArray) -> FloatArray:
    """First integral of the complementary error function (C&J appendix II)."""
    return np.exp(-(x**2)) / math.sqrt(math.pi) - x * erfc(x)


def half_space_flux(bar: Bar, heat_W: float, position_m: FloatArray, time_s: float) -> FloatArray:
    """Rise of a half-space under a constant flux (C&J §2.9 (7)): 2 q √(αt)/k · ierfc(x/(2√(αt)))."""
    reach_m = math.sqrt(bar.diffusivity_m2_s * time_s)
    return 2.0 * heat_W / bar.conductance_Wm_K * reach_m * ierfc(position_m / (2.0 * reach_m))


def half_space_step(bar: Bar, rise_K: float, position_m: FloatArray, time_s: float) -> FloatArray:
    """Rise of a half-space whose face jumps by `rise_K` (C&J §2.4 (10))."""
    return rise_K * np.asarray(erfc(position_m / (2.0 * math.sqrt(bar.diffusivity_m2_s * time_s))))


def half_space_periodic(
    bar: Bar, amplitude_K: float, period_s: float, position_m: float, time_s: FloatArray
) -> FloatArray:
    """Settled rise of a half-space whose face follows a sine (C&J §2.6 (8)).

    The amplitude falls as e^{−κx}, the phase lags by κx, with κ = √(ω/2α).
    """
    omega = 2.0 * math.pi / period_s
    decay = position_m * math.sqrt(omega / (2.0 * bar.diffusivity_m2_s))
    return amplitude_K * math.exp(-decay) * np.sin(omega * time_s - decay)


def prescribed_rod(
    bar: Bar, source_m: float, heat_W: float, position_m: FloatArray, time_s: float, terms: int = 4000
) -> FloatArray:
    """Rise of a rod held at 0 at both ends under a point heat from t = 0 (Kim, fig. 4; C&J §3.14).

    Fourier sine series; its steady part is taken in closed form, so only the transient is summed.
    """
    held = End("prescribed")
    n = np.arange(1, terms + 1)
    wave = n * math.pi / bar.length_m
    rate = bar.diffusivity_m2_s * wave**2 + bar.film_W_mK / bar.capacity_J_mK
    weight = np.sin(wave * source_m) / rate * np.exp(-rate * time_s)
    transient = (
        2.0 * heat_W / (bar.capacity_J_mK * bar.length_m) * np.sin(np.outer(position_m, wave)) @ weight
    )
    return steady_fin(bar, (held, held), source_m, heat_W, position_m) - transient


def insulated_rod(
    bar: Bar, heat_W: float, position_m: FloatArray, time_s: float, terms: int = 2000
) -> FloatArray:
    """Rise of a rod without film, insulated at x = L, under a constant heat through x = 0 (C&J §3.8 (3))."""
    length_m, depth = bar.length_m, bar.length_m - position_m
    n = np.arange(1, terms + 1)
    fade = (-1.0) ** n / n**2 * np.exp(-bar.diffusivity_m2_s * (n * math.pi / length_m) ** 2 * time_s)
    series = np.cos(np.outer(depth, n) * math.pi / length_m) @ fade
    shape = (3.0 * depth**2 - length_m**2) / (6.0 * length_m**2) - 2.0 / math.pi**2 * series
    mean_K = heat_W * time_s / (bar.capacity_J_mK * length_m)
    return mean_K + heat_W * length_m / bar.conductance_Wm_K * shape


def cooling_slab(
    bar: Bar,
    coefficient_W_m2K: float,
    initial_K: float,
    position_m: FloatArray,
    time_s: float,
    terms: int = 40,
) -> FloatArray:
    """Rise over ambient of a rod without film, insulated at x = 0, convective at x = L (C&J §3.11 (12)).

    θ = θ_0 Σ 4 sin β/(2β + sin 2β) cos(β x/L) e^{−β² α t/L²} with β tan β = Bi.
    """
    biot = coefficient_W_m2K * bar.length_m / bar.conductivity_W_mK
    rise = np.zeros(len(position_m))
    for n in range(terms):
        low, high = n * mp.pi + mp.mpf("1e-12"), n * mp.pi + mp.pi / 2 - mp.mpf("1e-12")
        beta = float(mp.findroot(lambda b: b * mp.sin(b) - biot * mp.cos(b), (low, high), solver="anderson"))
        weight = 4.0 * math.sin(beta) / (2.0 * beta + math.sin(2.0 * beta))
        fade = math.exp(-((beta / bar.length_m) ** 2) * bar.diffusivity_m2_s * time_s)
        rise += initial_K * weight * fade * np.cos(beta * position_m / bar.length_m)
    return rise


def prescribed_rod_ramp(
    bar: Bar, source_m: float, rate_W_s: float, position_m: FloatArray, time_s: float, terms: int = 4000
) -> FloatArray:
    """Rise of a rod held at 0 at both ends under a point heat rate · t (Duhamel over `prescribed_rod`)."""
    held = End("prescribed")
    n = np.arange(1, terms + 1)
    wave = n * math.pi / bar.length_m
    rate = bar.diffusivity_m2_s * wave**2 + bar.film_W_mK / bar.capacity_J_mK
    weight = np.sin(wave * source_m) / rate**2 * -np.expm1(-rate * time_s)
    behind = 2.0 * rate_W_s / (bar.capacity_J_mK * bar.length_m) * np.sin(np.outer(position_m, wave)) @ weight
    return steady_fin(bar, (held, held), source_m, rate_W_s * time_s, position_m) - behind


def insulated_fin(
    bar: Bar, source_m: float, heat_W: float, position_m: FloatArray, time_s: FloatArray, terms: int = 3000
) -> FloatArray:
    """Rise (K, P) of a fin insulated at both ends under a point heat from t = 0 (C&J §4.2, cosine series).

    The steady part is taken in closed form; the film must not be zero.
    """
    n = np.arange(terms + 1)
    wave = n * math.pi / bar.length_m
    rate = bar.diffusivity_m2_s * wave**2 + bar.film_W_mK / bar.capacity_J_mK
    size = np.where(n == 0, 1.0, 2.0) * heat_W / (bar.capacity_J_mK * bar.length_m)
    amplitude = size * np.cos(wave * source_m) / rate * np.exp(-np.outer(time_s, rate))
    steady = steady_fin(bar, (End(), End()), source_m, heat_W, position_m)
    return steady - amplitude @ np.cos(np.outer(wave, position_m))
