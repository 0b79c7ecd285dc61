"""The loop of an observer whose gains are given: one gain per set of sensors and length of step.

The step is that of the Kalman filter. Only the correction differs: x⁺ = x_pred + K (y - C x_pred), and the
covariance follows by Joseph's form, which holds for any K (Bucy and Joseph 1968). Parameters that are
considered have rows of zeros in K, so that Joseph's form is the consider filter of Schmidt (1966).
"""

from __future__ import annotations

from observer.kernels.codes import DONE, GOOD
from observer.kernels.covariance import mirror, squared
from observer.kernels.judging import invalidate, readmit, refuse, skip, write_innovations, write_step
from observer.kernels.kalman import SKIPPED, STARTED, start_or_predict
from observer.kernels.learning import draw_near, give_back, keep, report_learned
from observer.kernels.libc import cython
from observer.kernels.step import compare, correct_by_gain, correct_lower

STEP, KEY, TAKEN = 0, 1, 2
_QUIET_JUMP = 1e-3  # part of a heat's variance


def find_gain(gains, key):
    """Return the index of a key, or -1."""
    for i in range(len(gains.key)):
        if gains.key[i] == key:
            return i
    return -1


def copy(source, target):
    """Copy a vector."""
    for i in range(len(source)):
        target[i] = source[i]


def key_of(u, k, state, work, step_bin):
    """Return the key of the gain for the sensors that are good, and whether any of them corrects at step k.

    A good sensor without a new sample at this tick counts as present: its gain waits for its next sample.
    """
    s, alive, correcting = len(work.usable), 0, False
    for i in range(s):
        correcting = correcting or work.accepted[i] != 0
        if u.quality[k, i] == GOOD and state.suspect[i] == 0.0:
            alive += 1 << i
    return (step_bin << s) + alive, correcting


def law_jumps(p, u, k, P):
    """Return whether a law's jump at step k adds to the variance of its heat what σ would notice."""
    n_x, jumps = len(p.uniform), False
    for j in range(len(p.source)):
        jump_W2 = squared(p.jump_uncertainty[j] * u.law_jump_W[k, p.source[j]])
        jumps = jumps or jump_W2 > _QUIET_JUMP * P[n_x + j, n_x + j]
    return jumps


def observe(b, state, out, own):
    """Run the observer over the K steps of the batch, changing `state` and filling `out`.

    `own.at` is the next step. Where its gain is not among `own.gains`, it also holds that gain's key and how
    the step was taken; with the gain added, the next call goes on from there. For `own.settling_s` after a
    start, a release of all sensors, a law's jump, or a change of the sensors that are good, the Kalman gain
    of the moment corrects instead of the given one, which is made for another covariance.
    """
    taken, k = own.at[TAKEN], own.at[STEP]
    while k < len(b.step):
        if taken == SKIPPED:
            taken = start_or_predict(b, k, state, own.work)
            if taken == SKIPPED:
                skip(b.inputs, k, own.work.usable, state, out)
                k += 1
                continue
            state.verdict[0].runs_s = 0.0 if taken == STARTED else state.verdict[0].runs_s + b.inputs.dt_s[k]
        compare(b.plant, b.inputs, k, state, own.work)
        copy(state.suspect, own.work.suspect)
        write_innovations(own.work.nu, own.work.S_nu, own.work.usable, k, out)
        out.log_likelihood[k] = 0.0
        released = refuse(own.work.S_nu, b.gate_sigma, True, state, own.work)
        key, correcting = key_of(b.inputs, k, state, own.work, own.bins[b.step[k]])
        chosen = find_gain(own.gains, key)
        if chosen < 0 and correcting:
            copy(own.work.suspect, state.suspect)
            own.at[STEP], own.at[KEY], own.at[TAKEN] = k, key, taken
            return
        if readmit(b.plant, b.inputs.dt_s[k], released, True, state, own.work) > 0.0:
            compare(b.plant, b.inputs, k, state, own.work)
        sensors, moved = key & ((1 << len(own.work.usable)) - 1), False
        if correcting and own.settling_s > 0.0:
            moved = sensors != state.flags[3] or law_jumps(b.plant, b.inputs, k, state.P)
        if released or moved:
            state.verdict[0].runs_s = 0.0
        if correcting:
            state.flags[3] = sensors
        if correcting and state.verdict[0].runs_s <= own.settling_s:
            keep(b.plant, state.x, state.P, own.work.kept)
            correct_lower(b.plant, state, own.work)
            give_back(b.plant, state.x, state.P, own.work.kept)
            mirror(state.P)
        elif correcting:
            correct_by_gain(b.plant, own.gains.K[chosen], state, own.work)
        draw_near(b.plant, b.inputs.dt_s[k], state.x, state.around)
        known = write_step(b.plant, b.inputs, k, state, own.work, out)
        report_learned(b.plant, state.x, state.P, k, own.work, out)
        if not known:
            invalidate(out, k)
        k, taken = k + 1, SKIPPED
    own.at[STEP], own.at[KEY] = k, DONE


def run_fixed_gain(b, state, out, own):
    """Run an observer with given gains (see `fixed_gain.observe`)."""
    with cython.nogil:
        observe(b, state, out, own)
