"""One exact step of the plant over a time dt.

The plant is diagonal, each estimated heat deviates from its law by δ_j with dδ_j = -g_j δ_j dt + dw_j, and
laws and known inputs are held or ramp over the step. Everything then has a closed form, except the covariance
that the random walk leaves in the states, which is a sum of outer products (quadrature) so that it can never
be indefinite.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from observer.compiled import cached_call, rarely
from observer.frames import FloatArray
from observer.model.plant import Plant

# Gauss-Legendre on [0, 1]; the weights are positive, so the noise is positive semidefinite to the last bit of
# rounding.
_NODES = 0.5 * (np.polynomial.legendre.leggauss(16)[0] + 1.0)
_WEIGHTS = 0.5 * np.polynomial.legendre.leggauss(16)[1]
TICKS_PER_S = 1e6


class StepMatrices(NamedTuple):
    """What a step of length `dt_s` does; n_x plant states, m_e estimated heats.

    `decay` (n_x,) e_i = exp(-λ_i dt); `hold` (n_x,) the response to an input of 1 held over the step, s;
    `ramp` (n_x,) the response to an input that rises from 0 to 1 over the step, s; `heat_decay` (m_e,)
    γ_j = exp(-g_j dt); `couple` (m_e, n_x) the response to δ_j = 1 at the start, s; and, for input columns of
    1, the random walk's covariance `walk_xx` (m_e, n_x, n_x), `walk_dx` (m_e, n_x), `walk_dd` (m_e,).
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
    """Steps to the whole microsecond: epoch seconds in double precision carry no more (2.4e-7 s)."""
    return np.rint(dt_s * TICKS_PER_S) / TICKS_PER_S


def step_matrices(plant: Plant, dt_s: float) -> StepMatrices:
    """Discretise the plant exactly over `dt_s`.

    Raises `ValueError` for a negative or non-finite step: time must not run backwards.
    Source: Van Loan (1978) for the covariance's definition; written out for a diagonal plant.
    """
    if not (np.isfinite(dt_s) and dt_s >= 0.0):
        raise ValueError(f"a step of {dt_s} s cannot be taken; times must increase")
    arrays = _step(
        np.ascontiguousarray(plant.decay_1_s),
        np.ascontiguousarray(plant.heat_decay_1_s),
        np.ascontiguousarray(plant.random_walk_W2_s),
        float(dt_s),
    )
    return StepMatrices(float(dt_s), *arrays)


def augmented(plant: Plant, step: StepMatrices) -> tuple[FloatArray, FloatArray]:
    """Dense transition Ad and noise Qd, both (n, n), of the pair [x | δ] with the plant's own (mean) columns.

    Ad = [[diag e, G], [0, diag γ]] with G_ij = B_ij couple_ji. What couples the states is not in it.
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


def fixed_noise(plant: Plant, step: StepMatrices, which: np.typing.NDArray[np.bool_]) -> FloatArray:
    """Covariance (n_x, n_x) left by the field's own noise and the walks of heats `which` (m_e,)."""
    Q = plant.field_noise_Q * step.dt_s
    columns = plant.B[:, plant.estimated].T
    for j in np.flatnonzero(which):
        Q = Q + np.multiply.outer(columns[j], columns[j]) * step.walk_xx[j]
    return Q


@rarely
def hold(rate_1_s, dt_s):  # type: ignore[no-untyped-def]
    """∫_0^dt exp(-rate s) ds, safe for rate → 0."""
    if rate_1_s == 0.0:
        return dt_s
    return -np.expm1(-rate_1_s * dt_s) / rate_1_s


@rarely
def ramp(rate_1_s, dt_s):  # type: ignore[no-untyped-def]
    """∫_0^dt exp(-rate (dt-s)) s/dt ds = dt (u - 1 + exp(-u)) / u², u = rate dt; for small u a series."""
    u = rate_1_s * dt_s
    if u < 1e-2:
        return dt_s * (0.5 - u * (1.0 / 6.0 - u * (1.0 / 24.0 - u * (1.0 / 120.0 - u / 720.0))))
    return dt_s * (u + np.expm1(-u)) / (u * u)


@rarely
def _chain(rate_1_s, heat_rate_1_s, dt_s):  # type: ignore[no-untyped-def]
    """∫_0^dt exp(-rate (dt-s)) exp(-heat_rate s) ds, safe where both rates meet."""
    slow = min(rate_1_s, heat_rate_1_s)
    return np.exp(-slow * dt_s) * hold(abs(rate_1_s - heat_rate_1_s), dt_s)


@cached_call
def _step(rate, heat_rate, intensity, dt_s):  # type: ignore[no-untyped-def]
    n_x, m_e = len(rate), len(heat_rate)
    decay, held, ramped = np.empty(n_x), np.empty(n_x), np.empty(n_x)
    heat_decay, couple = np.exp(-heat_rate * dt_s), np.empty((m_e, n_x))
    walk_xx, walk_dx, walk_dd = np.zeros((m_e, n_x, n_x)), np.zeros((m_e, n_x)), np.zeros(m_e)
    for i in range(n_x):
        decay[i] = np.exp(-rate[i] * dt_s)
        held[i] = hold(rate[i], dt_s)
        ramped[i] = ramp(rate[i], dt_s)
    response = np.empty(n_x)
    for j in range(m_e):
        for i in range(n_x):
            couple[j, i] = _chain(rate[i], heat_rate[j], dt_s)
        for q in range(len(_NODES)):
            s = _NODES[q] * dt_s
            weight = _WEIGHTS[q] * dt_s * intensity[j]
            own = np.exp(-heat_rate[j] * s)
            for i in range(n_x):
                response[i] = _chain(rate[i], heat_rate[j], s)
            for i in range(n_x):
                walk_dx[j, i] += weight * own * response[i]
                for k in range(n_x):
                    walk_xx[j, i, k] += weight * response[i] * response[k]
            walk_dd[j] += weight * own * own
    return decay, held, ramped, heat_decay, couple, walk_xx, walk_dx, walk_dd
