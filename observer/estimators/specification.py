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
    """A Gaussian distribution of the states.

    Attributes:
        x: Mean, (n,).
        P: Covariance, (n, n).
    """

    x: FloatArray
    P: FloatArray


class MeasurementUpdate(NamedTuple):
    """Result of a correction by s measurements.

    Attributes:
        belief: The distribution after it.
        innovation: y - H x, (s,).
        S: Covariance of the innovation, H P Hᵀ + R, (s, s).
        K: The gain, (n, s).
        log_likelihood: log N(ν; 0, S) = -½ (νᵀ S⁻¹ ν + log det 2πS).
    """

    belief: Belief
    innovation: FloatArray
    S: FloatArray
    K: FloatArray
    log_likelihood: float


def predict(belief: Belief, F: FloatArray, forced: FloatArray, Q: FloatArray) -> Belief:
    """Predict a belief: x⁻ = F x + f, P⁻ = F P Fᵀ + Q. Source: Kalman (1960).

    Args:
        belief: The distribution before the step.
        F: Transition, (n, n).
        forced: Shift f of the states by heats and known inputs, (n,).
        Q: Covariance of the process noise, (n, n).
    """
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

    The covariance is P⁺ = (I - K H) P (I - K H)ᵀ + K R Kᵀ, Joseph's form (Bucy and Joseph 1968), which holds
    for any gain.

    Args:
        belief: The distribution before the correction.
        H: Rows of the measurements, (s, n).
        y: Measurements less their known part, (s,).
        R: Covariance of their noise, (s, s).
        K: Gain of an observer, (n, s). None takes the Kalman gain.

    Raises:
        numpy.linalg.LinAlgError: If S is singular.
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

    Attributes:
        B: Columns of the heats, (n_x, m).
        G: Effects of a unit of each parameter of the machine on the states over the step, (n_x, t).
    """

    B: FloatArray
    G: FloatArray


class Transition(NamedTuple):
    """A step of all states: x⁺ = F x + f with noise Q.

    Attributes:
        F: Transition, (n, n).
        forced: Shift f, (n,).
        Q: Covariance of the process noise, (n, n).
        law_W: Heats by their laws at the state's temperature, W, (m,).
    """

    F: FloatArray
    forced: FloatArray
    Q: FloatArray
    law_W: FloatArray


def columns_in_place(plant: Plant, u: Inputs, k: int) -> tuple[FloatArray, FloatArray]:
    """Return the columns of a plant with moving nuts where they are over a step.

    Args:
        plant: The model.
        u: Inputs, of which the nuts' columns are read.
        k: The step, an index into `u`; -1 is the last one.

    Returns:
        B (n_x, m) and all output rows C (R, n_x), both copies.
    """
    B, C = plant.B.copy(), plant.rows.C.copy()
    for i, source in enumerate(plant.moving):
        B[:, source.index] = u.moving_B[k, i]
        C[:, plant.modes + source.index] = u.moving_C[k, i, : len(C)]
    return B, C


def transition(plant: Plant, u: Inputs, k: int, x: FloatArray, columns: Columns) -> Transition:
    """Return step k: half of the couplings, an exact diagonal step with laws and known inputs, the other
    half.

    Source: Strang (1968). Couplings are linearised at the current state. A jump of a law adds its variance to
    that of the heat.

    Args:
        plant: The model.
        u: Inputs.
        k: The step, an index into `u`.
        x: State before the step, (n,).
        columns: The plant's columns over the step.
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
    """Return the heats (m,) by their laws over step k, W.

    Args:
        plant: The model.
        u: Inputs with the laws before they fade with the temperature.
        k: The step, an index into `u`.
        B: Columns of the heats, (n_x, m), which read the temperature at each source.
        x: State of the plant, (n_x,), on which fading laws depend.
    """
    law_W = u.law_W[k].copy()
    if plant.coupling.active:
        B = np.ascontiguousarray(B.T)
        law_W *= [faded(plant.coupling, j, u.z_start[k], B, x) for j in range(len(law_W))]
    return law_W


def half_step(
    plant: Plant, u: Inputs, k: int, z: FloatArray, B: FloatArray, x: FloatArray, n: int
) -> tuple[FloatArray, FloatArray]:
    """Return half a step of the couplings as an affine map x ↦ T x + shift.

    Args:
        plant: The model.
        u: Inputs.
        k: The step, an index into `u`; half of its length is taken.
        z: Known inputs at that end of the step, (p,).
        B: Columns of the heats, (n_x, m).
        x: State at which couplings are linearised, (n,).
        n: Number of all states.

    Returns:
        T (n, n) and the shift (n,). Heats and parameters stay as they are.
    """
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
