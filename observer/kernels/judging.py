"""Quality of a step: usable readings, the gate, the qualities, and the reported results."""

from __future__ import annotations

from observer.kernels.codes import (
    ESTIMATE_DEGRADED,
    ESTIMATE_GOOD,
    ESTIMATE_INVALID,
    ESTIMATE_STALE,
    ESTIMATE_STARTING,
    EXCLUDED,
    GOOD,
    NUT_LOST,
    REJECTED,
    STALE,
)
from observer.kernels.covariance import add_scaled, squared, squares_of_rows, sum_scaled
from observer.kernels.libc import INFINITY, NAN, cython, floor, fmod, isfinite, isinf, sqrt
from observer.kernels.vector import LANES, store_at, zero_lanes

RELEASE_AFTER_STEPS = 3
STALE_AFTER_STEPS = 2
# A sensor that has been refused for so long may be right, and the state led astray …
REOPEN_AFTER_S = 20.0
# … which is tried again so often …
REOPEN_EVERY_S = 60.0
# … and each time the other sensors, with the state opened, have so long to speak first.
HELD_BACK_S = 40.0
LOST_S = 40.0
# For so long after a start readings are not judged, and no estimate is good.
QUIET_S = 20.0
_REOPEN_AT_LEAST = 0.01
_REOPEN_SIGMA = 3.0
_AGREES = 0.3  # part of what a sensor was off when the state was opened for it


def step_is_finite(u, k):
    """Return whether every law, known input and moving column of step k is finite."""
    total = 0.0
    for j in range(u.law_W.shape[1]):
        total += u.law_W[k, j]
    for q in range(u.z_end.shape[1]):
        total += u.z_start[k, q] + u.z_end[k, q]
    for i in range(u.moving_B.shape[1]):
        for a in range(u.moving_B.shape[2]):
            total += u.moving_B[k, i, a]
    return isfinite(total)


def find_usable(u, k, usable):
    """Mark the usable sensors at step k, those with a finite value; return their number."""
    count = 0
    for i in range(len(usable)):
        usable[i] = u.usable[k, i] and isfinite(u.y_degC[k, i])
        if usable[i]:
            count += 1
    return count


def gate(S, gate_sigma, state, work):
    """Reject |ν_i| > gate √S_i; return whether the model rather than the sensors must be wrong.

    This is the case if more than half of the usable sensors have been rejected for three steps in a row. Then
    all readings are accepted, the counts start again, and the caller must inflate P before the correction. A
    single sensor among several stays rejected while it disagrees.
    """
    present, long_refused = 0, 0
    for i in range(len(work.nu)):
        work.accepted[i] = work.usable[i]
        if work.usable[i]:
            present += 1
            if work.nu[i] * work.nu[i] > gate_sigma * gate_sigma * S[i]:
                work.accepted[i] = False
                state.suspect[i] += 1.0
                if state.suspect[i] >= RELEASE_AFTER_STEPS:
                    long_refused += 1
            else:
                state.suspect[i] = 0.0
    if 2 * long_refused <= present:
        return False
    for i in range(len(work.nu)):
        work.accepted[i] = work.usable[i]
        if work.usable[i]:
            state.suspect[i] = 0.0
    return True


def defer_readmitted(state, work):
    """Reject sensors for which P was inflated, until the others have corrected or they agree again."""
    for i in range(len(work.usable)):
        since_s, opened_K = state.refused_s[i] - REOPEN_AFTER_S, state.opened_K[i]
        due = since_s >= 0.0 and fmod(since_s, REOPEN_EVERY_S) < HELD_BACK_S
        if work.accepted[i] and due and opened_K != 0.0 and abs(work.nu[i]) > _AGREES * abs(opened_K):
            work.accepted[i] = False
            state.suspect[i] = 1.0


def refuse(S, gate_sigma, model_may_be_wrong, state, work):
    """Reject readings beyond the gate; return whether all sensors were released from it (see `gate`)."""
    released = gate(S, gate_sigma, state, work)
    if model_may_be_wrong and not released:
        defer_readmitted(state, work)
    return released


def readmit(p, dt_s, released, model_may_be_wrong, state, work):
    """Inflate P so that rejected sensors can return; return the added share of the prior.

    After a release of all sensors the share is 1. Wrong inputs make a filter overconfident, so that it
    rejects correct sensors. If the model may be wrong, a share of the prior is added after 20 s and three
    samples, and then every minute. The share is the one with which the rejected sensor could be right. The
    other sensors correct first. A broken sensor is rejected again.
    """
    share = 0.0
    if released:
        add_prior(p, state.P, 1.0)
    for i in range(len(work.usable)):
        if work.usable[i] and work.accepted[i]:
            state.refused_s[i] = 0.0
            state.opened_K[i] = 0.0
        elif work.usable[i] or state.refused_s[i] > 0.0:
            before = floor((state.refused_s[i] - REOPEN_AFTER_S) / REOPEN_EVERY_S)
            state.refused_s[i] += dt_s
            if not model_may_be_wrong:
                continue
            if floor((state.refused_s[i] - REOPEN_AFTER_S) / REOPEN_EVERY_S) > before:
                state.opened_K[i] = INFINITY  # due with its next sample
            if work.usable[i] and isinf(state.opened_K[i]) and state.suspect[i] >= RELEASE_AFTER_STEPS:
                share = max(share, _share_of_prior(p, work.C, i, work.nu[i]))
                state.opened_K[i] = work.nu[i]
    if share > 0.0:
        add_prior(p, state.P, share)
    return share + 1.0 if released else share


def judge_sensors(p, u, k, gate_sigma, state, work):
    """Mark the accepted sensors; return whether P was inflated, so that `compare` must run again."""
    released = refuse(work.S_nu, gate_sigma, True, state, work)
    return readmit(p, u.dt_s[k], released, True, state, work) > 0.0


def inflate_for_lost_position(p, u, k, lost_s, P):
    """Inflate P while the position of a nut is unknown, because its heat enters at an unknown place.

    The misplaced heat grows with time. The share of the prior grows with its square, up to 1 after 40 s.
    """
    if u.degraded[k] < NUT_LOST:
        lost_s[0] = 0.0
        return
    before_s = lost_s[0]
    lost_s[0] = min(before_s + u.dt_s[k], LOST_S)
    until_s, from_s = max(lost_s[0], u.dt_s[k]), min(before_s, LOST_S - u.dt_s[k])
    add_prior(p, P, (squared(until_s) - squared(from_s)) / squared(LOST_S))


def _share_of_prior(p, C, i, nu):
    """Return the share of the prior with which an innovation of sensor i is three standard deviations."""
    n_x, variance = len(p.uniform), 0.0
    for a in range(n_x):
        for b in range(n_x):
            variance += C[i, a] * p.prior_P[a, b] * C[i, b]
    return min(1.0, max(_REOPEN_AT_LEAST, squared(nu / _REOPEN_SIGMA) / max(variance, 1e-12)))


def add_prior(p, P, share):
    """Add a share of the prior's covariance of field, heats and parameters to P.

    Variances of parameters do not exceed those of the prior.
    """
    n_x, first = len(p.uniform), len(p.uniform) + len(p.source)
    for a in range(n_x):
        for b in range(n_x):
            P[a, b] += share * p.prior_P[a, b]
    for j in range(len(p.source)):
        P[n_x + j, n_x + j] += share * p.initial_W2[j]
    for q in range(len(p.learn.sigma)):
        variance = squared(p.learn.sigma[q])
        P[first + q, first + q] += max(0.0, min(share * variance, variance - P[first + q, first + q]))


def judge(u, k, usable, accepted, state, out):
    """Write each sensor's quality and return that of the estimate; `state.flags[1]` counts silent steps.

    A rejected sensor stays marked between its samples. A tick between two samples of a slow sensor is neither
    degraded nor stale. With `state.flags[2]` the bounds have limits, and an estimate within them does not
    need sensors without usable readings.
    """
    good, stale, refused, lost = 0, 0, 0, 0
    for i in range(len(usable)):
        quality = u.quality[k, i]
        if len(state.guard) > 0 and state.guard[i].cause != 0.0:
            state.guard[i].steps_out += 1.0
            if quality == GOOD:
                quality = EXCLUDED
        elif quality != GOOD:
            lost += 1
        if quality == GOOD and (
            (usable[i] and not accepted[i]) or (not usable[i] and state.suspect[i] > 0.0)
        ):
            quality = REJECTED
            refused += 1
        out.sensor_quality[k, i] = quality
        if quality == GOOD:
            good += 1
        elif quality == STALE:
            stale += 1
    state.flags[1] = 0 if good > 0 else state.flags[1] + 1
    if state.flags[1] > STALE_AFTER_STEPS or stale == len(usable):
        return ESTIMATE_STALE
    if u.degraded[k] != 0 or refused > 0 or (lost > 0 and state.flags[2] == 0):
        return ESTIMATE_DEGRADED
    if len(state.guard) == 0:
        return ESTIMATE_GOOD
    return judge_screening(cython.address(state.verdict[0]), u.time_s[k])


def judge_screening(verdict, time_s):
    """Return the quality by the screening's verdict.

    It is degraded if a fault is unexplained or was decided just now. It is starting if the estimate still
    settles or readings are not yet judged.
    """
    if verdict.hold_s > 0.0 or verdict.settling_s > 0.0:
        if time_s > verdict.held_until_s:
            verdict.held_from_s = time_s
        verdict.held_until_s = time_s + max(verdict.hold_s, verdict.settling_s)
        verdict.held_steps += 1.0
    verdict.latch_steps += 1.0 if verdict.latch != 0.0 else 0.0
    verdict.common_steps += 1.0 if verdict.common_K != 0.0 else 0.0
    if verdict.latch != 0.0 or verdict.hold_s > 0.0:
        return ESTIMATE_DEGRADED
    if verdict.settling_s > 0.0 or verdict.runs_s <= QUIET_S:
        return ESTIMATE_STARTING
    return ESTIMATE_GOOD


def skip(u, k, usable, state, out):
    """Report a step that cannot be computed; the state does not change."""
    judge(u, k, usable, usable, state, out)
    forget(out.law, k)
    forget(out.innovation, k)
    forget(out.innovation_sigma, k)
    out.log_likelihood[k] = 0.0
    invalidate(out, k)


def write_innovations(nu, S, usable, k, out):
    """Write innovations and their σ of step k, NaN without a usable value."""
    for i in range(len(usable)):
        out.innovation[k, i] = nu[i] if usable[i] else NAN
        out.innovation_sigma[k, i] = sqrt(S[i]) if usable[i] else NAN


def forget(rows, k):
    """Fill row k with NaN."""
    for q in range(rows.shape[1]):
        rows[k, q] = NAN


def invalidate(out, k):
    """Write NaN for the results of step k, with the quality invalid."""
    forget(out.heat, k)
    forget(out.heat_sigma, k)
    forget(out.field, k)
    forget(out.field_sigma, k)
    forget(out.learned, k)
    forget(out.learned_sigma, k)
    rate(out, k, ESTIMATE_INVALID)


def rate(out, k, quality):
    """Write the quality of step k, and the same of its heats, its field and its thermal error."""
    out.quality[k] = quality
    for part in range(out.part_quality.shape[1]):
        out.part_quality[k, part] = quality


def move_rows(p, u, k, rows):
    """Put the columns of the moving sources over step k in place among the rows that are reported."""
    s = len(p.R_K2)
    for i in range(len(p.moving)):
        for r in range(u.moving_C.shape[2] - s):
            rows[p.modes + p.moving[i], r] = u.moving_C[k, i, s + r]


def write_values(p, u, k, state, work, out):
    """Write heats and their laws, field and error of step k; return whether all are finite."""
    n_x, lost = len(p.uniform), 0
    for j in range(len(p.source)):
        law = work.law[p.source[j]]
        out.law[k, j] = law
        out.heat[k, j] = law + state.x[n_x + j]
        lost += 0 if isfinite(out.heat[k, j]) else 1
    for q in range(len(work.value) // LANES):
        store_at(work.value, q, sum_scaled(zero_lanes(), p.rows_F, q, u.z_end, k, len(p.rows_F)))
    add_scaled(work.value, work.rows, state.x, n_x)
    for r in range(out.field.shape[1]):
        out.field[k, r] = work.value[r]
        lost += 0 if isfinite(work.value[r]) else 1
    return lost == 0


def write_step(p, u, k, state, work, out):
    """Write the results and the quality of step k; return whether all are finite."""
    rate(out, k, judge(u, k, work.usable, work.accepted, state, out))
    move_rows(p, u, k, work.rows)
    is_valid = write_values(p, u, k, state, work, out)
    return write_sigmas(state, k, work, out) and is_valid


def write_sigmas(state, k, work, out):
    """Write σ = √(c P cᵀ) of every heat and output row at step k; return whether all are finite."""
    n_x, lost = len(work.rows), 0
    for j in range(out.heat_sigma.shape[1]):
        out.heat_sigma[k, j] = sqrt(state.P[n_x + j, n_x + j])
        lost += 0 if isfinite(out.heat_sigma[k, j]) else 1
    squares_of_rows(state.P, work.rows, out.field_sigma.shape[1], work.value)
    # A field that is known exactly (a prescribed end) has a variance of zero, give or take rounding.
    for r in range(out.field_sigma.shape[1]):
        out.field_sigma[k, r] = sqrt(max(0.0, work.value[r]))
        lost += 0 if isfinite(work.value[r]) else 1
    return lost == 0


def clear(P):
    """P = 0."""
    for a in range(P.shape[0]):
        for b in range(P.shape[1]):
            P[a, b] = 0.0
