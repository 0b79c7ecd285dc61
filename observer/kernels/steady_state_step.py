"""The steps of an observer whose covariance has settled: nothing but the state moves.

Everything that is constant is laid out once, in rows of whole registers (see `vector`), for a step length, a
gain and columns; where columns move, what they change is laid out anew. Steps are taken in runs: first it is
seen how many are regular, then the states alone are taken over them, with w the inputs, D what they do to the
readings and S the sensors' rows of what a step makes of a state,

    f = inputs w,        ν = y - D w - S x,        x⁺ = e∘x + f + G δ + K ν,

and then all that is reported is made of the states. No sum's order depends on how many steps are in a run or
on what was laid out anew. The records are those of `observer.estimators.fixed_gain_records`.

A row of `c.states` is a step: its plant's states and known inputs from 0 on, its heats δ before W, and from
W on the innovations ν of the step after it.
"""

from __future__ import annotations

from observer.kernels.advance import move_columns
from observer.kernels.codes import ESTIMATE_DEGRADED, ESTIMATE_GOOD, GOOD, NUT_LOST
from observer.kernels.consider import (
    add_considered,
    consider_readings,
    correct_considered,
    finish_considered,
    propagate_considered,
)
from observer.kernels.covariance import squared
from observer.kernels.judging import invalidate, move_rows, rate
from observer.kernels.libc import INFINITY, NAN, isfinite, sqrt
from observer.kernels.vector import LANES, load, load_at, none, store, store_at, weigh


def lay_out(p, t, d, B, C, K, c):
    """Fill in the matrices for step length d, the input and output columns in force and a gain K (n, s)."""
    m, n_x, known, m_e = B.shape[0], B.shape[1], p.E.shape[0], len(p.source)
    first = len(c.decay) - m_e
    for a in range(n_x):
        c.decay[a] = t.decay[d, a]
        lay_out_state(t, d, C, a, c)
    for j in range(m_e):
        c.decay[first + j] = t.heat_decay[d, j]
    for q in range(known):
        for a in range(n_x):
            c.drives[m + q, a] = (t.hold[d, a] - t.ramp[d, a]) * p.E[q, a]
            c.drives[m + known + q, a] = t.ramp[d, a] * p.E[q, a]
            c.inputs[m + q, a] = c.drives[m + q, a]
            c.inputs[m + known + q, a] = c.drives[m + known + q, a]
        c.inputs[m + known + q, n_x + q] = 1.0
    for i in range(K.shape[1]):
        for a in range(n_x):
            c.push[m_e + i, a] = K[a, i]
        for j in range(m_e):
            c.push[m_e + i, first + j] = K[n_x + j, i]
    for j in range(m):
        lay_out_source(p, t, d, B, j, c)
    lay_out_readings(p, m, c)


def lay_out_moving(p, t, d, B, C, c):
    """Fill in what columns that move change."""
    for i in range(len(p.moving)):
        lay_out_source(p, t, d, B, p.moving[i], c)
        lay_out_state(t, d, C, p.modes + p.moving[i], c)
    lay_out_readings(p, B.shape[0], c)


def lay_out_state(t, d, C, a, c):
    """What the sensors that are present have of state a at a step's end, and of what it leaves of it."""
    for i in range(len(c.present)):
        read = -C[i, a] if c.present[i] else 0.0
        c.sensors[a, i] = read
        c.seen[a, i] = read * t.decay[d, a]


def lay_out_source(p, t, d, B, j, c):
    """What the law of source j, and its heat where that is a state, do to the states in a step."""
    for a in range(B.shape[1]):
        c.drives[j, a] = t.hold[d, a] * B[j, a]
        c.inputs[j, a] = c.drives[j, a]
    for i in range(len(p.source)):
        if p.source[i] == j:
            row = len(c.drives) - len(p.source) + i
            for a in range(B.shape[1]):
                c.drives[row, a] = t.couple[d, i, a] * B[j, a]
                c.push[i, a] = c.drives[row, a]


def lay_out_readings(p, m, c):
    """By how much innovations are less for every input and heat, as the sensors see what these drive; the
    last inputs, known ones at the step's end, they have in their own rows, too.
    """
    width, m_e, known = len(c.decay), len(p.source), p.F.shape[1]
    inputs = len(c.drives) - m_e
    for w in range(len(c.drives)):
        see_drive(c, w)
        for i in range(len(c.present)):
            if w >= inputs:
                c.seen[width - m_e + w - inputs, i] = c.forced[width + i]
            elif w >= m + known and c.present[i]:
                c.inputs[w, width + i] = c.forced[width + i] - p.F[i, w - m - known]
            else:
                c.inputs[w, width + i] = c.forced[width + i]


def see_drive(c, w):
    """Put what the sensors see of row w of the drives into `c.forced`, from W on."""
    width = len(c.decay) // LANES
    for q in range(c.sensors.shape[1] // LANES):
        store_at(c.forced, width + q, weigh(none(), c.sensors, q, c.drives, w, 0))


# A law's jump that adds less than this share to a heat's σ² leaves the covariance settled.
_QUIET_JUMP = 1e-3


def begin_steady_state(p, gains, settled, state, c):
    """Lay out what stays while the covariance is that of a gain; return whether the state is known and no
    sensor suspect, as none may be.
    """
    n_x, first = len(p.uniform), len(c.decay) - len(p.source)
    for a in range(len(state.x)):
        if not isfinite(state.x[a]):
            return False
    for a in range(len(c.decay)):
        c.states[0, a] = state.x[a] if a < n_x else 0.0
    for j in range(len(p.source)):
        c.states[0, first + j] = state.x[n_x + j]
        c.jump_W2[j] = _QUIET_JUMP * gains.P[settled, n_x + j, n_x + j]
    for i in range(len(c.present)):
        c.present[i] = (gains.key[settled] >> i) & 1
        c.nu_sigma[i] = sqrt(gains.S[settled, i]) if c.present[i] else NAN
        if state.suspect[i] != 0.0:
            return False
    return True


def count_regular(p, u, step, k, most, c):
    """How many of `most` steps from k on leave the covariance settled: of one length, without a jump that σ
    would notice, with the sensors that are `c.present` and no other.
    """
    last = min(k + most, len(step))
    odd = last
    for n in range(k, last):
        if (step[n] != step[k]) | (u.degraded[n] >= NUT_LOST):
            odd = min(odd, n)
    for i in range(len(c.present)):
        for n in range(k, last):
            if (u.usable[n, i] != c.present[i]) | ((u.quality[n, i] == GOOD) != c.present[i]):
                odd = min(odd, n)
    for j in range(len(p.source)):
        for n in range(k, last):
            if not squared(p.jump_uncertainty[j] * u.law_jump_W[n, p.source[j]]) <= c.jump_W2[j]:
                odd = min(odd, n)
    return odd - k


def read_run(u, k, count, c):
    """Put what drives the steps and what is measured at their ends in place; return how many come before the
    first that is no number.
    """
    m, known, width, odd = u.law_W.shape[1], u.z_end.shape[1], len(c.decay), count
    for j in range(m):
        for r in range(count):
            c.weights[r, j] = u.law_W[k + r, j]
            if not isfinite(u.law_W[k + r, j]):
                odd = min(odd, r)
    for q in range(known):
        for r in range(count):
            c.weights[r, m + q] = u.z_start[k + r, q]
            c.weights[r, m + known + q] = u.z_end[k + r, q]
            if not isfinite(u.z_start[k + r, q] + u.z_end[k + r, q]):
                odd = min(odd, r)
    for i in range(len(c.present)):
        there = c.present[i] != 0
        for r in range(count):
            c.states[r, width + i] = u.y_degC[k + r, i] if there else 0.0
            if not isfinite(c.states[r, width + i]):
                odd = min(odd, r)
    return odd


def force_step(c, r):
    """f and -D w of step r."""
    for q in range(len(c.forced) // LANES):
        store_at(c.forced, q, weigh(none(), c.inputs, q, c.weights, r, 0))


def innovate(c, r):
    """ν of step r."""
    width = len(c.decay) // LANES
    for q in range(c.seen.shape[1] // LANES):
        nu = load(c.states, r, width + q) + load_at(c.forced, width + q)
        store(c.states, r, width + q, weigh(nu, c.seen, q, c.states, r, 0))


def push_states(c, r, first):
    """The states after step r; the heats are from `first` on."""
    for q in range(len(c.decay) // LANES):
        x = load_at(c.decay, q) * load(c.states, r, q) + load_at(c.forced, q)
        store(c.states, r + 1, q, weigh(x, c.push, q, c.states, r, first))


def report_rows(c, r):
    """The reported rows after step r."""
    for q in range(c.rows.shape[1] // LANES):
        store(c.value, r, q, weigh(none(), c.rows, q, c.states, r + 1, 0))


def step_states(c, count, first):
    """Take the states over the steps; the heats are from `first` on. Inputs that are held drive as before."""
    for r in range(count):
        if r == 0 or not is_driven_alike(c, r):
            force_step(c, r)
        innovate(c, r)
        push_states(c, r, first)
    for r in range(count):
        report_rows(c, r)


def is_driven_alike(c, r):
    """Whether step r has the inputs of the step before it."""
    for w in range(c.weights.shape[1]):
        if c.weights[r, w] != c.weights[r - 1, w]:
            return False
    return True


def set_gate(gate_sigma, variance_K2, c):
    """Put the largest squares of innovations of these variances that pass the gate in place."""
    for i in range(len(c.present)):
        c.gate_K2[i] = gate_sigma * gate_sigma * variance_K2[i] if c.present[i] else INFINITY


def count_passed(c, count):
    """How many of the steps pass the gate: every ν² is at most `c.gate_K2`, and a number."""
    stopped, width = count, len(c.decay)
    for i in range(len(c.present)):
        for r in range(count):
            if not squared(c.states[r, width + i]) <= c.gate_K2[i]:
                stopped = min(stopped, r)
    return stopped


def write_run(b, k, count, gains, settled, c, out):
    """Write the steps with the steady σ of noise."""
    width, whole, lost = len(c.decay), True, 0
    first = width - len(b.plant.source)
    for q in range(out.field.shape[1]):
        sigma = gains.field_sigma[settled, q]
        for r in range(count):
            out.field[k + r, q], out.field_sigma[k + r, q] = c.value[r, q], sigma
            lost += 0 if isfinite(c.value[r, q]) else 1
    for j in range(len(b.plant.source)):
        index, sigma = b.plant.source[j], gains.heat_sigma[settled, j]
        for r in range(count):
            law = b.inputs.law_W[k + r, index]
            heat = law + c.states[r + 1, first + j]
            out.law[k + r, j], out.heat[k + r, j], out.heat_sigma[k + r, j] = law, heat, sigma
            lost += 0 if isfinite(heat) else 1
    for i in range(len(c.present)):
        there, sigma = c.present[i] != 0, c.nu_sigma[i]
        whole = whole and there
        for r in range(count):
            out.innovation[k + r, i] = c.states[r, width + i] if there else NAN
            out.innovation_sigma[k + r, i] = sigma
    for r in range(count):
        out.log_likelihood[k + r] = 0.0
    write_qualities(b.inputs.quality, b.inputs.degraded, k, count, whole, out)
    if lost > 0:
        for r in range(count):
            if not is_known(out, k + r):
                invalidate(out, k + r)


def write_qualities(given, degraded, k, count, whole, out):
    """Each sensor's quality is what was given, as no sensor is refused; `whole` where none is absent."""
    for i in range(given.shape[1]):
        for r in range(count):
            out.sensor_quality[k + r, i] = given[k + r, i]
    for r in range(count):
        rate(out, k + r, ESTIMATE_GOOD if whole and degraded[k + r] == 0 else ESTIMATE_DEGRADED)


def is_known(out, k):
    """Whether heats and field of step k are numbers."""
    lost = 0
    for j in range(out.heat.shape[1]):
        lost += 0 if isfinite(out.heat[k, j]) else 1
    for q in range(out.field.shape[1]):
        lost += 0 if isfinite(out.field[k, q]) else 1
    return lost == 0


def go_on(p, c, r, state):
    """Go on from the state after r steps."""
    n_x, first = len(p.uniform), len(c.decay) - len(p.source)
    for a in range(len(c.decay)):
        c.states[0, a] = c.states[r, a]
    for a in range(n_x):
        state.x[a] = c.states[0, a]
    for j in range(len(p.source)):
        state.x[n_x + j] = c.states[0, first + j]
    if r > 0:
        state.flags[1] = 0


def take_steady_steps(b, settled, k, state, out, own):
    """Take regular steps from k on; return the first that is not, or that the gate would refuse."""
    laid_out, roughly, moving, s = (
        -1,
        own.considered.S.shape[1] > 0,
        len(b.plant.moving) > 0,
        len(own.steady.present),
    )
    most = 1 if roughly or moving else len(own.steady.weights)
    if not begin_steady_state(b.plant, own.gains, settled, state, own.steady):
        return k
    count, passed = 0, 0
    while k < len(b.step) and passed == count:
        d = b.step[k]
        count = read_run(
            b.inputs, k, count_regular(b.plant, b.inputs, b.step, k, most, own.steady), own.steady
        )
        if count == 0 or not own.bins.exact[d] or own.gains.key[settled] >> s != own.bins.number[d]:
            break
        move_columns(b.plant, b.inputs, k, own.work.B, own.work.C)
        move_rows(b.plant, b.inputs, k, own.steady.rows)
        if d == laid_out and moving:
            lay_out_moving(b.plant, b.table, d, own.work.B, own.work.C, own.steady)
        if d != laid_out:
            lay_out(b.plant, b.table, d, own.work.B, own.work.C, own.gains.K[settled], own.steady)
            set_gate(b.gate_sigma, own.gains.S[settled], own.steady)
            laid_out = d
        if roughly:
            propagate_considered(own.considered, b, k)
            consider_readings(own.considered, own.gains.S[settled])
            set_gate(b.gate_sigma, own.considered.variance, own.steady)
        step_states(own.steady, count, len(own.steady.decay) - len(b.plant.source))
        passed = count_passed(own.steady, count)
        write_run(b, k, passed, own.gains, settled, own.steady, out)
        go_on(b.plant, own.steady, passed, state)
        if roughly and passed == 1:
            correct_considered(own.considered, own.gains.K[settled], own.steady.present)
            finish_considered(own.considered, b.inputs.dt_s[k], state.x)
            for i in range(s):
                if own.steady.present[i]:
                    out.innovation_sigma[k, i] = sqrt(own.considered.variance[i])
            move_rows(b.plant, b.inputs, k, own.work.rows)
            add_considered(own.considered, own.work.rows, k, out)
        k += passed
    return k
