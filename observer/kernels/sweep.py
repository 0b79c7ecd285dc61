"""The map from heats to readings over a log, and its transpose: one sweep of the plant forward, one back.

Many columns at once, each a history of its own. The heats are jumps of unit variance at the start of each
step, `scale` (K, m_e) being the size of one, W; without inputs, so the map is linear. Where a log `begins`,
its first row has no step before it.
"""

from __future__ import annotations

from observer.kernels.advance import advance_columns, couple_columns, move_columns
from observer.kernels.changes import couple_changes_back, step_changes_back
from observer.kernels.libc import cython


def run_sweep(p, t, u, step, work, X, begins, scale, w, heat, rows):
    """Take the states X (n, c) over K steps with the jumps `w` (K, m_e, c); fill `heat` (K, m_e, c), what is
    held over each, and `rows` (K, s, c), the readings at their ends.
    """
    with cython.nogil:
        sweep_forward(p, t, u, step, work, X, begins, scale, w, heat, rows)


def run_sweep_back(p, t, u, step, work, R, begins, scale, rows, w):
    """Take the adjoint R (n, c) back over K steps from readings `rows` (K, s, c); fill `w` (K, m_e, c)."""
    with cython.nogil:
        sweep_back(p, t, u, step, work, R, begins, scale, rows, w)


def sweep_forward(p, t, u, step, work, X, begins, scale, w, heat, rows):
    """Half a coupling, the jumps, the diagonal step, half a coupling; then what the sensors read."""
    B, C, n_x, count = work.B, work.C, work.B.shape[1], X.shape[1]
    for k in range(len(step)):
        move_columns(p, u, k, B, C)
        if k > 0 or not begins:
            if p.coupling.active:
                couple_columns(p, u, k, u.z_start[k], work.before[0], X, work)
            for j in range(len(p.source)):
                for q in range(count):
                    X[n_x + j, q] += scale[k, j] * w[k, j, q]
                    heat[k, j, q] = X[n_x + j, q]
            advance_columns(p, t, step[k], B, X)
            if p.coupling.active:
                couple_columns(p, u, k, u.z_end[k], work.before[1], X, work)
        for i in range(len(p.R_K2)):
            for q in range(count):
                rows[k, i, q] = 0.0
            for a in range(n_x):
                for q in range(count):
                    rows[k, i, q] += C[i, a] * X[a, q]


def sweep_back(p, t, u, step, work, R, begins, scale, rows, w):
    """The transpose of each part of `sweep_forward`, in the opposite order."""
    B, C, n_x, count = work.B, work.C, work.B.shape[1], R.shape[1]
    for k in range(len(step) - 1, -1, -1):
        move_columns(p, u, k, B, C)
        for i in range(len(p.R_K2)):
            for a in range(n_x):
                for q in range(count):
                    R[a, q] += C[i, a] * rows[k, i, q]
        if k > 0 or not begins:
            if p.coupling.active:
                couple_changes_back(p, u, k, u.z_end[k], work.before[1], R, work)
            step_changes_back(p, t, step[k], B, R)
            for j in range(len(p.source)):
                for q in range(count):
                    w[k, j, q] = scale[k, j] * R[n_x + j, q]
            if p.coupling.active:
                couple_changes_back(p, u, k, u.z_start[k], work.before[0], R, work)
