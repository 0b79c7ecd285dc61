"""The arithmetic of one step: predict state and covariance, correct them by the sensors.

The plant is diagonal and the heats reach it only through their input columns, so predicting a covariance
costs O(n²). Nothing here calls BLAS and no sum is reordered: K steps give the same bits as K runs of one.
Arrays are changed in place; shapes are those of `packing`.
"""

from __future__ import annotations

from observer.kernels.advance import couple_covariance
from observer.kernels.covariance import (
    add_row,
    add_scaled,
    fade_and_force,
    force_columns,
    innovation_covariances,
    mirror,
    multiply_rows,
    subtract_seen,
    subtract_squares,
    whiten,
)
from observer.kernels.judging import add_prior, clear
from observer.kernels.learning import advance_learning
from observer.kernels.libc import M_PI, log, sqrt

_DRASTIC = 1e8  # variance of an innovation, in variances of the sensor's noise


def predict(b, k, state, work):
    """Take one step of state and covariance; the couplings act in two halves around it."""
    advance_learning(b.plant, b, k, state.x, len(b.plant.learn.kind), work)
    if b.plant.coupling.active:
        mirror(state.P)
        couple_covariance(b.plant, b.inputs, k, b.inputs.z_start[k], 0, state.P, work)
    predict_covariance(b.plant, b.table, b.step[k], b.inputs, k, state, work)
    if b.plant.coupling.active:
        couple_covariance(b.plant, b.inputs, k, b.inputs.z_end[k], 1, state.P, work)
        mirror(state.P)


def predict_covariance(p, t, d, u, k, state, work):
    """P⁺ = Ad (P + jump) Adᵀ + Qd, with the law's jump acting from the start of the step.

    Ad = diag d + Σ_j G_j 1_jᵀ with G_j the column of heat j, so that with H_j = d∘P_j + ½ Σ_i P_ji G_i

        P⁺ = (d dᵀ)∘P + Σ_j (H_j G_jᵀ + G_j H_jᵀ) + Q.

    In this form P stays symmetric to the last bit. Rows are computed over their padded width, where d, G and
    H are zero. Parameters of the machine act through further columns in G.
    """
    n_x, m_e = len(p.uniform), len(p.source)
    columns = m_e + p.learn.machine
    for j in range(m_e):
        index = p.source[j]
        jump = p.jump_uncertainty[j] * u.law_jump_W[k, index]
        state.P[n_x + j, n_x + j] += jump * jump
        for a in range(n_x):
            work.G[j, a] = work.B[index, a] * t.couple[d, j, a]
    force_columns(state.P, work.G, columns, n_x, t, d, work)
    fade_and_force(state.P, work.H, work.G, columns, n_x, t, d)
    mirror(state.P)
    for i in range(len(p.moving)):
        if p.moving_heat[i] >= 0:
            add_walk(work.B, p.moving[i], t, d, p.moving_heat[i], state.P)


def add_walk(B, index, t, d, j, P):
    """Add the noise of the walk of heat j through its moving column."""
    n_x = B.shape[1]
    for a in range(n_x):
        weight, shared = B[index, a], B[index, a] * t.walk_dx[d, j, a]
        for b in range(n_x):
            P[a, b] += weight * B[index, b] * t.walk_xx[d, j, a, b]
        P[n_x + j, a] += shared
        P[a, n_x + j] += shared


def symmetrise(P):
    """P = (P + Pᵀ)/2."""
    for a in range(P.shape[0]):
        for b in range(a):
            mean = 0.5 * (P[a, b] + P[b, a])
            P[a, b] = mean
            P[b, a] = mean


def residual(p, C, u, k, i, x):
    """Measured minus expected temperature of sensor i at the end of step k, K."""
    nu = u.y_degC[k, i]
    for a in range(C.shape[1]):
        nu -= C[i, a] * x[a]
    for q in range(p.F.shape[1]):
        nu -= p.F[i, q] * u.z_end[k, q]
    return nu


def sensor_covariance(C, i, P, g):
    """g_i = P c_i."""
    n = C.shape[1]
    whole = n // 4 * 4
    for b in range(P.shape[1]):
        g[i, b] = 0.0
    for a in range(0, whole, 4):
        c0, c1, c2, c3 = C[i, a], C[i, a + 1], C[i, a + 2], C[i, a + 3]
        if c0 != 0.0 and c1 != 0.0 and c2 != 0.0 and c3 != 0.0:
            for b in range(P.shape[1]):
                g[i, b] = (((g[i, b] + c0 * P[a, b]) + c1 * P[a + 1, b]) + c2 * P[a + 2, b]) + c3 * P[
                    a + 3, b
                ]
        else:
            add_rows(C, i, a, a + 4, P, g)
    add_rows(C, i, whole, n, P, g)


def add_rows(C, i, first, end, P, g):
    """g_i += P c_i for the states from `first` to `end`; entries of other sensors' parameters are zero."""
    for a in range(first, end):
        c = C[i, a]
        if c != 0.0:
            for b in range(P.shape[1]):
                g[i, b] += c * P[a, b]


def project(C, i, g, j):
    """c_iᵀ g_j over the states that sensors see."""
    total = 0.0
    for a in range(C.shape[1]):
        total += C[i, a] * g[j, a]
    return total


def start(p, u, k, state, work):
    """Set x̂ to a screw of one temperature with the lags at rest under their laws, and P to the prior.

    That temperature is the median over the usable sensors, so that one broken sensor does not set it.
    """
    C, x, levels, n_x = work.C, state.x, work.nu, len(p.uniform)
    for a in range(len(x)):
        x[a] = 0.0
    for j in range(u.law_W.shape[1]):
        for a in range(n_x):
            x[a] += u.law_W[k, j] * p.lags[j, a]
    count = 0
    for i in range(len(work.usable)):
        if work.usable[i]:
            response = 0.0
            for a in range(n_x):
                response += C[i, a] * p.uniform[a]
            # Next to a prescribed end the modes alone see little of a uniform temperature.
            level = residual(p, C, u, k, i, x) / response if response > 0.5 else u.y_degC[k, i]
            place = count
            while place > 0 and levels[place - 1] > level:
                levels[place] = levels[place - 1]
                place -= 1
            levels[place] = level
            count += 1
    level = 0.5 * (levels[(count - 1) // 2] + levels[count // 2])
    for a in range(n_x):
        x[a] += p.uniform[a] * level
    clear(state.P)
    add_prior(p, state.P, 1.0)


def is_drastic(p, work):
    """Return whether an accepted sensor reduces P so much that P - Wᵀ W would lose all digits."""
    for i in range(len(work.accepted)):
        if work.accepted[i] and work.S_nu[i] > _DRASTIC * p.R_K2[i]:
            return True
    return False


def correct_lower(p, state, work):
    """Correct x and the lower triangle of P by all accepted sensors at once; return the log-likelihood.

    S = L Lᵀ is the covariance of the innovations ν, and W = L⁻¹ [c_i P]. Then x⁺ = x + Wᵀ L⁻¹ ν and
    P⁺ = P - Wᵀ W, which is symmetric to the last bit. If this difference would lose all digits, the sensors
    correct one after the other in Joseph's form. `compare` must run before.
    """
    if is_drastic(p, work):
        return correct_in_turn(p, state, work)
    squares, volume, count = 0.0, 1.0, 0
    for i in range(len(work.accepted)):
        if not work.accepted[i]:
            continue
        work.order[count] = i
        variance, rest = work.S_nu[i], work.nu[i]
        for j in range(count):
            shared = work.S[work.order[j], i]
            for q in range(j):
                shared -= work.L[count, q] * work.L[j, q]
            shared *= work.L[j, j]
            work.L[count, j] = shared
            variance -= shared * shared
            rest -= shared * work.e[j]
        inverse = 1.0 / sqrt(variance)
        work.L[count, count] = inverse
        work.e[count] = rest * inverse
        squares += work.e[count] * work.e[count]
        volume *= 2.0 * M_PI * variance
        whiten(work.L, work.g, count, i, work.W)
        count += 1
    add_scaled(state.x, work.W, work.e, count)
    subtract_squares(work.W, count, state.P)
    return -0.5 * (squares + log(volume))


def joseph_covariance(i, r, P, work):
    """P⁺ = A - K (cᵀ A) + r K Kᵀ with A = P - g Kᵀ, for sensor i of noise variance r.

    Both outer products are written as the mean of themselves and their transposes, term by term. P then stays
    symmetric to the last bit. Without this, the antisymmetric rounding error grows without bound when P loses
    fourteen digits. Copying one triangle over the other is not enough (seen in the tests, and in filterpy).
    """
    C, K, half, rest = work.C, work.K, work.half, work.row
    n, width, columns = P.shape[0], P.shape[1], C.shape[1]
    for b in range(width):
        half[b] = 0.5 * work.g[i, b]
        rest[b] = r * K[b]
    for a in range(n):
        gain, expected = K[a], half[a]
        for b in range(width):
            P[a, b] -= expected * K[b] + gain * half[b]
    for a in range(columns):
        c = C[i, a]
        for b in range(width):
            rest[b] -= c * P[a, b]
    for b in range(width):
        rest[b] *= 0.5
    for a in range(n):
        gain, left = K[a], rest[a]
        for b in range(width):
            P[a, b] += gain * rest[b] + left * K[b]


def correct_in_turn(p, state, work):
    """Correct x and P by every accepted sensor in turn; return the log-likelihood of their innovations.

    On entry `work.nu` are the innovations before any correction; those of later sensors are updated. Each g
    is recomputed from the current P, because Joseph's form is exact for a wrong gain but not for a wrong c P
    (Bucy and Joseph, 1968). P is symmetric to rounding; the lower triangle is valid.
    """
    n, width, s = state.P.shape[0], state.P.shape[1], len(work.accepted)
    squares, volume = 0.0, 1.0
    for i in range(s):
        if not work.accepted[i]:
            continue
        sensor_covariance(work.C, i, state.P, work.g)
        innovation, r = work.nu[i], p.R_K2[i]
        S = project(work.C, i, work.g, i) + r
        squares += innovation * innovation / S
        volume *= 2.0 * M_PI * S
        for b in range(width):
            work.K[b] = work.g[i, b] / S
        for a in range(n):
            state.x[a] += work.K[a] * innovation
        joseph_covariance(i, r, state.P, work)
        for j in range(i + 1, s):
            work.nu[j] -= project(work.C, j, work.g, i) / S * innovation
    return -0.5 * (squares + log(volume))


def correct_by_gain(p, K, state, work):
    """Correct by a designed gain K (n, s): x⁺ = x + K ν, with the covariance in Joseph's form.

    P⁺ = (I - K C) P (I - K C)ᵀ + K R Kᵀ. Only accepted sensors correct. `compare` must run before.
    """
    P, A, n, columns = state.P, work.A, state.P.shape[0], work.C.shape[1]
    for a in range(n):
        for b in range(n):
            A[a, b] = P[a, b]
    for i in range(len(work.accepted)):
        if work.accepted[i]:
            for a in range(n):
                state.x[a] += K[a, i] * work.nu[i]
                add_row(A[a], -K[a, i], work.g[i])
    for a in range(n):
        for b in range(n):
            P[a, b] = A[a, b]
    for i in range(len(work.accepted)):
        if work.accepted[i]:
            for b in range(n):
                work.K[b] = K[b, i]
            for a in range(n):
                rest = p.R_K2[i] * K[a, i]
                for b in range(columns):
                    rest -= A[a, b] * work.C[i, b]
                add_row(P[a], rest, work.K)
    symmetrise(P)


def compare(p, u, k, state, work):
    """Write innovation ν_i and its variance S_ii before any correction, for every usable sensor; g_i = P c_i.

    All sensors are computed at once on the plant's states, and each by itself on its parameters.
    """
    n_x, first, s = len(p.uniform), len(p.uniform) + len(p.source), len(work.usable)
    for i in range(len(p.moving)):
        a = p.modes + p.moving[i]
        for r in range(s):
            work.CT[a, r] = work.C[r, a]
    for i in range(s):
        work.read[i] = u.y_degC[k, i]
        if p.thermal[i]:
            work.read[i] -= state.verdict[0].common_K
    subtract_seen(work.read, work.CT, state.x)
    multiply_rows(work.C, state.P, n_x, state.P.shape[0], False, work.g)
    for q in range(p.learn.machine, len(p.learn.kind)):
        add_rows(work.C, p.learn.of[q], first + q, first + q + 1, state.P, work.g)
    innovation_covariances(work.g, work.CT, work.S)
    for q in range(p.learn.machine, len(p.learn.kind)):
        i = p.learn.of[q]
        c = work.C[i, first + q]
        work.read[i] -= c * state.x[first + q]
        for j in range(i + 1):
            work.S[j, i] += c * work.g[j, first + q]
    for i in range(s):
        if work.usable[i]:
            nu = work.read[i]
            for q in range(p.F.shape[1]):
                nu -= p.F[i, q] * u.z_end[k, q]
            work.nu[i] = nu
            work.S_nu[i] = work.S[i, i] + p.R_K2[i]
