"""What an observer with a fixed gain allows for, compiled: what each tolerance makes of its estimate's error.

With e the error of the estimate, θ a parameter, c what it does to the plant and h to a reading,

    e⁺ = A e + c θ,        ν = C e + h θ,        e⁺ = e - K ν:

linear in θ, so that the columns S = ∂e/∂θ σ_θ are carried beside a covariance that knows noise alone, and
σ² = σ_noise² + Σ S² (Schmidt 1966: considered parameters, here of a gain that is given). The effects are
taken along a field that follows the estimate slowly, as where they are learnt (`learning`).
"""

# numba compiles these functions: their types are those of the arrays they get.
# mypy: disable-error-code="no-untyped-def, misc"

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from observer.compiled import inlined, rarely
from observer.estimators.compiled.learning import below, draw_near, follow, see
from observer.estimators.compiled.packing import IntArray, PlantArrays, Work
from observer.frames import FloatArray
from observer.model.advance import move_columns
from observer.model.coupling import couple


class Allowed(NamedTuple):
    """What is allowed for: nothing where the plant has no states that are learnt.

    Of the state `around` (n_x + m_e + 2 s,) and `S` (n, L). Scratch: `work`, `nothing` (n + L,) is zero,
    `nu` (s, L) what the parameters do to the innovations, `variance` (s,) the innovations' with it, `e` (s,),
    and `taken` (1,), whether S is over the step at hand already.
    """

    plant: PlantArrays
    work: Work
    around: FloatArray
    S: FloatArray
    nothing: FloatArray
    nu: FloatArray
    variance: FloatArray
    e: FloatArray
    taken: IntArray


@rarely
def begin_allowing(a, u, k, x):
    """At the start: the effects are taken at the state, and nothing is off by a parameter yet."""
    q, C = a.plant, a.work.C
    if a.S.shape[1] == 0:
        return
    move_columns(q, u, k, a.work.B, C)
    first, s = len(q.uniform) + len(q.source), len(q.R_K2)
    a.S[:] = 0.0
    for b in range(first):
        a.around[b] = x[b]
    for i in range(s):
        a.around[first + i] = below(q, u, k, C, i, a.around)
        a.around[first + s + i] = a.around[first + i]
    see(q, u, k, 0.0, C, a.around)


@rarely
def allow(a, t, d, u, k):
    """Take `around` and S over step k, once."""
    q, S, work = a.plant, a.S, a.work
    if S.shape[1] == 0 or a.taken[0] == 1:
        return
    a.taken[0] = 1
    n_x, m_e, sigma = len(q.uniform), len(q.source), q.learn.sigma
    move_columns(q, u, k, work.B, work.C)
    follow(q, t, d, u, k, work.B, work.C, a.around, a.nothing, work)
    half_s, before = 0.5 * u.dt_s[k], work.before
    rate_1_s, drawn_degC = u.loss_1_s[k], u.loss_degC[k]
    if q.coupling.active:
        couple(q.coupling, rate_1_s, drawn_degC, u.z_start[k], work.B, half_s, before[0], S[:n_x], work.shift)
    for b in range(n_x):
        for r in range(S.shape[1]):
            S[b, r] *= t.decay[d, b]
    for j in range(m_e):
        index = q.source[j]
        for b in range(n_x):
            for r in range(S.shape[1]):
                S[b, r] += work.B[index, b] * t.couple[d, j, b] * S[n_x + j, r]
        for r in range(S.shape[1]):
            S[n_x + j, r] *= t.heat_decay[d, j]
    for i in range(q.learn.machine):
        for b in range(n_x):
            S[b, i] += work.G[m_e + i, b] * sigma[i]
    if q.coupling.active:
        couple(q.coupling, rate_1_s, drawn_degC, u.z_end[k], work.B, half_s, before[1], S[:n_x], work.shift)


@rarely
def allow_for_readings(a, S_nu):
    """Put what parameters do to innovations into `nu`, and the variances with that into `variance`."""
    q, S, C = a.plant, a.S, a.work.C
    n_x, first = len(q.uniform), len(q.uniform) + len(q.source)
    for i in range(len(S_nu)):
        a.variance[i] = S_nu[i]
        for r in range(S.shape[1]):
            off = C[i, first + r] * q.learn.sigma[r]
            for b in range(n_x):
                off += C[i, b] * S[b, r]
            a.nu[i, r] = off
            a.variance[i] += off * off


@rarely
def correct_allowed(a, K, accepted):
    """S⁺ = S - K ν of the accepted sensors."""
    for i in range(len(accepted)):
        if accepted[i]:
            for b in range(a.S.shape[0]):
                for r in range(a.S.shape[1]):
                    a.S[b, r] -= K[b, i] * a.nu[i, r]


@rarely
def correct_allowed_jointly(a, accepted, L, W, order):
    """The same by the Kalman gain of the moment, from the factors that a joint update has left."""
    count = 0
    for i in range(len(accepted)):
        count += accepted[i]
    for r in range(a.S.shape[1]):
        for i in range(count):
            rest = a.nu[order[i], r]
            for j in range(i):
                rest -= L[i, j] * a.e[j]
            a.e[i] = rest * L[i, i]
        for i in range(count):
            for b in range(a.S.shape[0]):
                a.S[b, r] -= W[i, b] * a.e[i]


@inlined
def finish_allowing(a, dt_s, x):
    """After a step: `around` goes after the estimate, and the next step is another."""
    draw_near(a.plant, dt_s, x, a.around)
    a.taken[0] = 0


@rarely
def widen(a, rows, k, out):
    """Add to the σ of step k, of heats and of the `rows` (n_x, W), what the parameters have in them."""
    S, square, value = a.S, a.work.shared, a.work.value
    n_x, L = len(rows), a.S.shape[1]
    if L == 0:
        return
    for j in range(out.heat_sigma.shape[1]):
        variance = out.heat_sigma[k, j] ** 2
        for r in range(L):
            variance += S[n_x + j, r] ** 2
        out.heat_sigma[k, j] = np.sqrt(variance)
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
        out.field_sigma[k, w] = np.sqrt(out.field_sigma[k, w] ** 2 + square[w])
