"""Constant gains: the steady Kalman gain, and the Luenberger gain by the configured rule.

The default bandwidth and the growth of errors while a nut is at rest are computed here too.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Mapping
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from scipy.linalg import LinAlgWarning, eigvals, solve_discrete_are

from observer.config.estimator import EstimatorSettings
from observer.errors import UserError
from observer.estimators.design import gains
from observer.estimators.design.gains import (
    LuenbergerGain,
    Refusal,
    accumulated,
    closed_loop,
    design_kim,
    is_stable,
    refusal,
    sensor_rows,
)
from observer.frames import BoolArray, FloatArray
from observer.model.discretise import StepMatrices, step_matrices
from observer.model.generator import design_step
from observer.model.plant import Plant
from observer.model.rod.moving import columns_at

_SLOWEST_1_S = 1e-5
_PER_DECADE = 4
_LADDER_STEPS = 32
_WORSE = 10.0
# Sensor noise alone may at most move a heat by this share of its initial sigma.
_NOISE_AT_MOST = 1.0
GROWTH_AT_MOST_1_S = 1e-3
"""Permitted growth of an error while a nut stands: e-fold in 17 minutes or more."""
_CAUTIONS = (1.0, 10.0, 100.0, 1e3, 1e4)
"""Multiples of the sensors' noise for the design of a constant gain; the first that works is used."""
_PLACES = 13
# Relative residual above which a solution of the Riccati equation is not believed: forecasts of σ need three
# digits.
_RESIDUAL = 1e-6


def design(
    plant: Plant, step: StepMatrices, present: BoolArray, rule: str, bandwidth_1_s: float
) -> LuenbergerGain | Refusal:
    """Design a Luenberger gain by the configured rule.

    Args:
        plant: The model.
        step: Matrices of the step.
        present: True for the sensors that are present, (s,).
        rule: `kim` or `bandwidth`.
        bandwidth_1_s: Rate of the placed poles, 1/s; ignored under Kim's rule.

    Returns:
        The gain or a refusal. Under the bandwidth rule a gain is refused if noise alone moves a heat by its
        initial σ.
    """
    if rule == "kim":
        return design_kim(plant, step, present)
    gain = gains.design_bandwidth(plant, step, present, bandwidth_1_s)
    if isinstance(gain, LuenbergerGain) and not noise_share(plant, gain, present) <= _NOISE_AT_MOST:
        return refusal(
            plant, present, "sensor noise alone would move a heat by more than its initial_sigma_W"
        )
    return gain


def gain_for(
    plant: Plant,
    step: StepMatrices,
    present: BoolArray,
    settings: EstimatorSettings,
    bandwidth_1_s: float | None = None,
    growth_at_most_1_s: float = GROWTH_AT_MOST_1_S,
) -> LuenbergerGain | FloatArray | Refusal:
    """Return the gain of the configured estimator; a Kalman filter's is the steady one.

    Gains are designed for nuts spread over their strokes. Designs for 1, 10, … 10⁴ times the noise variance
    are tried in turn until errors grow slowly enough while a nut stands. A Luenberger observer becomes slower
    by the square root of that factor.

    Args:
        plant: The model.
        step: Matrices of the step.
        present: True for the sensors that are present, (s,).
        settings: The table `[estimator]`.
        bandwidth_1_s: Rate of a Luenberger observer, 1/s. None takes that of the settings.
        growth_at_most_1_s: Permitted growth of an error while a nut stands, 1/s. It does not apply to the
            time-varying Kalman filter.

    Returns:
        A `LuenbergerGain`, the Kalman gain K (n, s), or a refusal if all designs fail.

    Raises:
        UserError: If no bandwidth is given and none is useful.
    """
    is_placed = settings.kind == "luenberger"
    omega = bandwidth(plant, settings) if is_placed and bandwidth_1_s is None else bandwidth_1_s
    growth_1_s = np.inf
    for caution in _CAUTIONS:
        gain: LuenbergerGain | FloatArray | Refusal
        if is_placed and omega is not None:
            gain = design(plant, step, present, settings.pole_rule, omega / math.sqrt(caution))
        else:
            doubtful = replace(plant, noise_R_K2=caution * plant.noise_R_K2)
            gain = steady_kalman(doubtful, step, present)
        if isinstance(gain, Refusal) or not (is_placed or settings.engine == "constant"):
            return gain
        growth_1_s = standing_growth_1_s(plant, step, gain.K if isinstance(gain, LuenbergerGain) else gain)
        if growth_1_s <= growth_at_most_1_s:
            return gain
    return refusal(
        plant, present, f"while the nut stands, errors would grow e-fold in {1.0 / growth_1_s:.0f} s"
    )


def noise_share(plant: Plant, gain: LuenbergerGain, present: BoolArray) -> float:
    """Return the largest σ of a heat by the noise of the present sensors, relative to its initial σ.

    The noisiest of the present sensors counts for all of them.

    Args:
        plant: The model.
        gain: The gain with its noise gain.
        present: True for the sensors that are present, (s,).
    """
    noise_K = float(np.sqrt(plant.noise_R_K2[present].max()))
    return float(np.max(gain.noise_gain_W_K * noise_K / plant.initial_sigma_W))


def bandwidth(plant: Plant, settings: EstimatorSettings) -> float:
    """Return the bandwidth of a Luenberger observer, 1/s.

    The default minimises the heats' steady σ relative to their initial_sigma_W. This σ contains random walk,
    sensor noise and the observer's lag. Four values per decade are tried, from 1e-5 1/s to half of one over
    the period.

    Args:
        plant: The model with all its sensors.
        settings: The table `[estimator]`.

    Returns:
        The configured or the default bandwidth; infinite under Kim's rule, which has none.

    Raises:
        UserError: If no bandwidth gives reachable poles and heats above the sensors' noise.
    """
    if settings.pole_rule == "kim":
        return float("inf")
    if settings.bandwidth_1_s is not None:
        return float(settings.bandwidth_1_s)
    step = step_matrices(plant, settings.period_s)
    best, best_sigma = 0.0, np.inf
    for omega in _SLOWEST_1_S * 10.0 ** (np.arange(_LADDER_STEPS) / _PER_DECADE):
        if omega * settings.period_s > 0.5:
            break
        gain = design(plant, step, gains.everything(plant), "bandwidth", float(omega))
        sigma = np.inf if isinstance(gain, Refusal) else _steady_heat_sigma(plant, step, gain.K)
        if sigma < best_sigma:
            best, best_sigma = float(omega), sigma
        elif sigma > _WORSE * best_sigma:
            break
    if best == 0.0:
        raise UserError(
            "estimator: no bandwidth gives the Luenberger observer poles it can reach and heats above the "
            "sensors' noise; add sensors or move them nearer the sources (`observer place`), or use "
            'kind = "kalman"'
        )
    return best


def _steady_heat_sigma(plant: Plant, step: StepMatrices, K: FloatArray) -> float:
    """Return the largest steady heat σ under a gain, relative to the heats' initial σ."""
    steady = steady_covariance(plant, step, K)
    if steady is None:
        return float("inf")
    variance_W2 = np.diag(steady.P)[len(plant.decay_1_s) :]
    return float(np.sqrt(np.max(variance_W2 / plant.initial_sigma_W**2)))


def standing(plant: Plant, places_m: Mapping[int, float]) -> Plant:
    """Return the plant with nuts that stand; the others stay spread over their strokes.

    Args:
        plant: The model.
        places_m: Position of each standing nut on the screw, m, by its source's number.
    """
    B, C = plant.B.copy(), plant.rows.C.copy()
    for nut in (m for m in plant.moving if m.index in places_m):
        B[:, nut.index], C[:, plant.modes + nut.index] = columns_at(nut.table, [places_m[nut.index]])
    return replace(plant, B=B, rows=replace(plant.rows, C=C))


def standing_growth_1_s(plant: Plant, step: StepMatrices, K: FloatArray) -> float:
    """Return the fastest growth of the estimate's error while one nut stands at any position, 1/s.

    The error follows e⁺ = (I - K C) Ad e, with the model's C and Ad at the position. Thirteen positions cover
    the nut's stroke, or the whole screw. Other nuts are spread over their strokes.

    Args:
        plant: The model.
        step: Matrices of the step.
        K: Constant gain, (n, s), designed for nuts spread over their strokes.

    Returns:
        The rate; negative where the error decays everywhere, -inf without nuts.
    """
    fastest = 0.0
    for nut in plant.moving:
        half_m = 0.5 * nut.table.nut_m
        low_m, high_m = nut.reach_m or (half_m, nut.table.screw_m - half_m)
        for place_m in np.linspace(low_m, high_m, _PLACES):
            standing_plant = standing(plant, {nut.index: float(place_m)})
            fastest = max(fastest, float(np.abs(eigvals(closed_loop(standing_plant, step, K))).max()))
    return float(np.log(fastest) / step.dt_s) if fastest > 0.0 else -np.inf


class Steady(NamedTuple):
    """Steady covariances under a constant gain.

    Attributes:
        P_pred: Covariance before each correction, (n, n).
        P: Covariance after it, (n, n).
    """

    P_pred: FloatArray
    P: FloatArray


def steady_kalman(plant: Plant, step: StepMatrices, present: BoolArray) -> FloatArray | Refusal:
    """Return the steady gain K (n, s), with zero columns for absent sensors.

    P = Ad (P - P Cᵀ S⁻¹ C P) Adᵀ + Qd, S = C P Cᵀ + R, K = P Cᵀ S⁻¹. Works in states scaled to their priors.
    Source: Arnold and Laub (1984), as `scipy.linalg.solve_discrete_are`.

    Args:
        plant: The model.
        step: Matrices of the step, with Ad and Qd of [x | δ].
        present: True for the sensors that are present, (s,).

    Returns:
        K, or a refusal. It is refused without a sensor, where the equation has no accurate solution, and
        where the closed loop is unstable.
    """
    if not present.any():
        return refusal(plant, present, "without a sensor there is nothing to correct by")
    Ad, Qd = design_step(plant, step)
    scale = _scale(plant)
    A = Ad * scale / scale[:, None]
    Q = Qd / np.multiply.outer(scale, scale)
    C = sensor_rows(plant)[present] * scale
    R = np.diag(plant.noise_R_K2[present])
    undetermined = refusal(plant, present, "they cannot distinguish the heats, or a heat has no random walk")
    try:
        # The states are scaled already; scipy's own balancing was seen to spoil the solution of symmetric
        # plants.
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", LinAlgWarning)  # the residual below shows whether it is solved
            P = solve_discrete_are(A.T, C.T, Q, R, balanced=False)
    except (np.linalg.LinAlgError, ValueError):
        return undetermined
    S = C @ P @ C.T + R
    K_scaled = np.linalg.solve(S, C @ P).T
    residual = A @ (P - K_scaled @ C @ P) @ A.T + Q - P
    K = np.zeros((len(Ad), len(present)))
    K[:, present] = scale[:, None] * K_scaled
    solved = np.max(np.abs(residual)) <= _RESIDUAL * np.max(np.abs(P))
    if not solved or not is_stable(closed_loop(plant, step, K)):
        return undetermined
    return K


def steady_covariance(plant: Plant, step: StepMatrices, K: FloatArray) -> Steady | None:
    """Return the covariances under a constant gain: P = M P Mᵀ + (I - K C) Qd (I - K C)ᵀ + K R Kᵀ.

    Here M = (I - K C) Ad is the closed loop.

    Args:
        plant: The model.
        step: Matrices of the step, with Ad and Qd of [x | δ].
        K: Constant gain, (n, s).

    Returns:
        The covariances. None if the loop is unstable or too ill-conditioned for double precision.
    """
    Ad, Qd = design_step(plant, step)
    scale = _scale(plant)
    weigh = np.multiply.outer(scale, scale)
    M = closed_loop(plant, step, K) * scale / scale[:, None]
    if not is_stable(M):
        return None
    rest = np.eye(len(Ad)) - K @ sensor_rows(plant)
    scaled = accumulated(M, (rest @ Qd @ rest.T + (K * plant.noise_R_K2) @ K.T) / weigh)
    if scaled is None:
        return None
    P = scaled * weigh
    P_pred = Ad @ P @ Ad.T + Qd
    return Steady(np.asarray(0.5 * (P_pred + P_pred.T)), np.asarray(P, dtype=np.float64))


def _scale(plant: Plant) -> FloatArray:
    """Size of each state in its prior; the lags, known at the start, count as one watt."""
    scale = np.concatenate([np.sqrt(np.diag(plant.prior_P)), plant.initial_sigma_W])
    return np.where(scale > 0, scale, 1.0)
