"""Effects of learnt and considered parameters on field and readings.

Sensitivities taken at the estimate would make the gains depend on its noise. Parameters that multiply a state
(a position, a lag, a loss at an end) would then drift by several σ. The sensitivities are therefore taken at
a linearisation point. Laws and learnt parameters drive this state, and it follows the estimate so slowly that
it is free of its noise.
"""

from __future__ import annotations

from observer.kernels.advance import advance_diagonal, put_laws, step_half
from observer.kernels.codes import AMBIENT, LAW, OFFSET, STILL
from observer.kernels.coupling import see_under, swept_share
from observer.kernels.covariance import add_scaled, squared
from observer.kernels.judging import add_prior, clear
from observer.kernels.libc import exp, expm1, sqrt

FOLLOWS_S = 1200.0
"""Time constant with which the linearisation point follows the estimate."""
_SURE = 3.0


def follow(p, b, k, linearisation_point, x, work):
    """Take the linearisation point over step k, and write the effects of the parameters.

    Those of the machine over the step go into the rows of `work.G` after those of the heats. Those of the
    sensors on readings go into C.
    """
    if len(p.learn.kind) == 0:
        return
    B, n_x, m_e = work.B, work.B.shape[1], len(p.source)
    machine = p.learn.machine
    for a in range(n_x + m_e):
        work.before_around[a] = linearisation_point[a]
    advance_learning(p, b, k, linearisation_point, 0, work)
    if len(p.learn.V) > 0:
        bring(p, B, work.before_around, work)
    for i in range(machine):
        row = m_e + i
        if p.learn.link[i] >= 0:
            pass_heat(p, b.inputs, k, B, i, work.before_around, work)
        elif len(p.learn.V) > 0:
            drive(p, b.inputs, k, work.plain_B, i, work.plain, work)
            multiply(p.inverse_T, work.shift, work.G[row])
        else:
            drive(p, b.inputs, k, B, i, work.before_around, work)
            for a in range(n_x):
                work.G[row, a] = work.shift[a]
        learnt = x[n_x + row]
        for a in range(n_x):
            work.G[row, a] *= b.table.hold[b.step[k], a]
            linearisation_point[a] += work.G[row, a] * learnt
    see(p, b.inputs, k, b.inputs.dt_s[k], work.C, linearisation_point)


def bring(p, B, before, work):
    """Write columns and a state of [ξ | δ] in the states x = V ξ of the parameters' matrices."""
    n_x = B.shape[1]
    for j in range(B.shape[0]):
        multiply(p.VT, B[j], work.plain_B[j])
    multiply(p.VT, before, work.plain)
    for j in range(len(p.source)):
        work.plain[n_x + j] = before[n_x + j]


def multiply(VT, x, y):
    """y = V x for the transposed matrix VT (n_x, n_x)."""
    n_x = VT.shape[0]
    for a in range(n_x):
        y[a] = 0.0
    add_scaled(y[:n_x], VT, x, n_x)


def drive(p, u, k, B, i, x, work):
    """Write into `shift` the effect of a unit of parameter i on dx/dt at the state x at the start of step k.

    It is A x + B q + E z + f (see `observer.model.learning.Change`), (n_x,).
    """
    n_x, source, c = B.shape[1], p.learn.law[i], work.shift
    if source >= 0:
        for a in range(n_x):
            c[a] = B[source, a] * work.law[source]
        return
    source = p.learn.divided[i]
    if source >= 0:
        heat_W = work.law[source]
        for j in range(len(p.source)):
            if p.source[j] == source:
                heat_W += x[n_x + j]
        for a in range(n_x):
            c[a] = heat_W * (p.learn.into[p.learn.first[i], a] - B[source, a])
        return
    for a in range(n_x):
        c[a] = p.learn.steady[i, a] + p.learn.rate_1_s[i, a] * x[a]
    for r in range(p.learn.first[i], p.learn.first[i + 1]):
        tied = 0.0
        for a in range(n_x):
            tied += p.learn.feedback_row[r, a] * x[a]
        for a in range(n_x):
            c[a] += p.learn.into[r, a] * tied
    for q in range(p.learn.inputs.shape[1]):
        for a in range(n_x):
            c[a] += p.learn.inputs[i, q, a] * u.z_start[k, q]
    if p.learn.heated[i] != 0:
        for j in range(B.shape[0]):
            for a in range(n_x):
                c[a] += p.learn.heats[i, a] * B[j, a] * work.law[j]
        for j in range(len(p.source)):
            for a in range(n_x):
                c[a] += p.learn.heats[i, a] * B[p.source[j], a] * x[n_x + j]


def pass_heat(p, u, k, B, q, x, work):
    """Write into the row of parameter q how dx/dt changes if its link to a moving nut conducts twice as much.

    That is G v d x. The nut is at its position of the step, d is the row of the temperature difference, and v
    the column of 1 J passed. Shapes under a sweeping nut decay faster by the link's part of all its
    conductances.
    """
    i, c = p.learn.link[q], work.G[len(p.source) + q]
    source, apart_K, all_W_K = p.coupling.links.source[i], 0.0, 0.0
    see_under(p.coupling, source, B, work.link)
    for a in range(B.shape[1]):
        apart_K += (p.coupling.links.C[i, a] - work.link[0, a]) * x[a]
    for z in range(p.coupling.under_F.shape[1]):
        apart_K -= p.coupling.under_F[source, z] * u.z_start[k, z]
    heat_W = p.coupling.links.conductance_W_K[i] * apart_K
    for a in range(B.shape[1]):
        c[a] = heat_W * (p.coupling.place_gain[source] * B[source, a] - p.coupling.links.B[i, a])
    if p.coupling.spreads.first[source] == p.coupling.spreads.first[source + 1]:
        return
    for number in range(len(p.coupling.links.source)):
        if p.coupling.links.source[number] == source:
            all_W_K += p.coupling.links.conductance_W_K[number]
    part = p.coupling.links.conductance_W_K[i] / all_W_K * swept_share(p.coupling, source, B)
    for e in range(p.coupling.spreads.first[source], p.coupling.spreads.first[source + 1]):
        seen = 0.0
        for a in range(p.coupling.spreads.row.shape[1]):
            seen += p.coupling.spreads.row[e, a] * x[a]
        for a in range(p.coupling.spreads.into.shape[1]):
            c[a] -= part * p.coupling.spreads.rate_1_s[e] * seen * p.coupling.spreads.into[e, a]


def see(p, u, k, dt_s, C, linearisation_point):
    """Write the effect of a unit of each sensor's parameters on its reading into its row of C.

    The linearisation point also contains each sensor's reading without lag and with a lag of one tolerance.
    The effect of a lag is their difference. It is exact for these two lags, and nearly so in between.
    """
    first, s = len(p.uniform) + len(p.source), len(p.R_K2)
    for q in range(p.learn.machine, len(p.learn.kind)):
        i, lag_s = p.learn.of[q], p.learn.lag_s[q]
        entry = p.learn.shift_K[q]
        if lag_s > 0.0:
            slow = first + s + i
            now_degC = below(p, u, k, C, i, linearisation_point)
            if dt_s > 0.0:
                fade = exp(-dt_s / lag_s)
                mean = lag_s / dt_s * (1.0 - fade)
                linearisation_point[slow] = (
                    fade * linearisation_point[slow]
                    + (mean - fade) * linearisation_point[first + i]
                    + (1.0 - mean) * now_degC
                )
            linearisation_point[first + i] = now_degC
            entry += (linearisation_point[slow] - now_degC) / lag_s
        for a in range(len(p.uniform)):
            entry += p.learn.row[q, a] * linearisation_point[a]
        for z in range(p.F.shape[1]):
            entry += p.learn.row_known[q, z] * u.z_end[k, z]
        C[i, first + q] = entry


def below(p, u, k, C, i, linearisation_point):
    """Return the reading of an exact sensor i at the end of step k, °C."""
    degC = 0.0
    for a in range(len(p.uniform)):
        degC += C[i, a] * linearisation_point[a]
    for q in range(p.F.shape[1]):
        degC += p.F[i, q] * u.z_end[k, q]
    return degC


def advance_learning(p, b, k, x, learnt, work):
    """Take a state over step k as `advance` does, with the effects and the fading of `learnt` parameters."""
    n_x, first = work.B.shape[1], work.B.shape[1] + len(p.source)
    if p.coupling.active:
        step_half(p, b.inputs, k, b.inputs.z_start[k], x, 0, work)
    put_laws(p, b.inputs, k, work.B, x, work.law)
    advance_diagonal(p, b.table, b.step[k], b.inputs, k, x, work)
    if learnt > 0:
        add_columns_of(work.G, len(p.source), p.learn.machine, n_x, x)
    for q in range(learnt):
        x[first + q] *= b.table.decay[b.step[k], first + q]
    if p.coupling.active:
        step_half(p, b.inputs, k, b.inputs.z_end[k], x, 1, work)


def add_columns_of(G, first, count, n_x, x):
    """x += Σ_i G_i θ_i over rows of G from `first` on and the states θ behind the heats, in sums of four."""
    fours = count // 4 * 4
    for i in range(first, first + fours, 4):
        w0, w1, w2, w3 = x[n_x + i], x[n_x + i + 1], x[n_x + i + 2], x[n_x + i + 3]
        for a in range(n_x):
            x[a] += (w0 * G[i, a] + w1 * G[i + 1, a]) + (w2 * G[i + 2, a] + w3 * G[i + 3, a])
    for i in range(first + fours, first + count):
        w0 = x[n_x + i]
        for a in range(n_x):
            x[a] += w0 * G[i, a]


def keep(p, x, P, saved):
    """Save considered parameters with the lower triangle of their covariance, (h, h + 1)."""
    first = len(p.uniform) + len(p.source)
    for i in range(len(p.learn.considered)):
        saved[i, 0] = x[first + p.learn.considered[i]]
        for j in range(i + 1):
            saved[i, j + 1] = P[first + p.learn.considered[i], first + p.learn.considered[j]]


def give_back(p, x, P, saved):
    """Restore the values that `keep` saved after a correction.

    The covariance of considered parameters with other states stays corrected (Schmidt 1966).
    """
    first = len(p.uniform) + len(p.source)
    for i in range(len(p.learn.considered)):
        x[first + p.learn.considered[i]] = saved[i, 0]
        for j in range(i + 1):
            P[first + p.learn.considered[i], first + p.learn.considered[j]] = saved[i, j + 1]


def draw_near(p, dt_s, x, linearisation_point):
    """Move the linearisation point towards the estimate."""
    if len(p.learn.kind) == 0:
        return
    share = -expm1(-dt_s / FOLLOWS_S)
    for a in range(len(p.uniform) + len(p.source)):
        linearisation_point[a] += share * (x[a] - linearisation_point[a])


def begin(p, u, k, state, work):
    """Set the linearisation point to the state after the start; a machine at rest starts from the air.

    A machine at rest overnight has the air's temperature. Its readings then show the offsets of its sensors
    and of the air's thermometer.
    """
    if len(p.learn.kind) == 0:
        return
    if is_at_rest(p, u, k, work.usable, work.C):
        rest(p, u, k, state.x, state.P)
    linearise_at(p, u, k, work.C, state.x, state.around)


def linearise_at(p, u, k, C, x, linearisation_point):
    """Set the linearisation point to the state x, without lags of sensors."""
    first, s = len(p.uniform) + len(p.source), len(p.R_K2)
    for a in range(first):
        linearisation_point[a] = x[a]
    for i in range(s):
        linearisation_point[first + i] = below(p, u, k, C, i, linearisation_point)
        linearisation_point[first + s + i] = linearisation_point[first + i]
    see(p, u, k, 0.0, C, linearisation_point)


def is_at_rest(p, u, k, usable, C):
    """Return whether no law makes heat and every thermocouple agrees with the air's temperature.

    At least one of them must respond to the screw more than to the air.
    """
    ambient_K, count = 0.0, 0
    for q in range(p.learn.machine):
        if p.learn.kind[q] == AMBIENT:
            ambient_K = p.learn.sigma[q]
    quiet = ambient_K > 0.0 and p.learn.rests == 1
    for j in range(u.law_W.shape[1]):
        quiet = quiet and u.law_W[k, j] == 0.0
    for q in range(p.learn.machine, len(p.learn.kind)):
        i = p.learn.of[q]
        if p.learn.kind[q] == OFFSET and usable[i] and p.thermal[i]:
            part = 0.0
            for a in range(len(p.uniform)):
                part += C[i, a] * p.uniform[a]
            if part > 0.5:
                count += 1
            variance = squared(p.learn.sigma[q]) + squared(ambient_K) + p.R_K2[i]
            apart_K = u.y_degC[k, i] - u.z_end[k, p.learn.ambient]
            quiet = quiet and apart_K * apart_K <= _SURE * _SURE * variance
    return quiet and count > 0


def rest(p, u, k, x, P):
    """Write state and covariance of a machine at the temperature of the air."""
    n_x, m_e, first = len(p.uniform), len(p.source), len(p.uniform) + len(p.source)
    for a in range(len(x)):
        x[a] = 0.0
    for a in range(n_x):
        x[a] = p.uniform[a] * u.z_end[k, p.learn.ambient]
    clear(P)
    add_prior(p, P, 1.0)
    for a in range(n_x):
        for b in range(n_x):
            P[a, b] = p.learn.rest_P[a, b]
    for j in range(m_e):
        P[n_x + j, n_x + j] *= STILL * STILL
    for q in range(p.learn.machine):
        if p.learn.kind[q] == AMBIENT:
            variance = squared(p.learn.sigma[q])
            for a in range(n_x):
                P[a, first + q] = variance * p.uniform[a]
                P[first + q, a] = variance * p.uniform[a]
                for b in range(n_x):
                    P[a, b] += variance * (p.uniform[a] * p.uniform[b])


def report_learned(p, x, P, k, work, out):
    """Add the learnt changes of laws to the heats, and write the learnt parameters."""
    n_x, m_e = len(p.uniform), len(p.source)
    for q in range(len(p.learn.kind)):
        index = n_x + m_e + q
        out.learned[k, q], out.learned_sigma[k, q] = x[index], sqrt(P[index, index])
        if p.learn.kind[q] == LAW:
            j = p.learn.of[q]
            law_W = work.law[p.source[j]]
            out.heat[k, j] += law_W * x[index]
            shared = 2.0 * P[index, n_x + j] + law_W * P[index, index]
            out.heat_sigma[k, j] = sqrt(max(0.0, squared(out.heat_sigma[k, j]) + law_W * shared))
