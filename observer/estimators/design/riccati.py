"""The Kalman filter's gain in the steady state, from the discrete algebraic Riccati equation."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.linalg import solve_discrete_are, solve_discrete_lyapunov

from observer.estimators.design.gains import Refusal, closed_loop, is_stable, refusal, sensor_rows
from observer.frames import BoolArray, FloatArray
from observer.model.discretise import StepMatrices
from observer.model.generator import design_step
from observer.model.plant import Plant

# Relative residual above which a solution of the Riccati equation is not believed: forecasts of σ need three
# digits.
_RESIDUAL = 1e-6


class Steady(NamedTuple):
    """Covariances (n, n) under a constant gain: before (`P_pred`) and after (`P`) each correction."""

    P_pred: FloatArray
    P: FloatArray


def steady_kalman(plant: Plant, step: StepMatrices, present: BoolArray) -> FloatArray | Refusal:
    """Return the steady gain K (n, s), with zero columns for absent sensors.

    P = Ad (P - P Cᵀ S⁻¹ C P) Adᵀ + Qd, S = C P Cᵀ + R, K = P Cᵀ S⁻¹. Works in states scaled to their priors.
    Source: Arnold and Laub (1984), as `scipy.linalg.solve_discrete_are`.
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
    """Return the covariance that a constant gain K (n, s) leads to, or nothing where it is not stable.

    P = M P Mᵀ + (I - K C) Qd (I - K C)ᵀ + K R Kᵀ, with M = (I - K C) Ad.
    """
    Ad, Qd = design_step(plant, step)
    scale = _scale(plant)
    weigh = np.multiply.outer(scale, scale)
    M = closed_loop(plant, step, K) * scale / scale[:, None]
    if not is_stable(M):
        return None
    rest = np.eye(len(Ad)) - K @ sensor_rows(plant)
    P = solve_discrete_lyapunov(M, (rest @ Qd @ rest.T + (K * plant.noise_R_K2) @ K.T) / weigh) * weigh
    P = 0.5 * (P + P.T)
    P_pred = Ad @ P @ Ad.T + Qd
    return Steady(np.asarray(0.5 * (P_pred + P_pred.T)), np.asarray(P, dtype=np.float64))


def _scale(plant: Plant) -> FloatArray:
    """Size of each state in its prior; the lags, known at the start, count as one watt."""
    scale = np.concatenate([np.sqrt(np.diag(plant.prior_P)), plant.initial_sigma_W])
    return np.where(scale > 0, scale, 1.0)
