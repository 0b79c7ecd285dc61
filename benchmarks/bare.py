"""The Kalman step's arithmetic and nothing else: no gate, no quality, no missing data, one step length.

What the compiled engine is measured against: the price of being safe.
"""

from __future__ import annotations

import numpy as np
from numba import njit

# numba compiles these functions: their types are those of the arrays they get.
# mypy: disable-error-code="no-untyped-def, misc"


@njit(cache=True, error_model="numpy")
def run(decay, hold, G, Q, C, R_K2, forced, y, x, P, heat, field):
    """Filter samples y (K, s): a diagonal plant whose heats walk, with columns G (m, n_x).

    `heat` (K, m, 2) and `field` (K, g, 2) get values and σ.
    """
    m, n_x = G.shape
    S, M, g, K, Ac = (
        np.empty((m, n_x)),
        np.empty((m, n_x)),
        np.empty(len(x)),
        np.empty(len(x)),
        np.empty(len(x)),
    )
    for k in range(len(y)):
        for a in range(n_x):
            x[a] = decay[a] * x[a] + hold[a] * forced[a]
            for j in range(m):
                x[a] += G[j, a] * x[n_x + j]
        predict(decay, G, Q, P, S, M)
        for i in range(y.shape[1]):
            correct(C[i], R_K2[i], y[k, i], x, P, g, K, Ac)
        for j in range(m):
            heat[k, j, 0] = x[n_x + j]
            heat[k, j, 1] = np.sqrt(P[n_x + j, n_x + j])
        for r in range(y.shape[1], len(C)):
            read(C[r], x, P, g, field[k, r - y.shape[1]])


@njit(cache=True, error_model="numpy", inline="always")
def predict(decay, G, Q, P, S, M):
    """P⁺ = Ad P Adᵀ + Q, lower triangle, then mirrored."""
    m, n_x = G.shape
    for j in range(m):
        for a in range(n_x):
            S[j, a] = decay[a] * P[n_x + j, a]
            M[j, a] = S[j, a]
        for i in range(m):
            for a in range(n_x):
                M[j, a] += P[n_x + j, n_x + i] * G[i, a]
    for a in range(n_x):
        for b in range(a + 1):
            P[a, b] = decay[a] * decay[b] * P[a, b] + Q[a, b]
        for j in range(m):
            for b in range(a + 1):
                P[a, b] += M[j, a] * G[j, b] + G[j, a] * S[j, b]
    for j in range(m):
        for b in range(len(P)):
            P[n_x + j, b] = (M[j, b] if b < n_x else P[n_x + j, b]) + Q[n_x + j, b]
    for a in range(len(P)):
        for b in range(a):
            P[b, a] = P[a, b]


@njit(cache=True, error_model="numpy", inline="always")
def correct(c, r_K2, y, x, P, g, K, Ac):
    """One sample in Joseph form."""
    n, n_x = len(x), len(c)
    nu, variance = y, r_K2
    for b in range(n):
        g[b] = 0.0
    for a in range(n_x):
        nu -= c[a] * x[a]
        for b in range(n):
            g[b] += c[a] * P[a, b]
    for a in range(n_x):
        variance += c[a] * g[a]
    for a in range(n):
        K[a] = g[a] / variance
        x[a] += K[a] * nu
        Ac[a] = 0.0
    for a in range(n):
        for b in range(n):
            P[a, b] -= K[a] * g[b]
    for a in range(n_x):
        for b in range(n):
            Ac[b] += c[a] * P[a, b]
    for a in range(n):
        rest = r_K2 * K[a] - Ac[a]
        for b in range(n):
            P[a, b] += rest * K[b]


@njit(cache=True, error_model="numpy", inline="always")
def read(c, x, P, g, out):
    """Value and σ of one output row."""
    value, variance = 0.0, 0.0
    for b in range(len(c)):
        g[b] = 0.0
    for a in range(len(c)):
        value += c[a] * x[a]
        for b in range(len(c)):
            g[b] += c[a] * P[a, b]
    for a in range(len(c)):
        variance += c[a] * g[a]
    out[0] = value
    out[1] = np.sqrt(max(variance, 0.0))
