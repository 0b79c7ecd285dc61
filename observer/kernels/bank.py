"""A bank of filters, each without some of the sensors: their inputs, their steps, and the bounds.

The bank steps rarely. Inputs are gathered over a span of the estimate's steps, and the bank takes one step
over the span. Every filter is the Kalman filter without some of the sensors.
"""

from __future__ import annotations

from observer.kernels.codes import ERROR, ESTIMATE_DEGRADED, ESTIMATE_INVALID, ESTIMATE_STARTING, FIELD
from observer.kernels.covariance import squared
from observer.kernels.judging import add_prior, step_is_finite
from observer.kernels.kalman import filter_part
from observer.kernels.learning import advance_learning, below
from observer.kernels.libc import NAN, exp, isfinite, sqrt
from observer.kernels.screening import open_common, open_offset
from observer.kernels.step import project, residual, sensor_covariance

# Entries of `span`: its length, the length at which the bank is due, and the worst degradation of an input.
SPAN_S, DUE_S, DEGRADED = 0, 1, 2
ANSWER_S = 20.0
"""Time of readings to respond to a changed heat: the lags of sensors and of dropped modes."""


def gather(u, k, g):
    """Take step k into the span; return whether the bank is due."""
    if not step_is_finite(u, k):
        return False
    dt_s = u.dt_s[k]
    if g.span[SPAN_S] == 0.0:
        for q in range(len(g.z_first)):
            g.z_first[q] = u.z_start[k, q]
    g.span[SPAN_S] += dt_s
    g.span[DEGRADED] = max(g.span[DEGRADED], u.degraded[k])
    for j in range(len(g.law_J)):
        g.law_J[j] += u.law_W[k, j] * dt_s
        g.jump_W2[j] += u.law_jump_W[k, j] * u.law_jump_W[k, j]
    for q in range(len(g.z_last)):
        g.z_last[q] = u.z_end[k, q]
    for i in range(len(g.moving)):
        weight = abs(u.law_W[k, g.moving[i]]) * dt_s
        g.weight[i] += weight
        for a in range(g.B.shape[1]):
            g.B[i, a] += weight * u.moving_B[k, i, a]
            g.plain_B[i, a] += dt_s * u.moving_B[k, i, a]
        for r in range(g.C.shape[1]):
            g.C[i, r] = u.moving_C[k, i, r]
    for i in range(len(g.y_degC)):
        if u.usable[k, i]:
            g.y_degC[i], g.fresh[i] = u.y_degC[k, i], True
    g.loss[0] += u.loss_1_s[k] * dt_s
    g.loss[1] += u.loss_1_s[k] * u.loss_degC[k] * dt_s
    g.loss[2] = u.loss_degC[k]
    return g.span[SPAN_S] >= g.span[DUE_S]


def pour(g, state, u):
    """Write the span as the inputs of one step, without readings that the estimate's `state` doubts."""
    span_s = g.span[SPAN_S]
    u.dt_s[0] = span_s
    u.degraded[0] = int(g.span[DEGRADED])
    for j in range(len(g.law_J)):
        u.law_W[0, j], u.law_jump_W[0, j] = g.law_J[j] / span_s, sqrt(g.jump_W2[j])
        g.law_J[j], g.jump_W2[j] = 0.0, 0.0
    for q in range(len(g.z_first)):
        u.z_start[0, q], u.z_end[0, q] = g.z_first[q], g.z_last[q]
    for i in range(len(g.moving)):
        for a in range(g.B.shape[1]):
            u.moving_B[0, i, a] = g.B[i, a] / g.weight[i] if g.weight[i] > 0.0 else g.plain_B[i, a] / span_s
            g.B[i, a], g.plain_B[i, a] = 0.0, 0.0
        g.weight[i] = 0.0
        for r in range(g.C.shape[1]):
            u.moving_C[0, i, r] = g.C[i, r]
    for i in range(len(g.y_degC)):
        doubted = state.guard[i].cause != 0.0 or state.guard[i].pending > 0.0 or state.suspect[i] > 0.0
        u.y_degC[0, i], g.free[i] = g.y_degC[i], g.fresh[i] and not doubted
        g.fresh[i] = False
    u.loss_1_s[0] = g.loss[0] / span_s
    u.loss_degC[0] = g.loss[1] / g.loss[0] if g.loss[0] > 0.0 else g.loss[2]
    g.loss[0], g.loss[1] = 0.0, 0.0
    g.span[SPAN_S], g.span[DEGRADED] = 0.0, 0.0


def open_again(p, state, P):
    """Inflate P as the estimate's covariance was inflated since the last step of the bank."""
    if state.verdict[0].opened_prior > 0.0:
        add_prior(p, P, min(1.0, state.verdict[0].opened_prior))
    if state.verdict[0].opened_common_K2 > 0.0:
        open_common(p, state.verdict[0].opened_common_K2, P)
    for i in range(len(state.guard)):
        if state.guard[i].opened_K2 > 0.0:
            open_offset(p, i, state.guard[i].opened_K2, P)


def pass_left_out(b, bank, f, state):
    """Write the misfit of each reading that filter f has not used: its innovation in σ."""
    for i in range(len(bank.gathered.free)):
        bank.misfit[f, i] = 0.0
        if not bank.gathered.free[i] or bank.uses[f, i] or state.flags[0] == 0:
            continue
        sensor_covariance(bank.work.C, i, state.P, bank.work.g)
        variance_K2 = project(bank.work.C, i, bank.work.g, i) + b.plant.R_K2[i]
        off_K = residual(b.plant, bank.work.C, b.inputs, 0, i, state.x) - state.verdict[0].common_K
        bank.misfit[f, i] = off_K / sqrt(variance_K2)


def predict_on(b, g, work):
    """Continue earlier estimates over the span without readings, and write the predicted readings.

    `work` holds the columns of the span.
    """
    for w in range(len(g.ahead)):
        advance_learning(b.plant, b, 0, g.ahead[w], len(b.plant.learn.kind), work)
        for i in range(len(g.free)):
            g.ahead_degC[w, i] = below(b.plant, b.inputs, 0, work.C, i, g.ahead[w])


def run_bank(b, bank, main, walk_K2):
    """Step every filter of a bank over the span; filter f uses the sensors marked in `bank.uses[f]`.

    In filter `bank.drifting` each offset and their common part walk by a variance of `walk_K2`. The inputs of
    `b` are the gathered ones. The misfits of unused readings go into `bank.misfit` (F, s). The covariance of
    the first filter's innovations goes into `bank.S` (s, s).
    """
    p, u, g = b.plant, b.inputs, bank.gathered
    for f in range(len(bank.filters)):
        state = bank.filters[f]
        for i in range(len(g.free)):
            u.usable[0, i] = g.free[i] and bank.uses[f, i]
        state.verdict[0].common_K = main.verdict[0].common_K
        open_again(p, main, state.P)
        if f == bank.drifting and state.flags[0] != 0:
            open_common(p, walk_K2, state.P)
            for i in range(len(g.free)):
                open_offset(p, i, walk_K2, state.P)
        result = bank.results[f]
        filter_part(b, state, result, bank.work, 0, 1)
        if f == 0:
            for i in range(len(bank.S)):
                for j in range(i, len(bank.S)):
                    bank.S[i, j] = bank.S[j, i] = bank.work.S[i, j]
                bank.S[i, i] += p.R_K2[i]
            predict_on(b, g, bank.work)
        pass_left_out(b, bank, f, state)
    main.verdict[0].opened_prior = main.verdict[0].opened_common_K2 = 0.0
    for i in range(len(main.guard)):
        main.guard[i].opened_K2 = 0.0


def add_change(p, u, k, bounds, j):
    """Return the variance that a change of its law adds to heat j at step k, W².

    The time of the change within the step is unknown. Afterwards the law keeps its initial uncertainty until
    readings have had time to respond. Without this, σ would be too small in the first seconds.
    """
    jump_W = u.law_jump_W[k, p.source[j]]
    bounds.law_change_W2[j] = bounds.law_change_W2[j] * exp(-2.0 * u.dt_s[k] / ANSWER_S) + squared(
        p.jump_uncertainty[j] * jump_W
    )
    return bounds.law_change_W2[j] + squared(0.5 * jump_W)


def put_bounds(p, u, out, k, bounds):
    """Write the bounds of step k: those of the bank's last step, at least `bounds.sigmas` times σ.

    First, the variances of drifting readings are added to those of the estimate. The bound of a heat also
    contains the variance of a changed law, for some seconds. Field and error are degraded beyond their
    limits, and starting while their σ is above `known_sigma`. Sensors that do not check each other give no
    bound; limits then apply to the same multiple of σ.
    """
    for j in range(len(bounds.heat_W)):
        variance_W2 = squared(out.heat_sigma[k, j]) + bounds.heat_drift_W2[j]
        out.heat_sigma[k, j] = sqrt(variance_W2)
        bound = max(bounds.heat_W[j], bounds.sigmas * sqrt(variance_W2 + add_change(p, u, k, bounds, j)))
        out.heat_bound[k, j] = bound if bounds.published else NAN
    for r in range(len(bounds.field)):
        out.field_sigma[k, r] = sqrt(squared(out.field_sigma[k, r]) + bounds.field_drift2[r])
        part, bound = FIELD if r < bounds.grid else ERROR, bounds.sigmas * out.field_sigma[k, r]
        if bounds.published:
            bound = max(bounds.field[r], bound)
        out.field_bound[k, r] = bound if bounds.published else NAN
        if isfinite(bounds.limit[r]) and not bound <= bounds.limit[r]:
            out.part_quality[k, part] = max(out.part_quality[k, part], ESTIMATE_DEGRADED)
        elif out.field_sigma[k, r] > bounds.known_sigma[part - FIELD]:
            out.part_quality[k, part] = max(out.part_quality[k, part], ESTIMATE_STARTING)
    out.quality[k] = max(out.part_quality[k, FIELD], out.part_quality[k, ERROR])
    if out.quality[k] == ESTIMATE_INVALID:
        for j in range(len(bounds.heat_W)):
            out.heat_bound[k, j] = NAN
        for r in range(len(bounds.field)):
            out.field_bound[k, r] = NAN


def run_until_due(b, state, out, work, g, bounds, first):
    """Run the filter from step `first` until the bank is due; return the step after the last one taken.

    The bounds of the last step are written after the bank has stepped.
    """
    for k in range(first, len(b.step)):
        filter_part(b, state, out, work, k, k + 1)
        if gather(b.inputs, k, g):
            return k + 1
        put_bounds(b.plant, b.inputs, out, k, bounds)
    return len(b.step)
