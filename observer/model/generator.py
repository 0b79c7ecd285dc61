"""A coupled plant as one matrix, dx/dt = A x + B q + E z with nuts over their strokes, for designs.

The estimators step the diagonal and what couples it by the moment by turns (`coupling`); here both stand
together, with a loss of the moment where one is given.
"""

from __future__ import annotations

import numpy as np

from observer.frames import FloatArray
from observer.model.discretise import StepMatrices, augmented
from observer.model.plant import Plant


def generator(plant: Plant, loss_1_s: float = 0.0) -> FloatArray:
    """Return A (n_x, n_x), 1/s: decay, the links of nuts that move and what these exchange as they sweep, and
    a loss that is the same along the screw.
    """
    c, n_x, N = plant.coupling, len(plant.decay_1_s), plant.modes
    A = -np.diag(plant.decay_1_s)
    metric = c.metric if plant.basis is not None else np.diag(np.arange(n_x) < N).astype(float)
    for i, source in enumerate(c.links.source.tolist()):
        foot = c.place_gain[source] * plant.B[:, source]
        under = c.under_C[source] + c.conductance_W_m * (metric @ foot)
        A += c.links.conductance_W_K[i] * np.multiply.outer(foot - c.links.B[i], c.links.C[i] - under)
    width = c.spreads.row.shape[1]
    A[:width, :width] -= (c.spreads.into.T * c.spreads.rate_1_s) @ c.spreads.row
    if loss_1_s:
        A -= loss_1_s * on_the_screw(plant)
    return A


def on_the_screw(plant: Plant) -> FloatArray:
    """Return what is left of each state (n_x, n_x) where all that is no mode of the screw is taken away."""
    n_x = len(plant.decay_1_s)
    if plant.basis is None:
        return np.diag(np.arange(n_x) < plant.modes).astype(float)
    V, inverse, _ = plant.basis
    return np.asarray(inverse[:, : plant.modes] @ V[: plant.modes])


def settled_rows(plant: Plant) -> FloatArray:
    """Return what rows see of screw and sources, (R, N + m), once nodes and lagging sensors followed."""
    first = plant.lag_slice.stop
    if len(plant.decay_1_s) == first:
        return plant.rows.C
    A, C = generator(plant), plant.rows.C
    follow = np.linalg.lstsq(A[first:, first:], -A[first:, :first], rcond=None)[0]
    return np.asarray(C[:, :first] + C[:, first:] @ follow)


def settled_inputs(plant: Plant) -> FloatArray:
    """Return what the heats do to screw and lags, (N + m, m), once the nodes they enter have followed."""
    first = plant.lag_slice.stop
    if len(plant.decay_1_s) == first:
        return plant.B[:first]
    A = generator(plant)
    follow = np.linalg.lstsq(A[first:, first:], -plant.B[first:], rcond=None)[0]
    return np.asarray(plant.B[:first] + A[:first, first:] @ follow)


def design_step(plant: Plant, step: StepMatrices) -> tuple[FloatArray, FloatArray]:
    """Return transition and noise (n, n) of [x | δ] for a design: with what couples states for good."""
    return augmented_step(plant, step.dt_s) if len(plant.coupling.links.source) else augmented(plant, step)


def augmented_step(plant: Plant, dt_s: float, loss_1_s: float = 0.0) -> tuple[FloatArray, FloatArray]:
    """Return transition and noise (n, n) of [x | δ] over a step, δ the estimated heats' deviations.

    Source: Van Loan (1978), eq. 1.2: exp of [[−A, Q], [0, Aᵀ]] holds both.
    """
    from scipy.linalg import expm  # noqa: PLC0415  (start-up: designs alone need it)

    n_x, m_e = len(plant.decay_1_s), int(plant.estimated.sum())
    n = n_x + m_e
    block = np.zeros((2 * n, 2 * n))
    block[n : n + n_x, n : n + n_x] = generator(plant, loss_1_s).T
    block[n + n_x :, n : n + n_x] = plant.B[:, plant.estimated].T
    block[n + n_x :, n + n_x :] = -np.diag(plant.heat_decay_1_s)
    block[:n, :n] = -block[n:, n:].T
    block[:n_x, n : n + n_x] = plant.field_noise_Q
    block[n_x:n, n + n_x :] = np.diag(plant.random_walk_W2_s)
    whole = expm(block * dt_s)
    Ad = whole[n:, n:].T
    Qd = Ad @ whole[:n, n:]
    return np.asarray(Ad), np.asarray(0.5 * (Qd + Qd.T))
