"""The Kalman step as fast as it can be written: no gate, no quality, no missing data, one step length.

What the compiled engine is measured against: the price of being safe. All sensors correct at once; rows are
padded with zeros to whole vector registers, and passes over a row take four columns at a time.
"""

from __future__ import annotations

import numpy as np
from numba import njit

# numba compiles these functions: their types are those of the arrays they get.
# mypy: disable-error-code="no-untyped-def, misc"


@njit(cache=True, error_model="numpy")
def run(decay, hold, G, Q, C, rows, R_K2, forced, y, x, P, heat, field):
    """Filter samples y (K, s): a diagonal plant whose heats walk, with columns G (m, W), on n states.

    `decay`, `x` (W,), `Q`, `P` (n, W), `C` (s, W) are padded, `rows` (g, W) are those that are reported;
    `heat` (K, m, 2) and `field` (K, g, 2) get values and σ.
    """
    (n, width), m, s = P.shape, len(G), len(C)
    n_x = n - m
    H, M, W = np.zeros((m, width)), np.zeros((s, width)), np.zeros((s, width))
    L, e, g = np.zeros((s, s)), np.zeros(s), np.zeros(width)
    for k in range(len(y)):
        for j in range(m):
            for b in range(width):
                H[j, b] = decay[b] * P[n_x + j, b]
            for i in range(m):
                shared = 0.5 * P[n_x + j, n_x + i]
                for b in range(width):
                    H[j, b] += shared * G[i, b]
        for a in range(n):
            x[a] = decay[a] * x[a] + hold[a] * forced[a]
        for j in range(m):
            delta = x[n_x + j]
            for b in range(width):
                x[b] += G[j, b] * delta
        predict(decay, H, G, Q, P)
        compare(C, R_K2, y, k, x, P, M, L, e)
        correct(x, P, M, L, W, e)
        for j in range(m):
            heat[k, j, 0] = x[n_x + j]
            heat[k, j, 1] = np.sqrt(P[n_x + j, n_x + j])
        for r in range(len(rows)):
            sum_rows(rows[r], P, n_x, g)
            value, variance = 0.0, 0.0
            for a in range(n_x):
                value += rows[r, a] * x[a]
                variance += rows[r, a] * g[a]
            field[k, r, 0] = value
            field[k, r, 1] = np.sqrt(max(variance, 0.0))


@njit(cache=True, error_model="numpy", forceinline=True)
def predict(decay, H, G, Q, P):
    """P⁺ = (d dᵀ)∘P + Σ_j (H_j G_jᵀ + G_j H_jᵀ) + Q."""
    n, width = P.shape
    for a in range(n):
        scale = decay[a]
        for b in range(width):
            P[a, b] = scale * decay[b] * P[a, b] + Q[a, b]
    for j in range(0, len(G) - 1, 2):
        for a in range(n):
            h0, g0, h1, g1 = H[j, a], G[j, a], H[j + 1, a], G[j + 1, a]
            for b in range(width):
                P[a, b] += (h0 * G[j, b] + g0 * H[j, b]) + (h1 * G[j + 1, b] + g1 * H[j + 1, b])
    if len(G) % 2 == 1:
        j = len(G) - 1
        for a in range(n):
            h0, g0 = H[j, a], G[j, a]
            for b in range(width):
                P[a, b] += h0 * G[j, b] + g0 * H[j, b]


@njit(cache=True, error_model="numpy", forceinline=True)
def sum_rows(c, P, n_x, g):
    """g = P c."""
    for b in range(len(g)):
        g[b] = 0.0
    for a in range(0, n_x - 3, 4):
        c0, c1, c2, c3 = c[a], c[a + 1], c[a + 2], c[a + 3]
        for b in range(len(g)):
            g[b] += (c0 * P[a, b] + c1 * P[a + 1, b]) + (c2 * P[a + 2, b] + c3 * P[a + 3, b])
    for a in range(n_x // 4 * 4, n_x):
        for b in range(len(g)):
            g[b] += c[a] * P[a, b]


@njit(cache=True, error_model="numpy", forceinline=True)
def compare(C, R_K2, y, k, x, P, M, S, nu):
    """M = C P, S = C Mᵀ + R and ν = y - C x."""
    n, s = len(P), len(C)
    for i in range(s):
        sum_rows(C[i], P, n, M[i])
    for i in range(s):
        nu[i] = y[k, i]
        for a in range(n):
            nu[i] -= C[i, a] * x[a]
        for j in range(i + 1):
            shared = R_K2[i] if j == i else 0.0
            for a in range(n):
                shared += C[i, a] * M[j, a]
            S[i, j] = shared


@njit(cache=True, error_model="numpy", forceinline=True)
def correct(x, P, M, L, W, e):
    """All sensors at once: S = L Lᵀ, W = L⁻¹ M, x += Wᵀ L⁻¹ ν, P -= Wᵀ W; `L` holds S and `e` ν."""
    (n, width), s = P.shape, len(M)
    for i in range(s):
        for j in range(i):
            for q in range(j):
                L[i, j] -= L[i, q] * L[j, q]
            L[i, j] *= L[j, j]
            L[i, i] -= L[i, j] * L[i, j]
            e[i] -= L[i, j] * e[j]
        L[i, i] = 1.0 / np.sqrt(L[i, i])
        e[i] *= L[i, i]
        for b in range(width):
            W[i, b] = M[i, b]
        for j in range(i):
            for b in range(width):
                W[i, b] -= L[i, j] * W[j, b]
        for b in range(width):
            W[i, b] *= L[i, i]
        for b in range(width):
            x[b] += W[i, b] * e[i]
    for j in range(0, s, 4):
        for a in range(n):
            w0, w1, w2, w3 = W[j, a], W[j + 1, a], W[j + 2, a], W[j + 3, a]
            for b in range(width):
                P[a, b] -= (w0 * W[j, b] + w1 * W[j + 1, b]) + (w2 * W[j + 2, b] + w3 * W[j + 3, b])
