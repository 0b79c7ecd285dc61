"""The compiled arithmetic of one step, and the Kalman filter's loop over K steps.

The plant is diagonal and the heats reach it only through their input columns, so predicting a covariance
costs O(n²). Nothing here calls BLAS and no sum is reordered: K steps give the same bits as K runs of one.
Arrays are changed in place; shapes are those of `packing`.
"""

# numba compiles these functions: their types are those of the arrays they get.
# mypy: disable-error-code="no-untyped-def, misc"

from __future__ import annotations

import numpy as np

from observer.estimators import packing, steps
from observer.estimators.compiling import cached_loop, inlined, rarely

GOOD, STALE, REJECTED = 0, 2, 3
ESTIMATE_GOOD, ESTIMATE_DEGRADED, ESTIMATE_STALE, ESTIMATE_INVALID = 0, 1, 2, 3
RELEASE_AFTER_STEPS = 3
STALE_AFTER_STEPS = 2


@inlined
def step_is_finite(u, k):
    """Whether every law, known input and moving column of step k is a number."""
    total = 0.0
    for j in range(u.law.shape[1]):
        total += u.law[k, j]
    for q in range(u.z_end.shape[1]):
        total += u.z_start[k, q] + u.z_end[k, q]
    for i in range(u.moving_B.shape[1]):
        for a in range(u.moving_B.shape[2]):
            total += u.moving_B[k, i, a]
    return np.isfinite(total)


@inlined
def move_columns(p, u, k, B, C):
    """Put the columns of the moving sources over step k in place."""
    for i in range(len(p.moving)):
        index = p.moving[i]
        for a in range(B.shape[1]):
            B[index, a] = u.moving_B[k, i, a]
        for r in range(C.shape[0]):
            C[r, p.modes + index] = u.moving_C[k, i, r]


@inlined
def predict_state(p, t, d, u, k, B, x, work):
    """x⁺ = e∘x + hold∘(B law + E z_start) + ramp∘(E (z_end - z_start)) + Σ_j B_j∘couple_j δ_j;  δ⁺ = γ∘δ."""
    n_x = B.shape[1]
    for a in range(n_x):
        work.forced[a] = 0.0
        work.ramped[a] = 0.0
    for j in range(B.shape[0]):
        law = u.law[k, j]
        for a in range(n_x):
            work.forced[a] += B[j, a] * law
    for q in range(p.E.shape[0]):
        z, rise = u.z_start[k, q], u.z_end[k, q] - u.z_start[k, q]
        for a in range(n_x):
            work.forced[a] += p.E[q, a] * z
            work.ramped[a] += p.E[q, a] * rise
    for a in range(n_x):
        x[a] = t.decay[d, a] * x[a] + t.hold[d, a] * work.forced[a] + t.ramp[d, a] * work.ramped[a]
    for j in range(len(p.source)):
        delta, index = x[n_x + j], p.source[j]
        for a in range(n_x):
            x[a] += B[index, a] * t.couple[d, j, a] * delta
        x[n_x + j] = t.heat_decay[d, j] * delta


@inlined
def predict_covariance(p, t, d, u, k, B, P, work):
    """P⁺ = Ad (P + jump) Adᵀ + Qd, with the law's jump acting from the start of the step.

    With G the heats' columns: M = e∘P_xδ + G P_δδ, then P_xx⁺ = (e eᵀ)∘P_xx + M Gᵀ + G (e∘P_xδ)ᵀ + Q_xx. Only
    the lower triangle counts; it is mirrored at the end, so P stays symmetric to the last bit. Rows are
    worked out over their padded width, where decay, G, S and M are zero.
    """
    n_x, m_e, width = B.shape[1], len(p.source), P.shape[1]
    G, S, M = work.G, work.S, work.M
    for j in range(m_e):
        index = p.source[j]
        jump = p.law_uncertainty[j] * u.jump[k, index]
        P[n_x + j, n_x + j] += jump * jump
        for a in range(n_x):
            G[j, a] = B[index, a] * t.couple[d, j, a]
        for b in range(width):
            S[j, b] = t.decay[d, b] * P[n_x + j, b]
            M[j, b] = S[j, b]
    for j in range(m_e):
        for i in range(m_e):
            shared = P[n_x + max(j, i), n_x + min(j, i)]
            for b in range(width):
                M[j, b] += shared * G[i, b]
    for a in range(n_x):
        scale = t.decay[d, a]
        for b in range(width):
            P[a, b] = scale * t.decay[d, b] * P[a, b] + t.noise_xx[d, a, b]
        for j in range(m_e):
            left, right = M[j, a], G[j, a]
            for b in range(width):
                P[a, b] += left * G[j, b] + right * S[j, b]
    for i in range(len(p.moving)):
        if p.moving_heat[i] >= 0:
            add_walk(B, p.moving[i], t.walk_xx, d, p.moving_heat[i], P)
    predict_heats(p, t, d, B, M, P)
    mirror(P)


@inlined
def predict_heats(p, t, d, B, M, P):
    """Lower rows of P⁺: P_δx⁺ = γ∘Mᵀ + Q_δx, P_δδ⁺ = (γ γᵀ)∘P_δδ + Q_δδ."""
    m_e, n_x = len(p.source), B.shape[1]
    for j in range(m_e):
        keep = t.heat_decay[d, j]
        for a in range(n_x):
            P[n_x + j, a] = keep * M[j, a] + B[p.source[j], a] * t.walk_dx[d, j, a]
        for i in range(j + 1):
            P[n_x + j, n_x + i] = keep * t.heat_decay[d, i] * P[n_x + j, n_x + i]
        P[n_x + j, n_x + j] += t.walk_dd[d, j]


@inlined
def add_walk(B, index, walk_xx, d, j, P):
    """Add to the lower triangle what the walk of heat j leaves through its moving column."""
    for a in range(B.shape[1]):
        own = B[index, a]
        for b in range(a + 1):
            P[a, b] += own * B[index, b] * walk_xx[d, j, a, b]


@inlined
def mirror(P):
    """Copy the lower triangle to the upper."""
    for a in range(P.shape[0]):
        for b in range(a):
            P[b, a] = P[a, b]


@inlined
def symmetrise(P):
    """P = (P + Pᵀ)/2."""
    for a in range(P.shape[0]):
        for b in range(a):
            mean = 0.5 * (P[a, b] + P[b, a])
            P[a, b] = mean
            P[b, a] = mean


@inlined
def residual(p, C, u, k, i, x):
    """Measured minus expected temperature of sensor i at the end of step k, K."""
    nu = u.y[k, i]
    for a in range(C.shape[1]):
        nu -= C[i, a] * x[a]
    for q in range(p.F.shape[1]):
        nu -= p.F[i, q] * u.z_end[k, q]
    return nu


@inlined
def covariance_with_sensors(C, P, s, g):
    """g_i = P c_i for the first s rows of C."""
    for i in range(s):
        for b in range(P.shape[1]):
            g[i, b] = 0.0
        for a in range(C.shape[1]):
            c = C[i, a]
            for b in range(P.shape[1]):
                g[i, b] += c * P[a, b]


@inlined
def project(C, i, g, j):
    """c_iᵀ g_j over the plant states."""
    total = 0.0
    for a in range(C.shape[1]):
        total += C[i, a] * g[j, a]
    return total


@rarely
def start(p, C, u, k, usable, x, P):
    """Set x̂ to a screw of one temperature with the lags at rest under their laws, and P to the prior.

    That temperature is the median over the usable sensors, so that one broken sensor does not set it.
    """
    n_x = C.shape[1]
    x[:] = 0.0
    for j in range(n_x - p.modes):
        x[p.modes + j] = u.law[k, j]
    levels = np.empty(len(usable))
    count = 0
    for i in range(len(usable)):
        if usable[i]:
            seen = 0.0
            for a in range(n_x):
                seen += C[i, a] * p.uniform[a]
            # Next to a prescribed end the modes alone see little of a uniform temperature.
            level = residual(p, C, u, k, i, x) / seen if seen > 0.5 else u.y[k, i]
            place = count
            while place > 0 and levels[place - 1] > level:
                levels[place] = levels[place - 1]
                place -= 1
            levels[place] = level
            count += 1
    level = 0.5 * (levels[(count - 1) // 2] + levels[count // 2])
    for a in range(n_x):
        x[a] += p.uniform[a] * level
    P[:] = 0.0
    inflate(p, P)


@rarely
def inflate(p, P):
    """Add the prior's covariance of field and heats to P."""
    n_x = len(p.uniform)
    for a in range(n_x):
        for b in range(n_x):
            P[a, b] += p.prior_P[a, b]
    for j in range(len(p.source)):
        P[n_x + j, n_x + j] += p.initial_W2[j]


@inlined
def gate(nu, S, usable, suspect, gate_sigma, accepted):
    """Refuse |ν_i| > gate √S_ii; return whether the model, not the sensors, is the surprised one.

    That is so when more than half of the usable sensors have each been refused for three steps in a row: then
    everything is accepted, the counts start afresh, and the caller must inflate P before it corrects. A
    single sensor among several stays refused for as long as it disagrees.
    """
    present, long_refused = 0, 0
    for i in range(len(nu)):
        accepted[i] = usable[i]
        if usable[i]:
            present += 1
            if nu[i] * nu[i] > gate_sigma * gate_sigma * S[i]:
                accepted[i] = False
                suspect[i] += 1.0
                if suspect[i] >= RELEASE_AFTER_STEPS:
                    long_refused += 1
            else:
                suspect[i] = 0.0
    if 2 * long_refused <= present:
        return False
    for i in range(len(nu)):
        accepted[i] = usable[i]
        if usable[i]:
            suspect[i] = 0.0
    return True


@inlined
def judge(u, k, usable, accepted, state, out):
    """Fill in each sensor's quality and return that of the estimate; `state.flags[1]` counts the silent
    steps.

    A refused sensor stays marked between its samples. Only quality is judged: a tick between two samples of a
    slow sensor is neither degraded nor stale.
    """
    good, stale = 0, 0
    for i in range(len(usable)):
        quality = u.quality[k, i]
        if quality == GOOD and (
            (usable[i] and not accepted[i]) or (not usable[i] and state.suspect[i] > 0.0)
        ):
            quality = REJECTED
        out.sensor_quality[k, i] = quality
        if quality == GOOD:
            good += 1
        elif quality == STALE:
            stale += 1
    state.flags[1] = 0 if good > 0 else state.flags[1] + 1
    if state.flags[1] > STALE_AFTER_STEPS or stale == len(usable):
        return ESTIMATE_STALE
    if u.degraded[k] or good < len(usable):
        return ESTIMATE_DEGRADED
    return ESTIMATE_GOOD


@inlined
def joseph_update(R_K2, C, accepted, g, nu, S, x, P, work):
    """Correct x and P by every accepted sensor in turn; return the log-likelihood of their innovations.

    A = P - K gᵀ with g = P c, then P⁺ = A - (A c) Kᵀ + r K Kᵀ: the second part vanishes but for rounding, and
    that is what keeps P positive (Bucy and Joseph, 1968). What the sensors still to come expect (g, ν, S,
    which are used up) follows by rank-one steps. P is symmetric to rounding; the lower triangle is the one
    that counts.
    """
    (n, width), n_x, s = P.shape, C.shape[1], len(accepted)
    K, Ac = work.K, work.Ac
    squares, volume = 0.0, 1.0
    for i in range(s):
        if not accepted[i]:
            continue
        inverse, innovation, r = 1.0 / S[i], nu[i], R_K2[i]
        squares += innovation * innovation * inverse
        volume *= 2.0 * np.pi * S[i]
        for b in range(width):
            K[b] = g[i, b] * inverse
            Ac[b] = 0.0
        for a in range(n):
            x[a] += K[a] * innovation
        for a in range(n_x):
            gain, c = K[a], C[i, a]
            for b in range(width):
                value = P[a, b] - gain * g[i, b]
                P[a, b] = value
                Ac[b] += c * value
        for a in range(n_x, n):
            gain = K[a]
            for b in range(width):
                P[a, b] -= gain * g[i, b]
        for a in range(n):
            rest = r * K[a] - Ac[a]
            for b in range(width):
                P[a, b] += rest * K[b]
        for later in range(i + 1, s):
            if accepted[later]:
                shared = project(C, later, g, i)
                nu[later] -= shared * inverse * innovation
                S[later] -= shared * inverse * shared
                for b in range(width):
                    g[later, b] -= K[b] * shared
    return -0.5 * (squares + np.log(volume))


@inlined
def write_values(p, C, u, k, x, out):
    """Heats, field and error of step k; return whether all are numbers."""
    n_x, s = C.shape[1], u.y.shape[1]
    total = 0.0
    for j in range(len(p.source)):
        out.heat[k, j] = u.law[k, p.source[j]] + x[n_x + j]
        total += out.heat[k, j]
    for r in range(s, C.shape[0]):
        value = 0.0
        for a in range(n_x):
            value += C[r, a] * x[a]
        for q in range(p.F.shape[1]):
            value += p.F[r, q] * u.z_end[k, q]
        out.field[k, r - s] = value
        total += value
    return np.isfinite(total)


@inlined
def write_sigmas(C, s, P, heat_sigma, field_sigma, k, work):
    """σ = √(c P cᵀ) of every heat and output row into row k; return whether all are numbers."""
    n_x = C.shape[1]
    g = work.row
    total = 0.0
    for j in range(P.shape[0] - n_x):
        heat_sigma[k, j] = np.sqrt(P[n_x + j, n_x + j])
        total += heat_sigma[k, j]
    for r in range(s, C.shape[0]):
        for b in range(P.shape[1]):
            g[b] = 0.0
        for a in range(n_x):
            c = C[r, a]
            for b in range(P.shape[1]):
                g[b] += c * P[a, b]
        variance = 0.0
        for a in range(n_x):
            variance += C[r, a] * g[a]
        # A field that is known exactly (a prescribed end) has a variance of zero, give or take rounding.
        field_sigma[k, r - s] = np.sqrt(max(0.0, variance))
        total += variance
    return np.isfinite(total)


@rarely
def invalidate(out, k):
    """Mark step k as not known."""
    out.heat[k, :] = np.nan
    out.heat_sigma[k, :] = np.nan
    out.field[k, :] = np.nan
    out.field_sigma[k, :] = np.nan
    out.quality[k] = ESTIMATE_INVALID


@inlined
def find_usable(u, k, usable):
    """Which sensors may correct at step k; return how many. A value that is no number never may."""
    count = 0
    for i in range(len(usable)):
        usable[i] = u.usable[k, i] and np.isfinite(u.y[k, i])
        if usable[i]:
            count += 1
    return count


@rarely
def skip(u, k, usable, state, out):
    """Report a step that cannot be computed; the state stays as it is."""
    judge(u, k, usable, usable, state, out)
    invalidate(out, k)


@inlined
def compare(p, C, u, k, usable, g, x, nu, S):
    """Innovation ν_i and its variance S_ii before any correction, for every usable sensor."""
    for i in range(len(usable)):
        if usable[i]:
            nu[i] = residual(p, C, u, k, i, x)
            S[i] = project(C, i, g, i) + p.R_K2[i]


@cached_loop(packing, steps)
def run_kalman(p, t, u, state, gate_sigma, out, work):
    """Run the Kalman filter over the K steps of `u`, changing `state` and filling `out`.

    A step whose laws or known inputs are no numbers cannot be computed: it leaves the state as it is and is
    invalid.
    """
    s = u.y.shape[1]
    x, P, B, C = state.x, state.P, work.B, work.C
    nu, S, g, usable, accepted = work.nu, work.S_nu, work.g, work.usable, work.accepted
    for k in range(len(u.step)):
        present = find_usable(u, k, usable)
        if not step_is_finite(u, k) or (state.flags[0] == 0 and present == 0):
            skip(u, k, usable, state, out)
            continue
        move_columns(p, u, k, B, C)
        if state.flags[0] == 0:
            start(p, C, u, k, usable, x, P)
            state.flags[0] = 1
        else:
            predict_state(p, t, u.step[k], u, k, B, x, work)
            predict_covariance(p, t, u.step[k], u, k, B, P, work)
        if present > 0:
            covariance_with_sensors(C, P, s, g)
            compare(p, C, u, k, usable, g, x, nu, S)
            for i in range(s):
                if usable[i]:
                    out.innovation[k, i] = nu[i]
            if gate(nu, S, usable, state.suspect, gate_sigma, accepted):
                inflate(p, P)
                covariance_with_sensors(C, P, s, g)
                compare(p, C, u, k, usable, g, x, nu, S)
            out.log_likelihood[k] = joseph_update(p.R_K2, C, accepted, g, nu, S, x, P, work)
        out.quality[k] = judge(u, k, usable, accepted, state, out)
        known = write_values(p, C, u, k, x, out)
        known = write_sigmas(C, s, P, out.heat_sigma, out.field_sigma, k, work) and known
        if not known:
            invalidate(out, k)
    mirror(P)
