"""The step of an observer whose covariance has settled: nothing but the state moves.

Everything that is constant is laid out once as padded columns, so that a step is a few sweeps over whole
vector registers: x_pred = e∘x + Σ columns · inputs, ν = y - C x_pred, x⁺ = x_pred + Σ K_i ν_i.
"""

from __future__ import annotations

from observer.kernels.advance import add_scaled, move_columns
from observer.kernels.allowing import allow, allow_for_readings, correct_allowed, finish_allowing, widen
from observer.kernels.codes import GOOD, NUT_LOST
from observer.kernels.judging import invalidate, judge, move_rows, step_is_finite
from observer.kernels.libm import NAN, isfinite, sqrt

# A law's jump that adds less than this share to a heat's σ² leaves the covariance settled.
_QUIET_JUMP = 1e-3


def lay_out(p, t, d, B, C, K, S, c):
    """Fill in the columns for step length d, the input and output columns in force, a gain (n, s) and the
    variances S (s,) of the innovations.
    """
    m, n_x, known, s = B.shape[0], B.shape[1], p.E.shape[0], len(S)
    for a in range(len(c.decay)):
        c.decay[a] = t.decay[d, a]
    for a in range(n_x):
        for j in range(m):
            c.inputs[j, a] = t.hold[d, a] * B[j, a]
        for q in range(known):
            c.inputs[m + q, a] = (t.hold[d, a] - t.ramp[d, a]) * p.E[q, a]
            c.inputs[m + known + q, a] = t.ramp[d, a] * p.E[q, a]
        for j in range(len(p.source)):
            c.inputs[m + 2 * known + j, a] = t.couple[d, j, a] * B[p.source[j], a]
        for i in range(s):
            c.sensors[a, i] = C[i, a]
    for i in range(s):
        c.nu_sigma[i] = sqrt(S[i])
        for q in range(known):
            c.sensors_F[q, i] = p.F[i, q]
        for a in range(K.shape[0]):
            c.gain[i, a] = K[a, i]


def begin_cruise(p, gains, settled, state, c):
    """Lay out what stays while the covariance is that of a gain; return whether no sensor is suspect, as none
    may be.
    """
    n_x = len(p.uniform)
    for a in range(len(state.x)):
        c.x[a] = state.x[a]
    for j in range(len(p.source)):
        c.jump_W2[j] = _QUIET_JUMP * gains.P[settled, n_x + j, n_x + j]
    for i in range(len(c.present)):
        c.present[i] = (gains.key[settled] >> i) & 1
        if state.suspect[i] != 0.0:
            return False
    return True


def is_regular(p, u, k, usable, c):
    """Whether step k leaves the covariance settled: no jump σ would notice, and the sensors that are
    `c.present` there and no other.
    """
    if u.degraded[k] >= NUT_LOST or not step_is_finite(u, k):
        return False
    for i in range(len(c.present)):
        usable[i] = u.usable[k, i] and isfinite(u.y_degC[k, i])
        good = u.quality[k, i] == GOOD
        if (usable[i] != 0) != (c.present[i] != 0) or good != (c.present[i] != 0):
            return False
    for j in range(len(p.source)):
        jump = p.law_uncertainty[j] * u.law_jump_W[k, p.source[j]]
        if not jump * jump <= c.jump_W2[j]:
            return False
    return True


def step_state(p, u, k, usable, c):
    """Predict, compare and correct; return whether every innovation passes the gate: its square is at most
    `c.gate_K2` (s,) (c.x is then x⁺).
    """
    n_x, m, known = len(p.uniform), u.law_W.shape[1], u.z_end.shape[1]
    for j in range(m):
        c.weights[j] = u.law_W[k, j]
    for q in range(known):
        c.weights[m + q], c.weights[m + known + q] = u.z_start[k, q], u.z_end[k, q]
        c.z_end[q] = u.z_end[k, q]
    for j in range(len(p.source)):
        c.weights[m + 2 * known + j] = c.x[n_x + j]
    for b in range(len(c.x)):
        c.x_pred[b] = c.decay[b] * c.x[b]
    add_scaled(c.x_pred, c.inputs, c.weights, len(c.weights))
    for i in range(len(c.expected)):
        c.expected[i] = 0.0
    add_scaled(c.expected, c.sensors_F, c.z_end, known)
    add_scaled(c.expected, c.sensors, c.x_pred, n_x)
    for i in range(len(c.present)):
        c.nu[i] = u.y_degC[k, i] - c.expected[i] if usable[i] else 0.0
        if c.nu[i] * c.nu[i] > c.gate_K2[i]:
            return False
    for b in range(len(c.x)):
        c.x[b] = c.x_pred[b]
    add_scaled(c.x, c.gain, c.nu, len(c.present))
    return True


def write_steady(p, u, k, usable, gains, settled, c, work, out):
    """Write step k with the steady σ of noise; return whether all values are numbers."""
    n_x, total = len(p.uniform), 0.0
    out.log_likelihood[k] = 0.0
    for i in range(len(c.present)):
        out.innovation[k, i] = c.nu[i] if usable[i] else NAN
        out.innovation_sigma[k, i] = c.nu_sigma[i] if usable[i] else NAN
    for j in range(len(p.source)):
        law = u.law_W[k, p.source[j]]
        out.law[k, j], out.heat[k, j] = law, law + c.x[n_x + j]
        out.heat_sigma[k, j] = gains.heat_sigma[settled, j]
        total += out.heat[k, j]
    for r in range(len(work.value)):
        work.value[r] = 0.0
    add_scaled(work.value, p.rows_F, c.z_end, p.rows_F.shape[0])
    add_scaled(work.value, work.rows, c.x, n_x)
    for r in range(out.field.shape[1]):
        out.field[k, r], out.field_sigma[k, r] = work.value[r], gains.field_sigma[settled, r]
        total += work.value[r]
    return isfinite(total)


def cruise(p, t, rungs, u, step, state, gate_sigma, gains, settled, out, k, work, c, allowed):
    """Take regular steps from k on; return the first that is not, or that the gate would refuse."""
    laid_out, roughly, s = -1, allowed.S.shape[1] > 0, len(c.present)
    if not begin_cruise(p, gains, settled, state, c):
        return k
    while k < len(step):
        exact = rungs.exact[step[k]] and gains.key[settled] >> s == rungs.rung[step[k]]
        if not exact or not is_regular(p, u, k, work.usable, c):
            break
        if step[k] != laid_out or len(p.moving) > 0:
            move_columns(p, u, k, work.B, work.C)
            move_rows(p, u, k, work.rows)
            lay_out(p, t, step[k], work.B, work.C, gains.K[settled], gains.S[settled], c)
            for i in range(s):
                c.gate_K2[i] = gate_sigma * gate_sigma * gains.S[settled, i]
            laid_out = step[k]
        if roughly:
            allow(allowed, t, step[k], u, k)
            allow_for_readings(allowed, gains.S[settled])
            for i in range(s):
                c.gate_K2[i] = gate_sigma * gate_sigma * allowed.variance[i]
        if not step_state(p, u, k, work.usable, c):
            break
        if roughly:
            correct_allowed(allowed, gains.K[settled], work.usable)
            finish_allowing(allowed, u.dt_s[k], c.x)
        out.quality[k] = judge(u, k, work.usable, work.usable, state, out)
        known = write_steady(p, u, k, work.usable, gains, settled, c, work, out)
        if roughly:
            for i in range(s):
                if work.usable[i]:
                    out.innovation_sigma[k, i] = sqrt(allowed.variance[i])
            widen(allowed, work.rows, k, out)
        if not known:
            invalidate(out, k)
        k += 1
    for a in range(len(state.x)):
        state.x[a] = c.x[a]
    return k
