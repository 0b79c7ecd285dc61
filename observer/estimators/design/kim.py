"""Kim's gains for one sensor and one heat: the pole rule, and the gains in closed form.

The augmented pair is dη/dt = -Λη + B u, du/dt = 0, y = C η; the observer's error obeys [[A - L C, B], [-k C,
0]].
"""

from __future__ import annotations

import numpy as np

from observer.estimators.design.gains import LuenbergerGain, Refusal, SlowPair, finish, refusal, slow_pair
from observer.frames import BoolArray, FloatArray
from observer.model.discretise import StepMatrices
from observer.model.plant import Plant


def design_kim(plant: Plant, step: StepMatrices, present: BoolArray) -> LuenbergerGain | Refusal:
    """Place all modes and the heat by Kim's rule (27), for one sensor and one heat; lags stay."""
    if len(present) != 1 or plant.estimated.sum() != 1:
        return refusal(plant, present, "Kim's rule is for one sensor and one estimated heat")
    if not present[0]:
        return refusal(plant, present, "without the sensor there is nothing to correct by")
    if not plant.by_itself:
        return refusal(plant, present, "Kim's rule is for a screw by itself")
    pair = slow_pair(plant, step, np.inf)
    poles = kim_poles(plant.decay_1_s[: plant.modes], plant.diffusion_rate_1_s)
    return finish(plant, step, pair, _single_output(pair, np.exp(poles * step.dt_s)), present, poles)


def kim_poles(decay_1_s: FloatArray, diffusion_rate_1_s: float) -> FloatArray:
    """Return the N + 1 poles of rule (27), 1/s: -(3 Λ_N + i) for i = 0 … N, in dimensionless time τ = α t/L².

    `decay_1_s` (N,) are the modes' Λ and `diffusion_rate_1_s` is α/L². The rule adds steps of 1 to a rate, so
    it only means something where rates have no unit. Source: Kim, equation (27).
    """
    fastest = 3.0 * float(np.max(decay_1_s)) / diffusion_rate_1_s
    return np.asarray(-(fastest + np.arange(len(decay_1_s) + 1)) * diffusion_rate_1_s)


def _single_output(pair: SlowPair, z: FloatArray) -> FloatArray:
    """Gain (n_s, 1) for one sensor and one heat by the closed form, in the eigenvectors of A."""
    N = len(pair.slow)
    e, gamma, G = np.diag(pair.A)[:N], float(pair.A[N, N]), pair.A[:N, N]
    c = pair.C[0, :N]
    chained = np.flatnonzero(e == gamma)
    order = np.concatenate([chained, np.setdiff1d(np.arange(N), chained)])
    free = order[len(chained) :]
    v = np.zeros(N)
    v[free] = G[free] / (gamma - e[free])
    if len(chained) == 0:
        c_heat = pair.C[0, N] + c @ v
        g = gains_on_eigenvectors(np.append(e, gamma), np.append(c * e, c_heat * gamma), z)
        modes, heat = g[:N], float(g[N])
    else:
        first = int(chained[0])
        c_heat = (pair.C[0, N] + c @ v) * gamma + c[first] * G[first]
        modes = np.empty(N)
        modes[order], heat = gains_on_chain(e[order], c[order] * e[order], float(G[first]), c_heat, z)
    return np.append(modes + v * heat, heat)[:, None]


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
