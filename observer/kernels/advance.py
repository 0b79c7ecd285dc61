"""The compiled advance of a plant's state over one step: filter, smoother, open loop and fit share it.

The couplings act for half a step on either side of the exact diagonal step (see `coupling`). Heats follow
their laws at the current temperature. Nothing here calls BLAS and no sum is reordered: K steps give the same
bits as K runs of one.

| Record | Fields |
|---|---|
| plant `p` | `B` (m, W) and `E` (p, W) as rows of W ≥ n_x states, `modes`, `coupling` |
| | `source` (m_e,) of each heat that is a state, `moving` (M,) source of each moving column |
| table of step lengths `t` | `decay`, `hold`, `ramp` (D, W), `heat_decay` (D, m_e), `couple` (D, m_e, W) |
| inputs `u` | those of `Inputs` |
| `work` | scratch, and `sweep` (K, M, e, N), empty if unknown |

The squares of the shapes in `sweep` add up to the covariance of a moving source's column over a step.
"""

from __future__ import annotations

from observer.kernels.coupling import couple, faded, swept, uniform_loss
from observer.kernels.covariance import add_row, add_scaled, take_along
from observer.kernels.exact_step import hold, ramp
from observer.kernels.libc import cython, exp


def move_columns(p, u, k, B, C):
    """Put the columns of the moving sources over step k in place."""
    for i in range(len(p.moving)):
        index = p.moving[i]
        for a in range(u.moving_B.shape[2]):
            B[index, a] = u.moving_B[k, i, a]
        for r in range(C.shape[0]):
            C[r, p.modes + index] = u.moving_C[k, i, r]


def advance(p, t, d, u, k, x, work):
    """Take the state x, plant states and deviations of the heats, over step k of the length d of the table.

    Afterwards `work.law` contains the heats by their laws. With couplings, `work.before` (2, n_x) contains
    the states before each half of the couplings.
    """
    if p.coupling.active:
        couple_half(p, u, k, u.z_start[k], x, 0, work)
    put_laws(p, u, k, work.B, x, work.law)
    advance_diagonal(p, t, d, u, k, x, work)
    if p.coupling.active:
        couple_half(p, u, k, u.z_end[k], x, 1, work)


def put_laws(p, u, k, B, x, law):
    """Write each source's heat by its law over step k, at the current temperature if it depends on that."""
    for j in range(len(law)):
        law[j] = u.law_W[k, j]
        if p.coupling.active:
            law[j] *= faded(p.coupling, j, u.z_start[k], B, x)


def advance_diagonal(p, t, d, u, k, x, work):
    """x⁺ = e∘x + hold∘(B law + E z_start) + ramp∘(E (z_end - z_start)) + Σ_j B_j∘couple_j δ_j;  δ⁺ = γ∘δ."""
    n_x = work.B.shape[1]
    for a in range(n_x):
        work.driven[a] = 0.0
    add_scaled(work.driven, work.B, work.law, work.B.shape[0])
    add_scaled(work.driven, p.E, u.z_start[k], p.E.shape[0])
    for a in range(n_x):
        x[a] = t.decay[d, a] * x[a] + t.hold[d, a] * work.driven[a]
    ramp_up(p, t, d, u, k, x)
    for j in range(len(p.source)):
        delta, index = x[n_x + j], p.source[j]
        for a in range(n_x):
            x[a] += work.B[index, a] * t.couple[d, j, a] * delta
        x[n_x + j] = t.heat_decay[d, j] * delta


def ramp_up(p, t, d, u, k, x):
    """Add the effect of the known inputs' rises over step k: x += ramp∘(E (z_end - z_start))."""
    for q in range(p.E.shape[0]):
        rise = u.z_end[k, q] - u.z_start[k, q]
        if rise != 0.0:
            for a in range(p.E.shape[1]):
                x[a] += t.ramp[d, a] * p.E[q, a] * rise


def couple_half(p, u, k, z, x, half, work):
    """Take half a step of the couplings; `half` is 0 before the diagonal step and 1 after it."""
    X, n_x, half_s = work.state.X, work.before.shape[1], 0.5 * u.dt_s[k]
    sweeps = len(p.moving) if work.sweep.shape[0] * work.sweep.shape[2] > 0 else 0
    if half == 1:
        for i in range(sweeps - 1, -1, -1):
            swept(p.coupling, p.moving[i], work.sweep[k, i], half_s, x, -1)
    rate_1_s, drawn = uniform_loss(p.coupling, u.loss_1_s[k], u.loss_degC[k], z[p.coupling.ambient], x)
    for a in range(n_x):
        X[a, 0] = x[a]
    for q in range(len(z)):
        work.state.inputs[q, 0] = z[q]
    couple(p.coupling, rate_1_s, drawn, work.B, half_s, work.state, work.link)
    for a in range(n_x):
        x[a] = X[a, 0]
    if half == 0:
        for i in range(sweeps):
            swept(p.coupling, p.moving[i], work.sweep[k, i], half_s, x, 1)


def form_half(p, u, k, z, B, x, work):
    """Write half a step of the couplings as [M N r] into `work.half_step`: x⁺ = M x + N z + r.

    The transpose goes into `half_step_T`. Nothing is computed if the inputs in `made_of` are unchanged.
    """
    X, made_of, n_x = work.half_step.X, work.made_of, B.shape[1]
    rate_1_s, drawn = uniform_loss(p.coupling, u.loss_1_s[k], u.loss_degC[k], z[p.coupling.ambient], x)
    same = made_of[0] == u.dt_s[k] and made_of[1] == rate_1_s and made_of[2] == drawn
    made_of[0], made_of[1], made_of[2] = u.dt_s[k], rate_1_s, drawn
    for i in range(len(p.moving)):
        for a in range(n_x):
            same = same and made_of[3 + i * n_x + a] == B[p.moving[i], a]
            made_of[3 + i * n_x + a] = B[p.moving[i], a]
    if same:
        return
    for a in range(n_x):
        for b in range(X.shape[1]):
            X[a, b] = 1.0 if a == b else 0.0
    couple(p.coupling, rate_1_s, drawn, B, 0.5 * u.dt_s[k], work.half_step, work.link)
    for a in range(n_x):
        for b in range(X.shape[1]):
            work.half_step_T[b, a] = X[a, b]


def step_half(p, u, k, z, x, half, work):
    """The same as `couple_half` by the matrices of `form_half`; `work.before` is what x was."""
    MT, n_x = work.half_step_T, work.B.shape[1]
    moved, first = work.half_step.sums[0, : MT.shape[1]], MT.shape[1]
    form_half(p, u, k, z, work.B, x, work)
    for a in range(n_x):
        work.before[half, a] = x[a]
    for a in range(len(moved)):
        moved[a] = MT[first + len(z), a]
    add_scaled(moved, MT, work.before[half], n_x)
    for q in range(len(z)):
        add_row(moved, z[q], MT[first + q])
    for a in range(n_x):
        x[a] = moved[a]


def couple_covariance(p, u, k, z, half, P, work):
    """Take a covariance over half a step of the couplings, linearised as in `step_half`."""
    form_half(p, u, k, z, work.B, work.before[half], work)
    take_along(work.half_step.X, work.half_step_T, work.B.shape[1], P, work.was)


def couple_columns(p, u, k, z, x, X, work):
    """Take every column of X over half a step of the couplings, linearised at x."""
    form_half(p, u, k, z, work.B, x, work)
    multiply_columns(work.half_step.X, work.B.shape[1], X, work.was)


def multiply_columns(M, n_x, X, scratch):
    """X ← M X for its first n_x rows, as many columns at a time as `scratch` has."""
    first = 0
    while first < X.shape[1]:
        count = min(scratch.shape[1], X.shape[1] - first)
        for a in range(n_x):
            for q in range(count):
                scratch[a, q] = 0.0
            for b in range(n_x):
                weight = M[a, b]
                for q in range(count):
                    scratch[a, q] += weight * X[b, first + q]
        for a in range(n_x):
            for q in range(count):
                X[a, first + q] = scratch[a, q]
        first += count


def advance_columns(p, t, d, B, X):
    """The step without inputs for every column of X (n, c): x⁺ = e∘x + Σ_j B_j∘couple_j δ_j;  δ⁺ = γ∘δ."""
    n_x, count = B.shape[1], X.shape[1]
    for a in range(n_x):
        keep = t.decay[d, a]
        for q in range(count):
            X[a, q] *= keep
        for j in range(len(p.source)):
            add_row(X[a], B[p.source[j], a] * t.couple[d, j, a], X[n_x + j])
    for j in range(len(p.source)):
        keep = t.heat_decay[d, j]
        for q in range(count):
            X[n_x + j, q] *= keep


def march_steps(loop, x, states, first):
    """March x over steps of the inputs from `first` on.

    States and known inputs at the ends of the steps go into `states` (K, n_x + p). Without couplings, the
    inputs' effect is recomputed only if it changes.
    """
    decay, B = loop.decay_1_s, loop.work.B
    n_x, dt_known, driven = len(decay), -1.0, False
    for r in range(states.shape[0]):
        k = first + r
        if loop.inputs.dt_s[k] != dt_known:
            dt_known, driven = loop.inputs.dt_s[k], False
            for a in range(n_x):
                loop.table.decay[0, a] = exp(-decay[a] * dt_known)
                loop.table.hold[0, a] = hold(decay[a], dt_known)
                loop.table.ramp[0, a] = ramp(decay[a], dt_known)
        move_columns(loop.plant, loop.inputs, k, B, loop.work.C)
        if loop.plant.coupling.active:
            advance(loop.plant, loop.table, 0, loop.inputs, k, x, loop.work)
        else:
            if not driven or len(loop.plant.moving) > 0 or not is_held(loop.plant, loop.inputs, k):
                hold_inputs(loop.plant, loop.table, loop.inputs, k, B, loop.work)
                driven = True
            for a in range(len(x)):
                x[a] = loop.table.decay[0, a] * x[a] + loop.work.driven[a]
            ramp_up(loop.plant, loop.table, 0, loop.inputs, k, x)
        for a in range(n_x):
            states[r, a] = x[a]
        for q in range(loop.inputs.z_end.shape[1]):
            states[r, n_x + q] = loop.inputs.z_end[k, q]


def is_held(p, u, k):
    """Return whether laws and known inputs at the start of step k equal those of the step before."""
    for j in range(u.law_W.shape[1]):
        if u.law_W[k, j] != u.law_W[k - 1, j]:
            return False
    for q in range(p.E.shape[0]):
        if u.z_start[k, q] != u.z_start[k - 1, q]:
            return False
    return True


def hold_inputs(p, t, u, k, B, work):
    """Put hold∘(B law + E z_start) of step k into `work.driven`."""
    for a in range(len(work.driven)):
        work.driven[a] = 0.0
    add_scaled(work.driven, B, u.law_W[k], B.shape[0])
    add_scaled(work.driven, p.E, u.z_start[k], p.E.shape[0])
    for a in range(len(work.driven)):
        work.driven[a] *= t.hold[0, a]


def march(loop, x, states, first):
    """Run the open loop (see `advance.march_steps`)."""
    with cython.nogil:
        march_steps(loop, x, states, first)
