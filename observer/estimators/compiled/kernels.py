"""The compiled arithmetic of one step: predict state and covariance, correct them by the sensors.

The plant is diagonal and the heats reach it only through their input columns, so predicting a covariance
costs O(n²). Nothing here calls BLAS and no sum is reordered: K steps give the same bits as K runs of one.
Arrays are changed in place; shapes are those of `packing`.
"""

# numba compiles these functions: their types are those of the arrays they get.
# mypy: disable-error-code="no-untyped-def, misc"

from __future__ import annotations

import numpy as np

from observer.compiled import inlined, rarely
from observer.estimators.compiled.judging import add_prior
from observer.estimators.compiled.learning import advance_learning
from observer.model.advance import add_scaled, couple_covariance

_DRASTIC = 1e8  # what P expects of a sensor, in variances of its noise


@inlined
def predict(p, t, d, u, k, B, x, P, work):
    """One step of state and covariance; what couples the states acts in two halves around it."""
    advance_learning(p, t, d, u, k, B, x, len(p.learn.kind), work)
    if p.coupling.active:
        couple_covariance(p, u, k, u.z_start[k], B, 0, P, work)
    predict_covariance(p, t, d, u, k, B, P, work)
    if p.coupling.active:
        couple_covariance(p, u, k, u.z_end[k], B, 1, P, work)


@inlined
def predict_covariance(p, t, d, u, k, B, P, work):
    """P⁺ = Ad (P + jump) Adᵀ + Qd, with the law's jump acting from the start of the step.

    Ad = diag d + Σ_j G_j 1_jᵀ with G_j the column of heat j, so that with H_j = d∘P_j + ½ Σ_i P_ji G_i

        P⁺ = (d dᵀ)∘P + Σ_j (H_j G_jᵀ + G_j H_jᵀ) + Q.

    Written so, P stays symmetric to the last bit without being made so. Rows are worked out over their padded
    width, where d, G and H are zero. What is learnt of the machine acts through columns too, which are in G.
    """
    n_x, m_e, (n, width) = B.shape[1], len(p.source), P.shape
    G, H, columns = work.G, work.H, len(p.source) + p.learn.machine
    for j in range(m_e):
        index = p.source[j]
        jump = p.law_uncertainty[j] * u.law_jump_W[k, index]
        P[n_x + j, n_x + j] += jump * jump
        for a in range(n_x):
            G[j, a] = B[index, a] * t.couple[d, j, a]
    for j in range(columns):
        for b in range(width):
            H[j, b] = t.decay[d, b] * P[n_x + j, b]
        for i in range(columns):
            shared = 0.5 * P[n_x + j, n_x + i]
            for b in range(width):
                H[j, b] += shared * G[i, b]
    for a in range(n):
        scale = t.decay[d, a]
        for b in range(width):
            P[a, b] = scale * t.decay[d, b] * P[a, b] + t.noise[d, a, b]
    add_pairs(H, G, columns, n_x, P)
    for i in range(len(p.moving)):
        if p.moving_heat[i] >= 0:
            add_walk(B, p.moving[i], t, d, p.moving_heat[i], P)


@inlined
def add_pairs(H, G, count, n_x, P):
    """P += Σ_j (H_j G_jᵀ + G_j H_jᵀ), two of them at a time; G is zero beyond its first n_x entries."""
    n, width = P.shape
    for j in range(0, count - 1, 2):
        for a in range(n_x):
            h0, g0, h1, g1 = H[j, a], G[j, a], H[j + 1, a], G[j + 1, a]
            for b in range(width):
                P[a, b] += (h0 * G[j, b] + g0 * H[j, b]) + (h1 * G[j + 1, b] + g1 * H[j + 1, b])
        for a in range(n_x, n):
            h0, h1 = H[j, a], H[j + 1, a]
            for b in range(n_x):
                P[a, b] += h0 * G[j, b] + h1 * G[j + 1, b]
    if count % 2 == 1:
        j = count - 1
        for a in range(n_x):
            h0, g0 = H[j, a], G[j, a]
            for b in range(width):
                P[a, b] += h0 * G[j, b] + g0 * H[j, b]
        for a in range(n_x, n):
            h0 = H[j, a]
            for b in range(n_x):
                P[a, b] += h0 * G[j, b]


@inlined
def add_walk(B, index, t, d, j, P):
    """Add what the walk of heat j leaves through its moving column."""
    n_x = B.shape[1]
    for a in range(n_x):
        own, shared = B[index, a], B[index, a] * t.walk_dx[d, j, a]
        for b in range(n_x):
            P[a, b] += own * B[index, b] * t.walk_xx[d, j, a, b]
        P[n_x + j, a] += shared
        P[a, n_x + j] += shared


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
    nu = u.y_degC[k, i]
    for a in range(C.shape[1]):
        nu -= C[i, a] * x[a]
    for q in range(p.F.shape[1]):
        nu -= p.F[i, q] * u.z_end[k, q]
    return nu


@inlined
def sensor_covariance(C, i, P, g):
    """g_i = P c_i."""
    for b in range(P.shape[1]):
        g[i, b] = 0.0
    for a in range(C.shape[1]):
        c = C[i, a]
        if c != 0.0:  # of what is learnt, a sensor sees its own only
            for b in range(P.shape[1]):
                g[i, b] += c * P[a, b]


@inlined
def covariance_with_sensors(C, P, s, g):
    """g_i = P c_i for the first s rows of C."""
    for i in range(s):
        sensor_covariance(C, i, P, g)


@inlined
def project(C, i, g, j):
    """c_iᵀ g_j over the states that sensors see."""
    total = 0.0
    for a in range(C.shape[1]):
        total += C[i, a] * g[j, a]
    return total


@rarely
def start(p, C, u, k, usable, x, P, levels):
    """Set x̂ to a screw of one temperature with the lags at rest under their laws, and P to the prior.

    That temperature is the median over the usable sensors, so that one broken sensor does not set it.
    `levels` (s,) is scratch.
    """
    n_x = len(p.uniform)
    x[:] = 0.0
    for j in range(u.law_W.shape[1]):
        x[p.modes + j] = u.law_W[k, j]
    count = 0
    for i in range(len(usable)):
        if usable[i]:
            seen = 0.0
            for a in range(n_x):
                seen += C[i, a] * p.uniform[a]
            # Next to a prescribed end the modes alone see little of a uniform temperature.
            level = residual(p, C, u, k, i, x) / seen if seen > 0.5 else u.y_degC[k, i]
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
    add_prior(p, P, 1.0)


@inlined
def is_drastic(R_K2, accepted, S):
    """Whether an accepted sensor says so much that P - Wᵀ W would have no digits left."""
    drastic = False
    for i in range(len(accepted)):
        drastic = drastic or (accepted[i] and S[i] > _DRASTIC * R_K2[i])
    return drastic


@inlined
def joint_update(R_K2, C, accepted, g, nu, S, x, P, work):
    """Correct x and P by all accepted sensors at once; return the log-likelihood of their innovations.

    With S = L Lᵀ the covariance of the innovations and W = L⁻¹ [c_i P]: x⁺ = x + Wᵀ L⁻¹ ν, P⁺ = P - Wᵀ W,
    which is symmetric to the last bit. Where a sensor says so much that the difference would have no digits
    left, the sensors correct one after the other in Joseph's form.
    """
    if is_drastic(R_K2, accepted, S):
        return joseph_update(R_K2, C, accepted, g, nu, x, P, work)
    L, W, e, order = work.L, work.W, work.e, work.order
    squares, volume, count = 0.0, 1.0, 0
    for i in range(len(accepted)):
        if not accepted[i]:
            continue
        order[count] = i
        variance, rest = S[i], nu[i]
        for j in range(count):
            shared = project(C, i, g, order[j])
            for q in range(j):
                shared -= L[count, q] * L[j, q]
            shared *= L[j, j]
            L[count, j] = shared
            variance -= shared * shared
            rest -= shared * e[j]
        inverse = 1.0 / np.sqrt(variance)
        L[count, count] = inverse
        e[count] = rest * inverse
        squares += e[count] * e[count]
        volume *= 2.0 * np.pi * variance
        whiten(L, count, g, i, W)
        count += 1
    add_scaled(x, W, e, count)
    subtract_squares(W, count, P)
    return -0.5 * (squares + np.log(volume))


@inlined
def whiten(L, count, g, i, W):
    """Row `count` of W = L⁻¹ [c_i P]; L holds the inverses of its diagonal."""
    inverse = L[count, count]
    for b in range(W.shape[1]):
        W[count, b] = inverse * g[i, b]
    for j in range(count):
        shared = inverse * L[count, j]
        for b in range(W.shape[1]):
            W[count, b] -= shared * W[j, b]


@inlined
def subtract_squares(W, count, P):
    """P -= Wᵀ W over the first rows of W, four of them at a time."""
    n, width = P.shape
    whole = count // 4 * 4
    for j in range(0, whole, 4):
        for a in range(n):
            w0, w1, w2, w3 = W[j, a], W[j + 1, a], W[j + 2, a], W[j + 3, a]
            for b in range(width):
                P[a, b] -= (w0 * W[j, b] + w1 * W[j + 1, b]) + (w2 * W[j + 2, b] + w3 * W[j + 3, b])
    for j in range(whole, count):
        for a in range(n):
            w0 = W[j, a]
            for b in range(width):
                P[a, b] -= w0 * W[j, b]


@inlined
def joseph_covariance(C, i, g, K, r, P, half, rest):
    """P⁺ = A - K (cᵀ A) + r K Kᵀ with A = P - g Kᵀ, for sensor i; `half` and `rest` are scratch.

    Both outer products are written as the mean of themselves and their transposes, term by term, so that P
    stays symmetric to the last bit. Where they are not, what rounding leaves antisymmetric grows without
    bound once P has fourteen digits to lose: copying one triangle over the other is not enough (seen in the
    tests, and in filterpy).
    """
    (n, width), seen = P.shape, C.shape[1]
    for b in range(width):
        half[b] = 0.5 * g[i, b]
        rest[b] = r * K[b]
    for a in range(n):
        gain, expected = K[a], half[a]
        for b in range(width):
            P[a, b] -= expected * K[b] + gain * half[b]
    for a in range(seen):
        c = C[i, a]
        for b in range(width):
            rest[b] -= c * P[a, b]
    for b in range(width):
        rest[b] *= 0.5
    for a in range(n):
        gain, left = K[a], rest[a]
        for b in range(width):
            P[a, b] += gain * rest[b] + left * K[b]


@rarely
def joseph_update(R_K2, C, accepted, g, nu, x, P, work):
    """Correct x and P by every accepted sensor in turn; return the log-likelihood of their innovations.

    `nu` are the innovations before any correction; those of the sensors still to come follow on the way.
    Their g is worked out anew from the P in force: Joseph's form forgives a wrong gain, but not a wrong c P
    (Bucy and Joseph, 1968). P is symmetric to rounding; the lower triangle is the one that counts.
    """
    (n, width), s = P.shape, len(accepted)
    K, half, rest = work.K, work.half, work.row
    squares, volume = 0.0, 1.0
    for i in range(s):
        if not accepted[i]:
            continue
        sensor_covariance(C, i, P, g)
        innovation, r = nu[i], R_K2[i]
        S = project(C, i, g, i) + r
        squares += innovation * innovation / S
        volume *= 2.0 * np.pi * S
        for b in range(width):
            K[b] = g[i, b] / S
        for a in range(n):
            x[a] += K[a] * innovation
        joseph_covariance(C, i, g, K, r, P, half, rest)
        for later in range(i + 1, s):
            nu[later] -= project(C, later, g, i) / S * innovation
    return -0.5 * (squares + np.log(volume))


@inlined
def compare(p, C, u, k, usable, g, x, nu, S):
    """Innovation ν_i and its variance S_ii before any correction, for every usable sensor."""
    for i in range(len(usable)):
        if usable[i]:
            nu[i] = residual(p, C, u, k, i, x)
            S[i] = project(C, i, g, i) + p.R_K2[i]
