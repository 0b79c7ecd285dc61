"""The fixed-interval smoother's loops: the filter with a tape, and the way back over the tape."""

from __future__ import annotations

from observer.kernels.advance import form_half, move_columns
from observer.kernels.covariance import add_scaled, mirror, take_along
from observer.kernels.kalman import SKIPPED, STEPPED, judge_and_correct, start_or_predict
from observer.kernels.libc import cython, sqrt
from observer.kernels.step import compare, is_drastic, project


def filter_with_tape(b, state, work, tape):
    """Run the Kalman filter over the K steps of `u`, changing `state` and filling `tape`.

    The steps are those of `kalman.filter_steps`: the same sensors correct, and P grows where it does there. A
    step that cannot be computed is skipped.
    """
    for k in range(len(b.step)):
        tape.kind[k] = start_or_predict(b, k, state, work)
        if tape.kind[k] == SKIPPED:
            continue
        for a in range(work.B.shape[1]):
            tape.coupled[k, 0, a], tape.coupled[k, 1, a] = work.before[0, a], work.before[1, a]
        compare(b.plant, b.inputs, k, state, work)
        judge_and_correct(b.plant, b.inputs, k, b.gate_sigma, state, work)
        mirror(state.P)
        write_tape(b.plant, k, state, work, tape)


def write_tape(p, k, state, work, tape):
    """Write step k on the tape, as corrections by one sensor after the other.

    Row i of W from the joint correction is c_i P / √S, with P and S after the sensors before it; e_i is the
    innovation over √S. Joseph's form provides g_i = P c_i and ν_i.
    """
    n_x, width = work.C.shape[1], state.P.shape[1]
    one_by_one, count = is_drastic(p, work), 0
    for i in range(len(work.accepted)):
        tape.weight[k, i] = 0.0
        if not work.accepted[i]:
            continue
        if one_by_one:
            weight = 1.0 / (project(work.C, i, work.g, i) + p.R_K2[i])
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
        tape.heat[k, j] = work.law[p.source[j]] + state.x[n_x + j]
        for b in range(width):
            tape.cross[k, j, b] = state.P[n_x + j, b]


def smooth_back(b, tape, adjoint, work, out):
    """Go back over the K steps on the tape, changing `adjoint` and filling `out`.

    q_s = q̂ + p_jᵀ r and σ² = P_jj - p_jᵀ N p_j with p_j the heat's column of P after the corrections. A law's
    jump of variance s² is found as s² r_j at the start of its step, of variance s² - s⁴ N_jj.
    """
    r, N, NK, B, C = adjoint.r, adjoint.N, adjoint.NK, work.B, work.C
    for k in range(len(b.step) - 1, -1, -1):
        if tape.kind[k] == SKIPPED:
            continue
        for j in range(len(b.plant.source)):
            out.heat[k, j] = tape.heat[k, j] + dot(tape.cross, k, j, r)
            variance = tape.cross[k, j, C.shape[1] + j] - quadratic(tape.cross, k, j, N, NK)
            out.sigma[k, j] = sqrt(max(0.0, variance))
        move_columns(b.plant, b.inputs, k, B, C)
        for i in range(len(b.plant.R_K2) - 1, -1, -1):
            if tape.weight[k, i] > 0.0:
                correct_back(b.plant, C, i, k, tape, adjoint, out)
        if tape.kind[k] == STEPPED:
            if b.plant.coupling.active:
                couple_back(b.plant, b.inputs, k, b.inputs.z_end[k], tape.coupled[k, 1], adjoint, work)
            step_back(b.plant, b.table, b.step[k], B, r, N, work)
            write_jumps(b.plant, b.inputs, k, r, N, out)
            if b.plant.coupling.active:
                couple_back(b.plant, b.inputs, k, b.inputs.z_start[k], tape.coupled[k, 0], adjoint, work)


def write_jumps(p, u, k, r, N, out):
    """The jumps of the laws at the start of step k and their σ, from r and N there."""
    n_x = len(p.uniform)
    for j in range(len(p.source)):
        jump = p.jump_uncertainty[j] * u.law_jump_W[k, p.source[j]]
        out.jump[k, j] = jump * jump * r[n_x + j]
        left = max(0.0, 1.0 - jump * jump * N[n_x + j, n_x + j])
        out.jump_sigma[k, j] = sqrt(jump * jump * left)


def dot(rows, k, i, r):
    """rows[k, i]ᵀ r."""
    total = 0.0
    for b in range(rows.shape[2]):
        total += rows[k, i, b] * r[b]
    return total


def quadratic(rows, k, i, N, NK):
    """vᵀ N v for v = rows[k, i]; leaves N v in `NK`."""
    total = 0.0
    for b in range(N.shape[1]):
        NK[b] = 0.0
    add_scaled(NK, N, rows[k, i], N.shape[0])
    for b in range(N.shape[1]):
        total += NK[b] * rows[k, i, b]
    return total


def correct_back(p, C, i, k, tape, adjoint, out):
    """Take r and N back through sensor i's correction; write its smoothed residual and its free share.

    e = ν/S - Kᵀ r, r⁻ = r + c e, N⁻ = (I - c Kᵀ) N (I - K cᵀ) + c cᵀ/S. N is a sum of squares, term by term.
    The residual is R e, with R the noise of the reading. The free share R (1/S + Kᵀ N K) is 1 minus the
    reading's influence on its own smoothed value (Kohn and Ansley 1989).
    """
    r, N, NK = adjoint.r, adjoint.N, adjoint.NK
    n_x, width = C.shape[1], N.shape[1]
    weight = tape.weight[k, i]
    error = tape.innovation[k, i] * weight - dot(tape.gain, k, i, r)
    information = quadratic(tape.gain, k, i, N, NK) + weight
    half = 0.5 * information
    out.residual[k, i] = p.R_K2[i] * error
    out.free[k, i] = p.R_K2[i] * information
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


def couple_back(p, u, k, z, x, adjoint, work):
    """Take r and N back through half a coupling: r ← Tᵀ r, N ← Tᵀ N T with T = [[M, 0], [0, I]]."""
    M, MT, n_x = work.half_step.X, work.half_step_T, work.B.shape[1]
    r, moved = adjoint.r, work.half_step.sums[0]
    form_half(p, u, k, z, work.B, x, work)
    for a in range(len(moved)):
        moved[a] = 0.0
    add_scaled(moved, M, r, n_x)
    for a in range(n_x):
        r[a] = moved[a]
    take_along(MT, M, n_x, adjoint.N, work.was)
    mirror(adjoint.N)


def run_forward(b, state, work, tape):
    """Run the smoother's way forward (see `smoother.filter_with_tape`)."""
    with cython.nogil:
        filter_with_tape(b, state, work, tape)


def run_backward(b, tape, adjoint, work, out):
    """Run the smoother's way back (see `smoother.smooth_back`)."""
    with cython.nogil:
        smooth_back(b, tape, adjoint, work, out)
