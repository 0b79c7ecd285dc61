"""The fixed-interval smoother's compiled loops: the filter with a tape, and the way back over the tape."""

# numba compiles these functions: their types are those of the arrays they get.
# mypy: disable-error-code="no-untyped-def, misc"

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from observer.compiled import cached_loop, inlined, rarely
from observer.estimators.compiled.judging import add_prior, find_usable, gate, step_is_finite
from observer.estimators.compiled.kernels import (
    compare,
    covariance_with_sensors,
    is_drastic,
    joint_update,
    mirror,
    predict,
    project,
    start,
)
from observer.frames import FloatArray
from observer.model.advance import add_scaled, move_columns, put_laws
from observer.model.coupling import coupled

SKIPPED, STARTED, STEPPED = 0, 1, 2


class Tape(NamedTuple):
    """What the backward pass needs of K steps of the filter.

    `kind` (K,); per sensor in the order of the corrections `gain` (K, s, width), `weight` (K, s) = 1/S, 0
    where it did not correct, and `innovation` (K, s) given the sensors before it; after the corrections the
    heats `heat` (K, m_e) and their rows of P, `cross` (K, m_e, width); where states are coupled, the state
    before each half of it, `coupled` (K, 2, n_x).
    """

    kind: NDArray[np.int8]
    gain: FloatArray
    weight: FloatArray
    innovation: FloatArray
    heat: FloatArray
    cross: FloatArray
    coupled: FloatArray


class Adjoint(NamedTuple):
    """What later measurements say of the state, in place: `r` (width,), `N` (n, width), scratch `NK`."""

    r: FloatArray
    N: FloatArray
    NK: FloatArray


class Smoothed(NamedTuple):
    """Where the backward pass writes: heats and their σ (K, m_e), residuals (K, s)."""

    heat: FloatArray
    sigma: FloatArray
    residual: FloatArray


@cached_loop
def run_forward(p, t, u, step, state, gate_sigma, work, tape):
    """Run the Kalman filter over the K steps of `u`, changing `state` and filling `tape`.

    The steps are those of `run_kalman`, in the same order; a step that cannot be computed is skipped.
    """
    s = u.y_degC.shape[1]
    x, P, B, C = state.x, state.P, work.B, work.C
    nu, S, g, usable, accepted = work.nu, work.S_nu, work.g, work.usable, work.accepted
    for k in range(len(step)):
        present = find_usable(u, k, usable)
        if not step_is_finite(u, k) or (state.flags[0] == 0 and present == 0):
            tape.kind[k] = SKIPPED
            continue
        move_columns(p, u, k, B, C)
        if state.flags[0] == 0:
            start(p, C, u, k, usable, x, P, nu)
            put_laws(p, u, k, B, x, work.law)
            state.flags[0] = 1
            tape.kind[k] = STARTED
        else:
            predict(p, t, step[k], u, k, B, x, P, work)
            for a in range(B.shape[1]):
                tape.coupled[k, 0, a], tape.coupled[k, 1, a] = work.before[0, a], work.before[1, a]
            tape.kind[k] = STEPPED
        for i in range(s):
            accepted[i] = False
        if present > 0:
            covariance_with_sensors(C, P, s, g)
            compare(p, C, u, k, usable, g, x, nu, S)
            if gate(nu, S, usable, state.suspect, gate_sigma, accepted):
                add_prior(p, P, 1.0)
                covariance_with_sensors(C, P, s, g)
                compare(p, C, u, k, usable, g, x, nu, S)
            joint_update(p.R_K2, C, accepted, g, nu, S, x, P, work)
        record(p, C, accepted, x, P, k, work, tape)


@inlined
def record(p, C, accepted, x, P, k, work, tape):
    """Write down step k, each sensor's correction as if one came after the other.

    What the joint correction leaves is just that: row i of W is c_i P over √S, with P and S as the sensors
    before it leave them, and e_i is the innovation over √S. Joseph's form leaves g_i = P c_i and ν_i.
    """
    n_x, width = C.shape[1], P.shape[1]
    one_by_one, count = is_drastic(p.R_K2, accepted, work.S_nu), 0
    for i in range(len(accepted)):
        tape.weight[k, i] = 0.0
        if not accepted[i]:
            continue
        if one_by_one:
            weight = 1.0 / (project(C, i, work.g, i) + p.R_K2[i])
            tape.innovation[k, i] = work.nu[i]
            for b in range(width):
                tape.gain[k, i, b] = work.g[i, b] * weight
        else:
            inverse = work.L[count, count]
            weight = inverse * inverse
            tape.innovation[k, i] = work.e[count] / inverse
            for b in range(width):
                tape.gain[k, i, b] = work.W[count, b] * inverse
        tape.weight[k, i] = weight
        count += 1
    for j in range(len(p.source)):
        tape.heat[k, j] = work.law[p.source[j]] + x[n_x + j]
        for b in range(width):
            tape.cross[k, j, b] = P[n_x + j, b]


@cached_loop
def run_backward(p, t, u, step, tape, adjoint, work, out):
    """Go back over the K steps on the tape, changing `adjoint` and filling `out`.

    q_s = q̂ + p_jᵀ r and σ² = P_jj - p_jᵀ N p_j with p_j the heat's column of P after the corrections.
    """
    r, N, NK, B, C = adjoint.r, adjoint.N, adjoint.NK, work.B, work.C
    for k in range(len(step) - 1, -1, -1):
        if tape.kind[k] == SKIPPED:
            continue
        for j in range(len(p.source)):
            out.heat[k, j] = tape.heat[k, j] + dot(tape.cross, k, j, r)
            variance = tape.cross[k, j, C.shape[1] + j] - quadratic(tape.cross, k, j, N, NK)
            out.sigma[k, j] = np.sqrt(max(0.0, variance))
        move_columns(p, u, k, B, C)
        for i in range(len(p.R_K2) - 1, -1, -1):
            if tape.weight[k, i] > 0.0:
                out.residual[k, i] = p.R_K2[i] * correct_back(C, i, k, tape, r, N, NK)
        if tape.kind[k] == STEPPED:
            if p.coupling.active:
                couple_back(p, u, k, u.z_end[k], B, tape.coupled[k, 1], r, N, work)
            step_back(p, t, step[k], B, r, N, work)
            if p.coupling.active:
                couple_back(p, u, k, u.z_start[k], B, tape.coupled[k, 0], r, N, work)


@inlined
def dot(rows, k, i, r):
    """rows[k, i]ᵀ r."""
    total = 0.0
    for b in range(rows.shape[2]):
        total += rows[k, i, b] * r[b]
    return total


@inlined
def quadratic(rows, k, i, N, NK):
    """vᵀ N v for v = rows[k, i]; leaves N v in `NK`."""
    total = 0.0
    for b in range(N.shape[1]):
        NK[b] = 0.0
    add_scaled(NK, N, rows[k, i], N.shape[0])
    for b in range(N.shape[1]):
        total += NK[b] * rows[k, i, b]
    return total


@inlined
def correct_back(C, i, k, tape, r, N, NK):
    """Take r and N back through sensor i's correction; return the smoothed residual over its variance R.

    e = ν/S - Kᵀ r, r⁻ = r + c e, N⁻ = (I - c Kᵀ) N (I - K cᵀ) + c cᵀ/S: N is a sum of squares, term by term.
    """
    n_x, width = C.shape[1], N.shape[1]
    weight = tape.weight[k, i]
    error = tape.innovation[k, i] * weight - dot(tape.gain, k, i, r)
    half = 0.5 * (quadratic(tape.gain, k, i, N, NK) + weight)
    for a in range(n_x):
        r[a] += C[i, a] * error
        NK[a] -= half * C[i, a]
    for a in range(n_x):
        c = C[i, a]
        for b in range(width):
            N[a, b] -= c * NK[b]
    for a in range(N.shape[0]):
        left = NK[a]
        for b in range(n_x):
            N[a, b] -= left * C[i, b]
    return error


@inlined
def step_back(p, t, d, B, r, N, work):
    """Take r and N back through the step: r = Adᵀ r, N = Adᵀ N Ad, with Ad = [[diag e, G], [0, diag γ]].

    N_δδ = Gᵀ N_xx G + (Gᵀ N_xδ γ + its transpose) + γ N_δδ γ; N_xδ = e ∘ (N_xx G + N_xδ γ); N_xx = e N_xx e.
    """
    n_x, m_e = B.shape[1], len(p.source)
    G, M = work.G, work.M
    for j in range(m_e):
        index, keep = p.source[j], t.heat_decay[d, j]
        total = keep * r[n_x + j]
        for b in range(M.shape[1]):
            M[j, b] = keep * N[n_x + j, b]
        for a in range(n_x):
            G[j, a] = B[index, a] * t.couple[d, j, a]
            total += G[j, a] * r[a]
        add_scaled(M[j], N, G[j], n_x)
        r[n_x + j] = total
    # M = Gᵀ N_x: + γ N_δ:, the new rows of N_δ: but for what still acts on their columns
    for j in range(m_e):
        for i in range(j + 1):
            total = M[j, n_x + i] * t.heat_decay[d, i]
            for a in range(n_x):
                total += M[j, a] * G[i, a]
            N[n_x + j, n_x + i] = total
        for b in range(n_x):
            N[n_x + j, b] = M[j, b] * t.decay[d, b]
    for a in range(n_x):
        scale = t.decay[d, a]
        r[a] *= scale
        for b in range(n_x):
            N[a, b] *= scale * t.decay[d, b]
    mirror(N)


@rarely
def couple_back(p, u, k, z, B, x, r, N, work):
    """Take r and N back through half a coupling: r ← Tᵀ r, N ← Tᵀ N T with T = [[M, 0], [0, I]]."""
    M, was = work.couple, work.was
    n_x, n = M.shape[0], N.shape[0]
    coupled(p.coupling, u.loss_1_s[k], u.loss_degC[k], z, B, 0.5 * u.dt_s[k], x, M, work.shift)
    for a in range(n_x):
        work.shift[a] = r[a]
        r[a] = 0.0
    for i in range(n_x):
        for a in range(n_x):
            r[a] += M[i, a] * work.shift[i]
    for a in range(n_x):
        for b in range(n):
            was[a, b] = 0.0
        for i in range(n_x):
            if M[i, a] != 0.0:
                for b in range(n):
                    was[a, b] += M[i, a] * N[i, b]
    for a in range(n_x):
        for b in range(n_x, n):
            N[a, b] = was[a, b]
            N[b, a] = was[a, b]
        for b in range(a + 1):
            total = 0.0
            for i in range(n_x):
                total += was[a, i] * M[i, b]
            N[a, b] = total
            N[b, a] = total
