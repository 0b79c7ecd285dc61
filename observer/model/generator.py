"""A coupled plant as one matrix, dx/dt = A x + B q + E z with nuts over their strokes, for designs.

The estimators step the diagonal and the couplings by turns (`coupling`); here both stand together. Losses
that change with speed or temperature are left out: they are of the moment.
"""

from __future__ import annotations

import numpy as np
from scipy.linalg import expm

from observer.frames import FloatArray
from observer.model.discretise import StepMatrices, augmented
from observer.model.plant import Plant


def generator(plant: Plant) -> FloatArray:
    """Return A (n_x, n_x), 1/s: decay, links and what nuts exchange as they sweep, films, lagging sensors."""
    c, n_x, N = plant.coupling, len(plant.decay_1_s), plant.modes
    A = -np.diag(plant.decay_1_s)
    if not c.active:
        return A
    for i, source in enumerate(c.links.source.tolist()):
        foot = np.where(np.arange(n_x) < c.screw, c.place_gain[source] * plant.B[:, source], 0.0)
        under = c.under_C[source] + np.where(np.arange(n_x) < N, c.conductance_W_m * foot, 0.0)
        A += c.links.conductance_W_K[i] * np.multiply.outer(foot - c.links.B[i], c.links.C[i] - under)
    for rates, shapes in ((c.spreads.rate_1_s, c.spreads.shape), (c.films.rate_1_s, c.films.shape)):
        A[:N, :N] -= (shapes.T * rates) @ shapes
    for i, state in enumerate(c.lags.state.tolist()):
        A[state] += c.lags.rate_1_s[i] * c.lags.C[i]
        A[state, state] -= c.lags.rate_1_s[i]
    return A


def settled_rows(plant: Plant) -> FloatArray:
    """Return what rows see of screw and sources, (R, N + m), once nodes and lagging sensors followed."""
    first = plant.lag_slice.stop
    if not plant.coupling.states:
        return plant.rows.C
    A, C = generator(plant), plant.rows.C
    follow = np.linalg.lstsq(A[first:, first:], -A[first:, :first], rcond=None)[0]
    return np.asarray(C[:, :first] + C[:, first:] @ follow)


def settled_inputs(plant: Plant) -> FloatArray:
    """Return what the heats do to screw and lags, (N + m, m), once the nodes they enter have followed."""
    first = plant.lag_slice.stop
    if not plant.coupling.nodes:
        return plant.B[:first]
    A = generator(plant)
    follow = np.linalg.lstsq(A[first:, first:], -plant.B[first:], rcond=None)[0]
    return np.asarray(plant.B[:first] + A[:first, first:] @ follow)


def design_step(plant: Plant, step: StepMatrices) -> tuple[FloatArray, FloatArray]:
    """Return transition and noise (n, n) of [x | δ] for a design: with what couples states for good."""
    return augmented_step(plant, step.dt_s) if plant.coupling.lasting else augmented(plant, step)


def augmented_step(plant: Plant, dt_s: float) -> tuple[FloatArray, FloatArray]:
    """Return transition and noise (n, n) of [x | δ] over a step, δ the estimated heats' deviations.

    Source: Van Loan (1978), eq. 1.2: exp of [[−A, Q], [0, Aᵀ]] holds both.
    """
    n_x, m_e = len(plant.decay_1_s), int(plant.estimated.sum())
    n = n_x + m_e
    block = np.zeros((2 * n, 2 * n))
    block[n : n + n_x, n : n + n_x] = generator(plant).T
    block[n + n_x :, n : n + n_x] = plant.B[:, plant.estimated].T
    block[n + n_x :, n + n_x :] = -np.diag(plant.heat_decay_1_s)
    block[:n, :n] = -block[n:, n:].T
    block[:n_x, n : n + n_x] = plant.field_noise_Q
    block[n_x:n, n + n_x :] = np.diag(plant.random_walk_W2_s)
    whole = expm(block * dt_s)
    Ad = whole[n:, n:].T
    Qd = Ad @ whole[:n, n:]
    return np.asarray(Ad), np.asarray(0.5 * (Qd + Qd.T))
