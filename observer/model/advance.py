"""The compiled advance of a plant's state over one step: filter, smoother and open loop share it.

The columns of what moves are put in place, each source's heat is taken at the temperature of the moment, what
couples the states acts for half a step on either side, and in between every state goes its own way exactly.
Nothing here calls BLAS and no sum is reordered: K steps give the same bits as K runs of one.
"""

# numba compiles these functions: their types are those of the arrays they get.
# mypy: disable-error-code="no-untyped-def, misc"

from __future__ import annotations

from observer.compiled import inlined, rarely
from observer.model.coupling import coupled, faded


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
def put_laws(p, u, k, B, x, law):
    """Each source's heat by its law over step k, at the temperature of the moment if it depends on that."""
    for j in range(len(law)):
        law[j] = u.law[k, j]
        if p.coupling.active:
            law[j] *= faded(p.coupling, j, u.z_start[k], B, x)


@rarely
def couple_half(p, u, k, z, B, x, P, work):
    """Half a step of what couples the states: x ← M x + b, P ← [M 0; 0 I] P [M 0; 0 I]ᵀ."""
    M, b, was = work.couple, work.shift, work.was
    n_x, n = M.shape[0], P.shape[0]
    coupled(p.coupling, u.loss[k], u.loss_degC[k], z, B, 0.5 * u.dt[k], x, M, b)
    for a in range(n_x):
        was[a, 0] = x[a]
    for a in range(n_x):
        x[a] = b[a]
        for i in range(n_x):
            x[a] += M[a, i] * was[i, 0]
    for a in range(n_x):
        for q in range(n):
            was[a, q] = 0.0
        for i in range(n_x):
            if M[a, i] != 0.0:
                for q in range(n):
                    was[a, q] += M[a, i] * P[i, q]
    for a in range(n_x):
        for q in range(n_x, n):
            P[a, q] = was[a, q]
            P[q, a] = was[a, q]
        for q in range(a + 1):
            total = 0.0
            for i in range(n_x):
                total += was[a, i] * M[q, i]
            P[a, q] = total
            P[q, a] = total


@inlined
def predict_state(p, t, d, u, k, B, x, work):
    """x⁺ = e∘x + hold∘(B law + E z_start) + ramp∘(E (z_end - z_start)) + Σ_j B_j∘couple_j δ_j;  δ⁺ = γ∘δ."""
    n_x = B.shape[1]
    for a in range(n_x):
        work.forced[a] = 0.0
        work.ramped[a] = 0.0
    for j in range(B.shape[0]):
        law = work.law[j]
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
