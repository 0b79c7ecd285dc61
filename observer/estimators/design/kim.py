"""Kim's gains for one sensor and one heat: the modified Bass-Gura formula, its closed form, and the pole
rule.

The augmented pair is dη/dt = -Λη + B u, du/dt = 0, y = C η; the observer's error obeys [[A - L C, B], [-k C,
0]].
"""

from __future__ import annotations

import numpy as np

from observer.frames import FloatArray


def kim_poles(decay_1_s: FloatArray, diffusion_rate_1_s: float) -> FloatArray:
    """Return the N + 1 poles of rule (27), 1/s: -(3 Λ_N + i) for i = 0 … N, in dimensionless time τ = α t/L².

    `decay_1_s` (N,) are the modes' Λ and `diffusion_rate_1_s` is α/L². The rule adds steps of 1 to a rate, so
    it only means something where rates have no unit. Source: Kim, equation (27).
    """
    fastest = 3.0 * float(np.max(decay_1_s)) / diffusion_rate_1_s
    return np.asarray(-(fastest + np.arange(len(decay_1_s) + 1)) * diffusion_rate_1_s)


def kim_gains_printed(
    decay: FloatArray, B: FloatArray, C: FloatArray, poles: FloatArray
) -> tuple[FloatArray, float]:
    """Return L (N,) and k by the formula as printed.

    [L; k] = [[J'M_o, 0; 0] | (0, J'M_o B)]⁻¹ (ā - a), with M_o the observability matrix, J the Toeplitz
    matrix (26) of the plant's characteristic polynomial, a and ā the coefficients of s a(s) and of the wanted
    polynomial below s^{N+1}. The matrix is very ill-conditioned already for seven modes; `kim_gains` is the
    same without it. Source: Kim, equations (25) and (26).
    """
    N = len(decay)
    plant = np.poly(-decay)
    J = np.zeros((N, N))
    for row in range(N):
        J[row, row:] = plant[: N - row]
    M_o = C * (-decay) ** np.arange(N)[:, None]
    W = J.T @ M_o
    matrix = np.zeros((N + 1, N + 1))
    matrix[:N, :N] = W
    matrix[1:, N] = W @ B
    gains = np.linalg.solve(matrix, np.poly(poles)[1:] - np.append(plant[1:], 0.0))
    return gains[:N], float(gains[N])


def kim_gains(decay: FloatArray, B: FloatArray, C: FloatArray, poles: FloatArray) -> tuple[FloatArray, float]:
    """Return L (N,) and k by the closed form on the eigenvectors of the augmented matrix.

    These are the unit vectors for -Λ_i and [B/Λ; 1] for the integrator. Needs distinct Λ, none of them 0.
    """
    integrator = B / decay
    g = gains_on_eigenvectors(np.append(-decay, 0.0), np.append(C, C @ integrator), poles)
    return g[:-1] + integrator * g[-1], float(g[-1])


def gains_on_eigenvectors(eigenvalues: FloatArray, c: FloatArray, poles: FloatArray) -> FloatArray:
    """Return the gains g (n,) for which diag(λ) - g c has the wanted poles.

    g_i = Π_j (λ_i - p_j) / (c_i Π_{j≠i} (λ_i - λ_j)), for distinct λ and c_i ≠ 0. Factors are multiplied in
    pairs, so that nothing overflows on the way.
    """
    g = np.empty(len(eigenvalues))
    for i, own in enumerate(eigenvalues):
        others = np.delete(np.arange(len(eigenvalues)), i)
        ratios = (own - poles[others]) / (own - eigenvalues[others])
        g[i] = (own - poles[i]) / c[i] * np.prod(ratios)
    return g


def gains_on_chain(
    eigenvalues: FloatArray, c: FloatArray, coupling: float, c_heat: float, poles: FloatArray
) -> tuple[FloatArray, float]:
    """Return the gains of modes and heat where the heat's eigenvalue is also that of the first mode.

    An insulated screw without surface loss only warms, so its first mode and the heat form a chain
    [[λ_1, coupling], [0, λ_1]]: a double pole. With h(z) = Π(z - p_j)/Π_{i>1}(z - λ_i) the residues at λ_1
    are h and h'. `eigenvalues`, `c` (N,) belong to the modes, `c_heat` to the heat after the other modes are
    decoupled from it.
    """
    own, others = eigenvalues[0], eigenvalues[1:]
    residue = float(
        np.prod((own - poles[: len(others)]) / (own - others)) * np.prod(own - poles[len(others) :])
    )
    slope = residue * (np.sum(1.0 / (own - poles)) - np.sum(1.0 / (own - others)))
    heat = residue / (c[0] * coupling)
    g = np.empty(len(eigenvalues))
    g[0] = (slope - c_heat * heat) / c[0]
    for i in range(1, len(eigenvalues)):
        rest = np.delete(np.arange(1, len(eigenvalues)), i - 1)
        value = eigenvalues[i]
        ratios = (value - poles[: len(rest)]) / (value - eigenvalues[rest])
        top = np.prod(ratios) * np.prod(value - poles[len(rest) :])
        g[i] = top / (c[i] * (value - own) ** 2)
    return g, heat
