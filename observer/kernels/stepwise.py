"""Lathe's method step by step (see `observer.history.stepwise`)."""

from __future__ import annotations

from observer.kernels.covariance import squared

_ITERATIONS = 50
_DIFFERENCE_W = 1.0
_REST = 1e-20


def find_heats_stepwise(decay, held, C, G, rise_K, weight_1_K, out, x, q, free, gradient, direction):
    """Take the steps one after the other: x is what the heats found so far have done; the rest is scratch."""
    n_x, m, s = held.shape[0], held.shape[1], len(C)
    for k in range(len(out)):
        for a in range(n_x):
            x[a] *= decay[a]
        for i in range(s):
            free[i] = 0.0
            for a in range(n_x):
                free[i] += C[i, a] * x[a]
        _descend(free, G, q, rise_K[k + 1], weight_1_K[k + 1], gradient, direction)
        for j in range(m):
            out[k, j] = q[j]
            for a in range(n_x):
                x[a] += held[a, j] * q[j]


def _descend(free, G, q, y, weight, gradient, direction):
    """Change q until its temperatures free + G q are those measured, to their noise."""
    for j in range(len(q)):
        direction[j] = 0.0
    enough, before, first = 0.0, 0.0, 0.0
    for i in range(len(y)):
        if weight[i] > 0.0:
            enough += 1.0 / squared(weight[i])
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
            steepness += squared(gradient[j])
        first = first if first > 0.0 else steepness
        if steepness <= _REST * first:
            return
        factor = steepness / before if before > 0.0 else 0.0
        for j in range(len(q)):
            direction[j] = gradient[j] + factor * direction[j]
        step = _step_along(free, G, q, direction, y, weight)
        for j in range(len(q)):
            q[j] -= step * direction[j]
        before = steepness


def _step_along(free, G, q, direction, y, weight):
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


def _misfit(free, G, q, y, weight):
    """J = Σ (T - y)² over the sensors that have a value."""
    total = 0.0
    for i in range(len(y)):
        if weight[i] > 0.0:
            T = free[i]
            for j in range(len(q)):
                T += G[i, j] * q[j]
            total += squared(T - y[i])
    return total
