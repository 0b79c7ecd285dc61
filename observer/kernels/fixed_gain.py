"""The loop of an observer with fixed gains: one gain per set of sensors and length of step.

x⁺ = x_pred + K (y - C x_pred). While the covariance is that of the steady state it is neither propagated nor
reported anew, which makes the step many times cheaper; only what is considered (`consider`) is. As soon as a
sensor is lost, a step has another length or a law jumps, it is propagated with the gain in use (Joseph form
for an arbitrary K), so σ stays honest.
"""

from __future__ import annotations

from observer.kernels.advance import move_columns, put_laws
from observer.kernels.codes import DONE, GOOD
from observer.kernels.consider import (
    add_considered,
    begin_considered,
    consider_readings,
    correct_considered,
    correct_considered_jointly,
    finish_considered,
    propagate_considered,
)
from observer.kernels.judging import (
    add_prior,
    defer_readmitted,
    find_usable,
    gate,
    inflate_for_lost_position,
    inflate_for_rejected,
    invalidate,
    judge,
    move_rows,
    skip,
    step_is_finite,
    write_innovations,
    write_sigmas,
    write_values,
)
from observer.kernels.libc import cython
from observer.kernels.steady_state_step import take_steady_steps
from observer.kernels.step import (
    compare,
    correct,
    is_drastic,
    predict,
    start,
    symmetrise,
)

_PREDICTED, _STARTED = 1, 2


def find_gain(gains, key):
    """Index of a key, or -1."""
    for i in range(len(gains.key)):
        if gains.key[i] == key:
            return i
    return -1


def find_settled(gains, P):
    """The gain whose steady covariance P is, to the last bit, or -1."""
    n = P.shape[0]
    for i in range(len(gains.key)):
        same = gains.steady[i]
        for a in range(n):
            for b in range(n):
                same = same and gains.P[i, a, b] == P[a, b]
        if same:
            return i
    return -1


def near(P, gains, i):
    """Whether every variance is near enough to its steady value under gain i."""
    far = 0
    for a in range(P.shape[0]):
        if abs(P[a, a] - gains.P[i, a, a]) > gains.slack[i, a]:
            far += 1
    return far == 0


def copy(source, target):
    """Copy a vector."""
    for i in range(len(source)):
        target[i] = source[i]


def put(source, target):
    """Copy a matrix into the first columns of another."""
    for a in range(source.shape[0]):
        for b in range(source.shape[1]):
            target[a, b] = source[a, b]


def correct_covariance(R_K2, C, accepted, K, g, P, A):
    """P⁺ = (I - K C) P (I - K C)ᵀ + K R Kᵀ for any K, with g_i = P c_i; absent sensors take no part."""
    n, width, n_x = P.shape[0], P.shape[1], C.shape[1]
    put(P, A)
    for i in range(len(accepted)):
        if accepted[i]:
            for a in range(n):
                gain = K[a, i]
                for b in range(width):
                    A[a, b] -= gain * g[i, b]
    put(A, P)
    for i in range(len(accepted)):
        if accepted[i]:
            for a in range(n):
                rest = R_K2[i] * K[a, i]
                for b in range(n_x):
                    rest -= A[a, b] * C[i, b]
                for b in range(n):
                    P[a, b] += rest * K[b, i]
    symmetrise(P)


def key_of(u, k, usable, accepted, suspect, step_bin):
    """Key of the gain for the sensors that are good, and whether all of them correct at step k.

    A good sensor that only has no new sample at this tick counts as present: its gain waits for its next
    sample.
    """
    s = len(usable)
    alive, complete = 0, True
    for i in range(s):
        if u.quality[k, i] == GOOD and suspect[i] == 0.0:
            alive += 1 << i
            complete = complete and accepted[i]
    return (step_bin << s) + alive, complete


def correct_state(K, chosen, accepted, nu, x):
    """Add K ν of the accepted sensors to x."""
    for i in range(len(accepted)):
        if accepted[i]:
            for a in range(len(x)):
                x[a] += K[chosen, a, i] * nu[i]


def observe(p, t, bins, u, step, state, gate_sigma, optimal, gains, out, first, resumed, work, c, considered):
    """Run the observer over the K steps of `u` from `first` on, changing `state` and filling `out`.

    `step` (K,) is where each step's length is in the table `t`.
    Returns (k, key, resumed). Where a gain is not in the table it stops before that step's correction and
    names it; called again from there with the `resumed` it returned, it goes on. `optimal`: until the
    covariance has settled, correct by the Kalman gain of the moment instead of the one in the table.
    What is `considered` widens the gate and the reported σ, and changes no estimate.
    """
    s = u.y_degC.shape[1]
    x, P, B, C = state.x, state.P, work.B, work.C
    nu, S, g, usable, accepted = work.nu, work.S_nu, work.g, work.usable, work.accepted
    suspect, roughly = work.suspect, considered.S.shape[1] > 0
    settled = find_settled(gains, P) if resumed == 0 else -1
    k = first
    while k < len(step):
        if settled >= 0:
            k = take_steady_steps(
                p, t, bins, u, step, state, gate_sigma, gains, settled, out, k, work, c, considered
            )
            settled = -1
            continue
        present = find_usable(u, k, usable)
        if not step_is_finite(u, k) or (state.flags[0] == 0 and present == 0):
            skip(u, k, usable, state, out)
            settled = find_settled(gains, P)
            k += 1
            continue
        d = step[k]
        started = resumed == _STARTED
        move_columns(p, u, k, B, C)
        if resumed == 0 and state.flags[0] == 0:
            start(p, C, u, k, usable, x, P, nu)
            begin_considered(considered, u, k, x)
            put_laws(p, u, k, B, x, work.law)
            started = True
            state.flags[0] = 1
        elif resumed == 0:
            if roughly:
                propagate_considered(considered, t, d, u, k)
            predict(p, t, d, u, k, state, work)
            inflate_for_lost_position(p, u, k, state.lost_s, P)
        resumed = 0
        compare(p, u, k, state, work)
        consider_readings(considered, S)
        copy(state.suspect, suspect)
        write_innovations(nu, considered.variance, usable, k, out)
        out.log_likelihood[k] = 0.0
        released = gate(nu, considered.variance, usable, state.suspect, gate_sigma, accepted)
        if not released:
            defer_readmitted(nu, usable, accepted, state.suspect, state.refused_s, state.opened_K)
        correcting = False
        for i in range(s):
            correcting = correcting or accepted[i] != 0
        key, complete = key_of(u, k, usable, accepted, state.suspect, bins.number[d])
        chosen = find_gain(gains, key)
        if chosen < 0 and correcting:
            copy(suspect, state.suspect)
            return k, key, _STARTED if started else _PREDICTED
        if released:
            add_prior(p, P, 1.0)
        share = inflate_for_rejected(
            p, C, u.dt_s[k], usable, accepted, nu, state.suspect, state.refused_s, state.opened_K, P
        )
        if released or share > 0.0:
            compare(p, u, k, state, work)
        if correcting and (optimal or started or released):
            drastic = is_drastic(p, work)
            correct(p, state, work)
            if drastic:  # no factors are left; the gain of the table is near enough for what is allowed for
                correct_considered(considered, gains.K[chosen], accepted)
            else:
                correct_considered_jointly(considered, accepted, work.L, work.W, work.order)
        elif correcting:
            correct_considered(considered, gains.K[chosen], accepted)
            correct_state(gains.K, chosen, accepted, nu, x)
            correct_covariance(p.R_K2, C, accepted, gains.K[chosen], g, P, work.A)
        steady = correcting and complete and bins.exact[d] and p.coupling.active == 0
        if steady and gains.steady[chosen] and near(P, gains, chosen):
            put(gains.P[chosen], P)
            settled = chosen
        finish_considered(considered, u.dt_s[k], x)
        out.quality[k] = judge(u, k, usable, accepted, state, out)
        move_rows(p, u, k, work.rows)
        known = write_values(p, u, k, state, work, out)
        known = write_sigmas(state, k, work, out) and known
        if roughly:
            add_considered(considered, work.rows, k, out)
        if not known:
            invalidate(out, k)
        k += 1
    return len(step), DONE, 0


def run_fixed_gain(
    p, t, bins, u, step, state, gate_sigma, optimal, gains, out, first, resumed, work, c, considered
):
    """Run an observer with fixed gains (see `fixed_gain.observe`)."""
    with cython.nogil:
        done = observe(
            p, t, bins, u, step, state, gate_sigma, optimal, gains, out, first, resumed, work, c, considered
        )
    return done  # noqa: RET504  (Python takes part again only here)
