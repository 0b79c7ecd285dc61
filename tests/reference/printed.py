"""What the papers print, to compare with: Kim's lifted form and gains, Li's step by Crank and Nicolson.

The product does each in another way; docs/papers.md says which and why.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from observer.estimators.design.gains import gains_on_eigenvectors
from observer.frames import FloatArray
from observer.model.network import Network
from observer.model.rod.modes import Modes, Stretch, end_field, modal_input, quadrature


class KimForm(NamedTuple):
    """dx/dt = A x + B q - D z,  y = C x + E z,  z = [l, dl/dt, r, dr/dt].

    `A` (N, N), `B` (N,) per W, `D` (N, 4), `C` (s, N), `E` (s, 4); x are the amplitudes of Θ = T − g l − h r.
    """

    A: FloatArray
    B: FloatArray
    C: FloatArray
    D: FloatArray
    E: FloatArray


def kim_form(modes: Modes, source: Stretch, sensor_m: FloatArray) -> KimForm:
    """Return Kim's equations (18) and (19) for one source and an ambient at 0 °C.

    The lifting functions g and h, which make the ends homogeneous, are the steady fields of the ends
    (straight lines without a film, as in the paper), so that L[g] = L[h] = 0 and only G = ∫ θ g/α dx and H
    are left of (11). An end that is not prescribed has no lifting function: its columns are zero. The
    product itself expands T in place of Θ, which needs no derivative of a measured temperature. Source: Kim
    et al., equations (4) to (19).
    """
    rod = modes.rod
    x, w = quadrature(rod.length_m, ())
    weighted = modes.theta(x).T * (w / rod.diffusivity_m2_s)
    D, E = np.zeros((len(modes), 4)), np.zeros((len(sensor_m), 4))
    for column, side, end in ((0, "left", rod.left), (2, "right", rod.right)):
        if end.prescribed:
            D[:, column + 1] = weighted @ end_field(rod, side, x)
            E[:, column] = end_field(rod, side, sensor_m)
    return KimForm(np.diag(-modes.decay_1_s), modal_input(modes, source), modes.theta(sensor_m), D, E)


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


class Transition(NamedTuple):
    """T⁺ = `E` q + `C` T + `D` T_amb over a step, q and T_amb its means; shapes (n, n), (n, n), (n,)."""

    C: FloatArray
    D: FloatArray
    E: FloatArray


def crank_nicolson(network: Network, dt_s: float) -> Transition:
    """Return one step by Crank and Nicolson: A T⁺ = B T + Δt (g T_amb + q), A, B = C ± Δt K/2.

    Of second order, and stable for any step; nodes that are fast against it swing. Source: Li 2022, eqs. 14
    to 19.
    """
    capacity, half = np.diag(network.capacity_J_K), 0.5 * dt_s * network.conductance_W_K
    E = np.asarray(dt_s * np.linalg.inv(capacity + half), dtype=float)
    return Transition(C=E @ (capacity - half) / dt_s, D=E @ network.ambient_W_K, E=E)


def steady(network: Network, heat_W: FloatArray, ambient_degC: float) -> FloatArray:
    """Return the temperatures (n,) at rest under heats (n,): K T = g T_amb + q (Yu et al. 2024, eq. 49).

    Raises `numpy.linalg.LinAlgError` where a node has no way to the ambient.
    """
    return np.asarray(
        np.linalg.solve(network.conductance_W_K, network.ambient_W_K * ambient_degC + heat_W), dtype=float
    )
