"""The textbook step of every estimator on dense matrices, as a reference for tests of the kernels.

The state of an estimator is [x | δ | θ]: the plant's states, the deviations of estimated heats from their
laws, and the nuisance parameters. A step is `transition`, `predict`, `correct`.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from observer.frames import FloatArray, Inputs
from observer.kernels.coupling import couple, faded, uniform_loss
from observer.model.coupling import CoupledColumns, link_scratch
from observer.model.discretise import fixed_noise, quantise, step_matrices
from observer.model.plant import Plant


class Belief(NamedTuple):
    """A Gaussian: mean `x` (n,) and covariance `P` (n, n)."""

    x: FloatArray
    P: FloatArray


class MeasurementUpdate(NamedTuple):
    """Result of a correction by measurements (s,): the belief after it, and the gain `K` (n, s).

    The `innovation` (s,) has the covariance `S` (s, s); `log_likelihood` is that of the measurements.
    """

    belief: Belief
    innovation: FloatArray
    S: FloatArray
    K: FloatArray
    log_likelihood: float


def predict(belief: Belief, F: FloatArray, forced: FloatArray, Q: FloatArray) -> Belief:
    """x⁻ = F x + f, P⁻ = F P Fᵀ + Q with F, Q (n, n), f (n,). Source: Kalman (1960)."""
    return Belief(F @ belief.x + forced, F @ belief.P @ F.T + Q)


def correct(
    belief: Belief,
    H: FloatArray,
    y: FloatArray,
    R: FloatArray,
    *,
    K: FloatArray | None = None,
) -> MeasurementUpdate:
    """Correct a belief: ν = y - H x, S = H P Hᵀ + R, K = P Hᵀ S⁻¹, x⁺ = x + K ν.

    The covariance is P⁺ = (I - K H) P (I - K H)ᵀ + K R Kᵀ. Shapes: H (s, n), y (s,), R (s, s). An observer's
    gain K (n, s) replaces the Kalman gain; Joseph's form (Bucy and Joseph 1968) holds for any gain.
    """
    innovation, S = y - H @ belief.x, H @ belief.P @ H.T + R
    gain = K
    if gain is None:
        gain = np.asarray(np.linalg.solve(S, H @ belief.P).T, dtype=np.float64)
    left = np.eye(len(belief.x)) - gain @ H
    after = Belief(belief.x + gain @ innovation, left @ belief.P @ left.T + gain @ R @ gain.T)
    squares = float(innovation @ np.linalg.solve(S, innovation))
    log_likelihood = -0.5 * (squares + float(np.linalg.slogdet(2.0 * np.pi * S)[1]))
    return MeasurementUpdate(after, innovation, S, gain, log_likelihood)


class Columns(NamedTuple):
    """The columns of a plant over one step, with moving nuts in place.

    Columns `B` (n_x, m) are those of the heats. Columns `G` (n_x, t) are the effects of a unit of each
    parameter of the machine on the states over the step.
    """

    B: FloatArray
    G: FloatArray


class Transition(NamedTuple):
    """x⁺ = F x + f with noise Q, all states; `law_W` (m,) are the heats by their laws at the state's
    temperature.
    """

    F: FloatArray
    forced: FloatArray
    Q: FloatArray
    law_W: FloatArray


def columns_in_place(plant: Plant, u: Inputs, k: int) -> tuple[FloatArray, FloatArray]:
    """Return B (n_x, m) and all output rows C (R, n_x) with moving nuts where they are over step k."""
    B, C = plant.B.copy(), plant.rows.C.copy()
    for i, source in enumerate(plant.moving):
        B[:, source.index] = u.moving_B[k, i]
        C[:, plant.modes + source.index] = u.moving_C[k, i, : len(C)]
    return B, C


def transition(plant: Plant, u: Inputs, k: int, x: FloatArray, columns: Columns) -> Transition:
    """Return step k from the state x (n,): half of the couplings, a diagonal step, the other half.

    The diagonal step is exact and includes laws and known inputs (Strang 1968). Couplings are linear at x.
    """
    B, G = columns
    n_x, m_e, n, t = len(plant.decay_1_s), int(plant.estimated.sum()), len(x), G.shape[1]
    first, dt_s = n_x + m_e, float(quantise(u.dt_s[k]))
    step, B_estimated = step_matrices(plant, dt_s), B[:, plant.estimated]
    before, shift = half_step(plant, u, k, u.z_start[k], B, x, n)
    x = before @ x + shift
    law_W = laws(plant, u, k, B, x[:n_x])
    F, forced, Q = np.eye(n), np.zeros(n), np.zeros((n, n))
    F[:first, :first] = np.diag(np.concatenate([step.decay, step.heat_decay]))
    F[:n_x, n_x:first] = B_estimated * step.couple.T
    F[:n_x, first : first + t] = G
    forced[:n_x] = step.hold * (B @ law_W + plant.E @ u.z_start[k])
    forced[:n_x] += step.ramp * (plant.E @ (u.z_end[k] - u.z_start[k]))
    Q[:n_x, :n_x] = fixed_noise(plant, step, np.zeros(m_e, dtype=np.bool_))
    Q[:n_x, :n_x] += np.einsum("aj,bj,jab->ab", B_estimated, B_estimated, step.walk_xx)
    Q[:n_x, n_x:first] = B_estimated * step.walk_dx.T
    Q[n_x:first, :n_x] = Q[:n_x, n_x:first].T
    Q[n_x:first, n_x:first] = np.diag(step.walk_dd)
    if plant.learning is not None:
        fade, sigma = np.exp(-dt_s / plant.learning.wander_s), plant.learning.arrays.sigma
        F[first:, first:] *= fade
        Q[first:, first:] = np.diag(sigma**2 * (1.0 - fade**2))
    jump = np.zeros(n)
    jump[n_x:first] = plant.jump_uncertainty * u.law_jump_W[k, plant.estimated]
    Q += F @ np.diag(jump**2) @ F.T
    after, shift_after = half_step(plant, u, k, u.z_end[k], B, F @ x + forced, n)
    return Transition(
        after @ F @ before, after @ (F @ shift + forced) + shift_after, after @ Q @ after.T, law_W
    )


def laws(plant: Plant, u: Inputs, k: int, B: FloatArray, x: FloatArray) -> FloatArray:
    """Return the heats (m,) by their laws over step k; fading laws depend on the state x (n_x,)."""
    law_W = u.law_W[k].copy()
    if plant.coupling.active:
        B = np.ascontiguousarray(B.T)
        law_W *= [faded(plant.coupling, j, u.z_start[k], B, x) for j in range(len(law_W))]
    return law_W


def half_step(
    plant: Plant, u: Inputs, k: int, z: FloatArray, B: FloatArray, x: FloatArray, n: int
) -> tuple[FloatArray, FloatArray]:
    """Return half a step of the couplings at the state x: matrix T (n, n) and shift (n,)."""
    T, shift, n_x = np.eye(n), np.zeros(n), len(plant.decay_1_s)
    if plant.coupling.active:
        c, no_inputs = plant.coupling, np.zeros((len(z) + 1, n_x))
        half = CoupledColumns(np.eye(n_x), no_inputs, np.zeros((n_x, n_x)))
        constant = CoupledColumns(np.zeros((n_x, 1)), np.append(z, 1.0)[:, None], np.zeros((n_x, 1)))
        rate_1_s, drawn = uniform_loss(c, u.loss_1_s[k], u.loss_degC[k], z[c.ambient], x)
        for columns in (half, constant):
            couple(c, rate_1_s, drawn, np.ascontiguousarray(B.T), 0.5 * u.dt_s[k], columns, link_scratch(c))
        T[:n_x, :n_x], shift[:n_x] = half.X, constant.X[:, 0]
    return T, shift
