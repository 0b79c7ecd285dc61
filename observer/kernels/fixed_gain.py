"""The loop of an observer with fixed gains: one gain per set of sensors and length of step.

x⁺ = x_pred + K (y - C x_pred). While the covariance is that of the steady state it is neither propagated nor
reported anew, which makes the step many times cheaper; only what is considered (`consider`) is. As soon as a
sensor is lost, a step has another length or a law jumps, it is propagated with the gain in use (Joseph form
for an arbitrary K), so σ stays honest.
"""

from __future__ import annotations

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
from observer.kernels.judging import invalidate, readmit, refuse, skip, write_innovations, write_step
from observer.kernels.kalman import SKIPPED, STARTED, STEPPED, start_or_predict
from observer.kernels.libc import cython
from observer.kernels.steady_state_step import take_steady_steps
from observer.kernels.step import compare, correct, is_drastic, symmetrise

STEP, KEY, TAKEN = 0, 1, 2


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


def correct_by_gain(p, K, state, work):
    """x⁺ = x + K ν, P⁺ = (I - K C) P (I - K C)ᵀ + K R Kᵀ for any K; sensors that are not accepted take no
    part.
    """
    P, A, n_x = state.P, work.A, work.C.shape[1]
    put(P, A)
    for i in range(len(work.accepted)):
        if work.accepted[i]:
            for a in range(P.shape[0]):
                gain = K[a, i]
                state.x[a] += gain * work.nu[i]
                for b in range(P.shape[1]):
                    A[a, b] -= gain * work.g[i, b]
    put(A, P)
    for i in range(len(work.accepted)):
        if work.accepted[i]:
            for a in range(P.shape[0]):
                rest = p.R_K2[i] * K[a, i]
                for b in range(n_x):
                    rest -= A[a, b] * work.C[i, b]
                for b in range(P.shape[0]):
                    P[a, b] += rest * K[b, i]
    symmetrise(P)


def key_of(u, k, state, work, step_bin):
    """Key of the gain for the sensors that are good, whether all of them correct at step k, and whether any.

    A good sensor that only has no new sample at this tick counts as present: its gain waits for its next
    sample.
    """
    s, alive, complete, correcting = len(work.usable), 0, True, False
    for i in range(s):
        correcting = correcting or work.accepted[i] != 0
        if u.quality[k, i] == GOOD and state.suspect[i] == 0.0:
            alive += 1 << i
            complete = complete and work.accepted[i]
    return (step_bin << s) + alive, complete, correcting


def observe(b, state, out, own):
    """Run the observer over the K steps of `u`, changing `state` and filling `out`.

    `own.at` says which step is next, and, where its gain is not among `own.gains`, the key of that gain and
    how the step was taken: with the gain added and called again, it goes on from there. `own.optimal`: until
    the covariance has settled, correct by the Kalman gain of the moment instead of the one in the table. What
    is `own.considered` widens the gate and the reported σ, and changes no estimate.
    """
    taken = own.at[TAKEN]
    settled = find_settled(own.gains, state.P) if taken == SKIPPED else -1
    k = own.at[STEP]
    while k < len(b.step):
        if settled >= 0:
            k = take_steady_steps(b, settled, k, state, out, own)
            settled = -1
            continue
        if taken == SKIPPED:
            taken = start_or_predict(b, k, state, own.work)
            if taken == STARTED:
                begin_considered(own.considered, b.inputs, k, state.x)
            elif taken == STEPPED:
                propagate_considered(own.considered, b, k)
            else:
                skip(b.inputs, k, own.work.usable, state, out)
                settled = find_settled(own.gains, state.P)
                k += 1
                continue
        compare(b.plant, b.inputs, k, state, own.work)
        consider_readings(own.considered, own.work.S_nu)
        copy(state.suspect, own.work.suspect)
        write_innovations(own.work.nu, own.considered.variance, own.work.usable, k, out)
        out.log_likelihood[k] = 0.0
        released = refuse(own.considered.variance, b.gate_sigma, True, state, own.work)
        key, complete, correcting = key_of(b.inputs, k, state, own.work, own.bins.number[b.step[k]])
        chosen = find_gain(own.gains, key)
        if chosen < 0 and correcting:
            copy(own.work.suspect, state.suspect)
            own.at[STEP], own.at[KEY], own.at[TAKEN] = k, key, taken
            return
        if readmit(b.plant, b.inputs.dt_s[k], released, True, state, own.work) > 0.0:
            compare(b.plant, b.inputs, k, state, own.work)
        if correcting and (own.optimal or taken == STARTED or released):
            drastic = is_drastic(b.plant, own.work)
            correct(b.plant, state, own.work)
            if drastic:  # no factors are left; the gain of the table is near enough for what is considered
                correct_considered(own.considered, own.gains.K[chosen], own.work.accepted)
            else:
                correct_considered_jointly(own.considered, own.work)
        elif correcting:
            correct_considered(own.considered, own.gains.K[chosen], own.work.accepted)
            correct_by_gain(b.plant, own.gains.K[chosen], state, own.work)
        steady = correcting and complete and own.bins.exact[b.step[k]] and b.plant.coupling.active == 0
        if steady and own.gains.steady[chosen] and near(state.P, own.gains, chosen):
            put(own.gains.P[chosen], state.P)
            settled = chosen
        finish_considered(own.considered, b.inputs.dt_s[k], state.x)
        known = write_step(b.plant, b.inputs, k, state, own.work, out)
        add_considered(own.considered, own.work.rows, k, out)
        if not known:
            invalidate(out, k)
        k, taken = k + 1, SKIPPED
    own.at[STEP], own.at[KEY] = k, DONE


def run_fixed_gain(b, state, out, own):
    """Run an observer with fixed gains (see `fixed_gain.observe`)."""
    with cython.nogil:
        observe(b, state, out, own)
