"""The loop of an observer with designed gains: one gain per set of sensors and length of step.

The step is that of the Kalman filter. Only the correction differs: x⁺ = x_pred + K (y - C x_pred), and the
covariance follows by Joseph's form, which holds for any K (Bucy and Joseph 1968). Parameters that are
considered have rows of zeros in K, so that Joseph's form is the consider filter of Schmidt (1966).
"""

from __future__ import annotations

from observer.kernels.codes import FINISHED, GOOD
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
    """Return whether a law's jump at step k adds noticeably to the variance of its heat."""
    n_x, jumps = len(p.uniform), False
    for j in range(len(p.source)):
        jump_W2 = squared(p.jump_uncertainty[j] * u.law_jump_W[k, p.source[j]])
        jumps = jumps or jump_W2 > _QUIET_JUMP * P[n_x + j, n_x + j]
    return jumps


def observe(b, state, out, gain_work):
    """Run the observer over the K steps of the batch, changing `state` and filling `out`.

    `gain_work.at` contains the next step. If `gain_work.gains` lacks its gain, it also contains the gain's
    key and the kind of the step. The next call continues from there with the gain added. The current Kalman
    gain replaces the designed one for `gain_work.settling_s` after a start, a release of all sensors, a law's
    jump, or a change of the good sensors. The designed gain is for another covariance.
    """
    taken, k = gain_work.at[TAKEN], gain_work.at[STEP]
    while k < len(b.step):
        if taken == SKIPPED:
            taken = start_or_predict(b, k, state, gain_work.work)
            if taken == SKIPPED:
                skip(b.inputs, k, gain_work.work.usable, state, out)
                k += 1
                continue
            state.verdict[0].runs_s = 0.0 if taken == STARTED else state.verdict[0].runs_s + b.inputs.dt_s[k]
        compare(b.plant, b.inputs, k, state, gain_work.work)
        copy(state.suspect, gain_work.work.suspect)
        write_innovations(gain_work.work.nu, gain_work.work.S_nu, gain_work.work.usable, k, out)
        out.log_likelihood[k] = 0.0
        released = refuse(gain_work.work.S_nu, b.gate_sigma, True, state, gain_work.work)
        key, correcting = key_of(b.inputs, k, state, gain_work.work, gain_work.bins[b.step[k]])
        chosen = find_gain(gain_work.gains, key)
        if chosen < 0 and correcting:
            copy(gain_work.work.suspect, state.suspect)
            gain_work.at[STEP], gain_work.at[KEY], gain_work.at[TAKEN] = k, key, taken
            return
        if readmit(b.plant, b.inputs.dt_s[k], released, True, state, gain_work.work) > 0.0:
            compare(b.plant, b.inputs, k, state, gain_work.work)
        sensors, moved = key & ((1 << len(gain_work.work.usable)) - 1), False
        if correcting and gain_work.settling_s > 0.0:
            moved = sensors != state.flags[3] or law_jumps(b.plant, b.inputs, k, state.P)
        if released or moved:
            state.verdict[0].runs_s = 0.0
        if correcting:
            state.flags[3] = sensors
        if correcting and state.verdict[0].runs_s <= gain_work.settling_s:
            keep(b.plant, state.x, state.P, gain_work.work.saved)
            correct_lower(b.plant, state, gain_work.work)
            give_back(b.plant, state.x, state.P, gain_work.work.saved)
            mirror(state.P)
        elif correcting:
            correct_by_gain(b.plant, gain_work.gains.K[chosen], state, gain_work.work)
        draw_near(b.plant, b.inputs.dt_s[k], state.x, state.around)
        is_valid = write_step(b.plant, b.inputs, k, state, gain_work.work, out)
        report_learned(b.plant, state.x, state.P, k, gain_work.work, out)
        if not is_valid:
            invalidate(out, k)
        k, taken = k + 1, SKIPPED
    gain_work.at[STEP], gain_work.at[KEY] = k, FINISHED


def run_fixed_gain(b, state, out, gain_work):
    """Run an observer with given gains (see `fixed_gain.observe`)."""
    with cython.nogil:
        observe(b, state, out, gain_work)
