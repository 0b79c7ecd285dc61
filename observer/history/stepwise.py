"""Lathe's method as printed: each step by itself, with the gradient from central differences.

At step n only q_n is unknown: J_n = Σ_i (T_i(q) - y_i)² is minimised by conjugate gradients from the heats
of the step before, until J_n is what the noise alone makes; then the step is taken for good. Nothing ties the
steps together, so a step must be long enough for heat to reach the sensors; else noise comes out as heat.
Source: Lathe's equations 11 to 17.
"""

from __future__ import annotations

import numpy as np

from observer.frames import FloatArray, contiguous
from observer.history.stacked import StackedProblem
from observer.kernels import find_heats_stepwise
from observer.model.discretise import step_matrices
from observer.model.plant import Plant


def stepwise_heats(plant: Plant, problem: StackedProblem, rise_K: FloatArray) -> FloatArray:
    """Return the heats (T, m_e) found step by step from Z, `rise_K` (K, s); `plant` stands still."""
    held = step_matrices(plant, problem.dt_s).hold[:, None] * plant.B[:, plant.estimated]
    out = np.empty((problem.steps, problem.heats))
    C = np.ascontiguousarray(plant.rows.C[: plant.rows.sensors])
    n_x, m = held.shape
    find_heats_stepwise(
        np.exp(-plant.decay_1_s * problem.dt_s), contiguous(held), C, C @ held, contiguous(rise_K),
        contiguous(problem.weight_1_K), out,
        np.zeros(n_x), np.zeros(m), np.empty(len(C)), np.empty(m), np.empty(m),
    )  # fmt: skip
    return out
