"""The map from heats to readings over a log, and its transpose: one sweep of the plant forward, one back.

Many columns at once, each a history of its own. The heats are jumps at the start of each step, W; without
inputs, so the map is linear. Where a log `begins`,
its first row has no step before it.
"""

from __future__ import annotations

from observer.kernels.advance import advance_columns, couple_columns, move_columns
from observer.kernels.changes import couple_changes_back, step_changes_back
from observer.kernels.libc import cython


def run_sweep(b, work, X, begins, w, heat, rows):
    """Take the states X (n, c) over K steps with the jumps `w` (K, m_e, c), W.

    The heats over each step go into `heat` (K, m_e, c), and the readings at its end into `rows` (K, s, c).
    """
    with cython.nogil:
        sweep_forward(b, work, X, begins, w, heat, rows)


def run_sweep_back(b, work, R, begins, rows, w):
    """Take the adjoint R (n, c) back over K steps from readings `rows` (K, s, c); fill `w` (K, m_e, c)."""
    with cython.nogil:
        sweep_back(b, work, R, begins, rows, w)


def sweep_forward(b, work, X, begins, w, heat, rows):
    """Half a coupling, the jumps, the diagonal step, half a coupling; then what the sensors read."""
    B, C, n_x, count = work.B, work.C, work.B.shape[1], X.shape[1]
    for k in range(len(b.step)):
        move_columns(b.plant, b.inputs, k, B, C)
        if k > 0 or not begins:
            if b.plant.coupling.active:
                couple_columns(b.plant, b.inputs, k, b.inputs.z_start[k], work.before[0], X, work)
            for j in range(len(b.plant.source)):
                for q in range(count):
                    X[n_x + j, q] += w[k, j, q]
                    heat[k, j, q] = X[n_x + j, q]
            advance_columns(b.plant, b.table, b.step[k], B, X)
            if b.plant.coupling.active:
                couple_columns(b.plant, b.inputs, k, b.inputs.z_end[k], work.before[1], X, work)
        for i in range(len(b.plant.R_K2)):
            for q in range(count):
                rows[k, i, q] = 0.0
            for a in range(n_x):
                for q in range(count):
                    rows[k, i, q] += C[i, a] * X[a, q]


def sweep_back(b, work, R, begins, rows, w):
    """The transpose of each part of `sweep_forward`, in the opposite order."""
    B, C, n_x, count = work.B, work.C, work.B.shape[1], R.shape[1]
    for k in range(len(b.step) - 1, -1, -1):
        move_columns(b.plant, b.inputs, k, B, C)
        for i in range(len(b.plant.R_K2)):
            for a in range(n_x):
                for q in range(count):
                    R[a, q] += C[i, a] * rows[k, i, q]
        if k > 0 or not begins:
            if b.plant.coupling.active:
                couple_changes_back(b.plant, b.inputs, k, b.inputs.z_end[k], work.before[1], R, work)
            step_changes_back(b.plant, b.table, b.step[k], B, R)
            for j in range(len(b.plant.source)):
                for q in range(count):
                    w[k, j, q] = R[n_x + j, q]
            if b.plant.coupling.active:
                couple_changes_back(b.plant, b.inputs, k, b.inputs.z_start[k], work.before[0], R, work)
