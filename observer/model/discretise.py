"""One exact step of the plant over a time dt.

The plant is diagonal. Each estimated heat deviates from its law by δ_j with dδ_j = -g_j δ_j dt + dw_j. Laws
and known inputs are constant or linear over the step. Everything then has a closed form, except the
covariance that the random walk leaves in the states. Quadrature makes it a sum of outer products, which is
never indefinite.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from observer.frames import FloatArray, contiguous
from observer.kernels import discretise, record
from observer.kernels.codes import TICKS_PER_S
from observer.model.plant import Plant

# Gauss-Legendre on [0, 1]; the weights are positive, so the noise is positive semidefinite to the last bit of
# rounding.
_NODES = 0.5 * (np.polynomial.legendre.leggauss(16)[0] + 1.0)
_WEIGHTS = 0.5 * np.polynomial.legendre.leggauss(16)[1]


class StepMatrices(NamedTuple):
    """The matrices of a step of length `dt_s`; n_x plant states, m_e estimated heats.

    Attributes:
        dt_s: Length of the step.
        decay: e_i = exp(-λ_i dt), (n_x,).
        hold: Response to an input of 1 over the step, s, (n_x,).
        ramp: Response to an input that rises from 0 to 1 over the step, s, (n_x,).
        heat_decay: γ_j = exp(-g_j dt), (m_e,).
        couple: Response to δ_j = 1 at the start, s, (m_e, n_x).
        walk_xx: Covariance of the states by the random walk, for input columns of 1, (m_e, n_x, n_x).
        walk_dx: Covariance of δ and the states by the random walk, likewise, (m_e, n_x).
        walk_dd: Variance of δ by the random walk, (m_e,).
    """

    dt_s: float
    decay: FloatArray
    hold: FloatArray
    ramp: FloatArray
    heat_decay: FloatArray
    couple: FloatArray
    walk_xx: FloatArray
    walk_dx: FloatArray
    walk_dd: FloatArray


def quantise(dt_s: FloatArray) -> FloatArray:
    """Return steps rounded to whole microseconds: epoch seconds in double precision resolve 2.4e-7 s.

    Args:
        dt_s: Lengths of steps, s, any shape.
    """
    return np.rint(dt_s * TICKS_PER_S) / TICKS_PER_S


def step_matrices(plant: Plant, dt_s: float) -> StepMatrices:
    """Return the exact step of a plant.

    Source: Van Loan (1978) for the covariance's definition; written out for a diagonal plant.

    Args:
        plant: The model; its couplings are not part of the step.
        dt_s: Length of the step, s. 0 gives the identity without noise.

    Raises:
        ValueError: If the length is negative or not finite: time must not run backwards.
    """
    if not (np.isfinite(dt_s) and dt_s >= 0.0):
        raise ValueError(f"a step of {dt_s} s cannot be taken; times must increase")
    n_x, m_e = len(plant.decay_1_s), len(plant.heat_decay_1_s)
    step = StepMatrices(
        dt_s=float(dt_s),
        decay=np.empty(n_x),
        hold=np.empty(n_x),
        ramp=np.empty(n_x),
        heat_decay=np.empty(m_e),
        couple=np.empty((m_e, n_x)),
        walk_xx=np.zeros((m_e, n_x, n_x)),
        walk_dx=np.zeros((m_e, n_x)),
        walk_dd=np.zeros(m_e),
    )
    rates = (plant.decay_1_s, plant.heat_decay_1_s, plant.random_walk_W2_s)
    discretise(*map(contiguous, rates), _NODES, _WEIGHTS, np.empty(n_x), record(step))
    return step


def augmented(plant: Plant, step: StepMatrices) -> tuple[FloatArray, FloatArray]:
    """Return the dense step of the pair [x | δ] with the plant's own (mean) columns.

    Ad = [[diag e, G], [0, diag γ]] with G_ij = B_ij couple_ji. Couplings of the states are not included.

    Args:
        plant: The model.
        step: Its step.

    Returns:
        Transition Ad and noise Qd, both (n, n) with n = n_x + m_e.
    """
    B = plant.B[:, plant.estimated]
    n_x, m_e = B.shape
    Ad = np.diag(np.concatenate([step.decay, step.heat_decay]))
    Ad[:n_x, n_x:] = B * step.couple.T
    Qd = np.zeros((n_x + m_e, n_x + m_e))
    Qd[:n_x, :n_x] = fixed_noise(plant, step, np.ones(m_e, dtype=np.bool_))
    Qd[:n_x, n_x:] = B * step.walk_dx.T
    Qd[n_x:, :n_x] = Qd[:n_x, n_x:].T
    Qd[n_x:, n_x:] = np.diag(step.walk_dd)
    return Ad, Qd


def fixed_noise(plant: Plant, step: StepMatrices, walking: np.typing.NDArray[np.bool_]) -> FloatArray:
    """Return the covariance left by the field's own noise and the walks of some heats, (n_x, n_x).

    Args:
        plant: The model, with mean columns for moving nuts.
        step: Its step.
        walking: True for heats whose walk counts, (m_e,).
    """
    Q = plant.field_noise_Q * step.dt_s
    columns = plant.B[:, plant.estimated].T
    for j in np.flatnonzero(walking):
        Q = Q + np.multiply.outer(columns[j], columns[j]) * step.walk_xx[j]
    return Q
