"""Lathe's method as printed: each step by itself, with the gradient from central differences.

At step n only q_n is unknown: J_n = Σ_i (T_i(q) - y_i)² is minimised by conjugate gradients from the heats
of the step before, until J_n is what the noise alone makes; then the step is taken for good. Nothing ties the
steps together, so a step must be long enough for heat to reach the sensors; else noise comes out as heat.
Source: Lathe's equations 11 to 17.
"""

# numba compiles these functions: their types are those of the arrays they get.
# mypy: disable-error-code="no-untyped-def, misc"

from __future__ import annotations

import numpy as np

from observer.compiled import cached_call, rarely
from observer.frames import FloatArray
from observer.history.stacked import StackedProblem
from observer.model.discretise import step_matrices
from observer.model.plant import Plant

_ITERATIONS = 50
_DIFFERENCE_W = 1.0
_REST = 1e-20


def stepwise_heats(plant: Plant, problem: StackedProblem, rise_K: FloatArray) -> FloatArray:
    """Return the heats (T, m_e) found step by step from Z, `rise_K` (K, s); `plant` stands still."""
    held = step_matrices(plant, problem.dt_s).hold[:, None] * plant.B[:, plant.estimated]
    out = np.empty((problem.steps, problem.heats))
    C = np.ascontiguousarray(plant.rows.C[: plant.rows.sensors])
    _march(np.exp(-plant.decay_1_s * problem.dt_s), held, C, C @ held, rise_K, problem.weight_1_K, out)
    return out


@cached_call
def _march(decay, held, C, G, rise_K, weight_1_K, out):
    """Take the steps one after the other: x is what the heats found so far have done."""
    (n_x, m), s = held.shape, len(C)
    x, q, free = np.zeros(n_x), np.zeros(m), np.empty(s)
    for k in range(len(out)):
        x *= decay
        for i in range(s):
            free[i] = 0.0
            for a in range(n_x):
                free[i] += C[i, a] * x[a]
        _descend(free, G, q, rise_K[k + 1], weight_1_K[k + 1])
        for j in range(m):
            out[k, j] = q[j]
            for a in range(n_x):
                x[a] += held[a, j] * q[j]


@cached_call
def _descend(free, G, q, y, weight):
    """Change q until its temperatures free + G q are those measured, to their noise."""
    gradient, direction = np.zeros(len(q)), np.zeros(len(q))
    enough, before, first = 0.0, 0.0, 0.0
    for i in range(len(y)):
        if weight[i] > 0.0:
            enough += 1.0 / weight[i] ** 2
    for _ in range(_ITERATIONS):
        if _misfit(free, G, q, y, weight) <= enough:
            return
        steepness = 0.0
        for j in range(len(q)):
            q[j] += _DIFFERENCE_W
            above = _misfit(free, G, q, y, weight)
            q[j] -= 2.0 * _DIFFERENCE_W
            gradient[j] = (above - _misfit(free, G, q, y, weight)) / (2.0 * _DIFFERENCE_W)
            q[j] += _DIFFERENCE_W
            steepness += gradient[j] ** 2
        first = first if first > 0.0 else steepness
        if steepness <= _REST * first:
            return
        factor = steepness / before if before > 0.0 else 0.0
        for j in range(len(q)):
            direction[j] = gradient[j] + factor * direction[j]
        step = _step(free, G, q, direction, y, weight)
        for j in range(len(q)):
            q[j] -= step * direction[j]
        before = steepness


@rarely
def _step(free, G, q, direction, y, weight):
    """The step along the direction to the least misfit: Σ (T - y) ΔT / Σ ΔT², ΔT what the direction does."""
    top, bottom = 0.0, 0.0
    for i in range(len(y)):
        if weight[i] > 0.0:
            T, change = free[i], 0.0
            for j in range(len(q)):
                T += G[i, j] * q[j]
                change += G[i, j] * direction[j]
            top += (T - y[i]) * change
            bottom += change * change
    return top / bottom if bottom > 0.0 else 0.0


@rarely
def _misfit(free, G, q, y, weight):
    """J = Σ (T - y)² over the sensors that have a value."""
    total = 0.0
    for i in range(len(y)):
        if weight[i] > 0.0:
            T = free[i]
            for j in range(len(q)):
                T += G[i, j] * q[j]
            total += (T - y[i]) ** 2
    return total
