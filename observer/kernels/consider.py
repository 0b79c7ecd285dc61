"""What an observer with a fixed gain considers: what each tolerance makes of its estimate's error.

With e the error of the estimate, θ a parameter, c what it does to the plant and h to a reading,

    e⁺ = A e + c θ,        ν = C e + h θ,        e⁺ = e - K ν:

linear in θ, so that the columns S = ∂e/∂θ σ_θ are carried beside a covariance that knows noise alone, and
σ² = σ_noise² + Σ S² (Schmidt 1966: considered parameters, here of a gain that is given). The effects are
taken along a field that follows the estimate slowly, as where they are learnt (`learning`).
"""

from __future__ import annotations

from observer.kernels.advance import advance_columns, couple_columns, move_columns
from observer.kernels.covariance import squared
from observer.kernels.judging import clear
from observer.kernels.learning import draw_near, follow, linearise_at
from observer.kernels.libc import sqrt


def begin_considered(a, u, k, x):
    """At the start: the effects are taken at the state, and nothing is off by a parameter yet."""
    if a.S.shape[1] == 0:
        return
    move_columns(a.plant, u, k, a.work.B, a.work.C)
    clear(a.S)
    linearise_at(a.plant, u, k, a.work.C, x, a.around)


def propagate_considered(a, b, k):
    """Take `around` and S over step k, once."""
    if a.S.shape[1] == 0 or a.taken[0] == 1:
        return
    a.taken[0] = 1
    move_columns(a.plant, b.inputs, k, a.work.B, a.work.C)
    follow(a.plant, b, k, a.around, a.nothing, a.work)
    if a.plant.coupling.active:
        couple_columns(a.plant, b.inputs, k, b.inputs.z_start[k], a.work.before[0], a.S, a.work)
    advance_columns(a.plant, b.table, b.step[k], a.work.B, a.S)
    for i in range(a.plant.learn.machine):
        for n in range(len(a.plant.uniform)):
            a.S[n, i] += a.work.G[len(a.plant.source) + i, n] * a.plant.learn.sigma[i]
    if a.plant.coupling.active:
        couple_columns(a.plant, b.inputs, k, b.inputs.z_end[k], a.work.before[1], a.S, a.work)


def consider_readings(a, S_nu):
    """Put what parameters do to innovations into `nu`, and the variances with that into `variance`."""
    S, C = a.S, a.work.C
    n_x, first = len(a.plant.uniform), len(a.plant.uniform) + len(a.plant.source)
    parameters = min(S.shape[1], len(a.plant.learn.sigma))
    for i in range(len(S_nu)):
        a.variance[i] = S_nu[i]
        for r in range(parameters):
            off = C[i, first + r] * a.plant.learn.sigma[r]
            for b in range(n_x):
                off += C[i, b] * S[b, r]
            a.nu[i, r] = off
            a.variance[i] += off * off


def correct_considered(a, K, accepted):
    """S⁺ = S - K ν of the accepted sensors."""
    for i in range(len(accepted)):
        if accepted[i]:
            for b in range(a.S.shape[0]):
                for r in range(a.S.shape[1]):
                    a.S[b, r] -= K[b, i] * a.nu[i, r]


def correct_considered_jointly(a, work):
    """The same by the Kalman gain of the moment, from the factors that a joint update has left."""
    L, W, count = work.L, work.W, 0
    for i in range(len(work.accepted)):
        count += 1 if work.accepted[i] else 0
    for r in range(a.S.shape[1]):
        for i in range(count):
            rest = a.nu[work.order[i], r]
            for j in range(i):
                rest -= L[i, j] * a.e[j]
            a.e[i] = rest * L[i, i]
        for i in range(count):
            for b in range(a.S.shape[0]):
                a.S[b, r] -= W[i, b] * a.e[i]


def finish_considered(a, dt_s, x):
    """After a step: `around` goes after the estimate, and the next step is another."""
    draw_near(a.plant, dt_s, x, a.around)
    a.taken[0] = 0


def add_considered(a, rows, k, out):
    """Add to the σ of step k, of heats and of the `rows` (n_x, W), what the parameters have in them."""
    S, square, value = a.S, a.work.shared, a.work.value
    n_x, L = len(rows), a.S.shape[1]
    if L == 0:
        return
    for j in range(out.heat_sigma.shape[1]):
        variance = squared(out.heat_sigma[k, j])
        for r in range(L):
            variance += squared(S[n_x + j, r])
        out.heat_sigma[k, j] = sqrt(variance)
    for w in range(len(square)):
        square[w] = 0.0
    for r in range(L):
        for w in range(len(value)):
            value[w] = 0.0
        for b in range(n_x):
            off = S[b, r]
            for w in range(len(value)):
                value[w] += off * rows[b, w]
        for w in range(len(value)):
            square[w] += value[w] * value[w]
    for w in range(out.field_sigma.shape[1]):
        out.field_sigma[k, w] = sqrt(squared(out.field_sigma[k, w]) + square[w])
