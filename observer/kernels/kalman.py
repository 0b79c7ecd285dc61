"""The Kalman filter's loop over K steps, and the two halves of a step that the smoother takes as well."""

from __future__ import annotations

from observer.kernels.advance import move_columns, put_laws
from observer.kernels.covariance import mirror
from observer.kernels.judging import (
    find_usable,
    inflate_for_lost_position,
    invalidate,
    judge_sensors,
    skip,
    step_is_finite,
    write_innovations,
    write_step,
)
from observer.kernels.learning import begin, draw_near, follow, give_back, keep, report_learned
from observer.kernels.libc import cython
from observer.kernels.screening import screen
from observer.kernels.step import compare, correct_lower, predict, start

SKIPPED, STARTED, STEPPED = 0, 1, 2


def start_or_predict(b, k, state, work):
    """Take the state to the end of step k, before its measurements; return SKIPPED, STARTED or STEPPED."""
    present = find_usable(b.inputs, k, work.usable)
    for i in range(len(work.accepted)):
        work.accepted[i] = False
    if not step_is_finite(b.inputs, k) or (state.flags[0] == 0 and present == 0):
        return SKIPPED
    move_columns(b.plant, b.inputs, k, work.B, work.C)
    if state.flags[0] == 0:
        start(b.plant, b.inputs, k, state, work)
        begin(b.plant, b.inputs, k, state, work)
        put_laws(b.plant, b.inputs, k, work.B, state.x, work.law)
        state.flags[0] = 1
        return STARTED
    if len(b.plant.learn.kind) > 0:
        follow(b.plant, b, k, state.around, state.x, work)
    predict(b, k, state, work)
    inflate_for_lost_position(b.plant, b.inputs, k, state.lost_s, state.P)
    return STEPPED


def judge_and_correct(p, u, k, gate_sigma, state, work):
    """Correct by the usable sensors that pass the gate, after `compare`; return the log-likelihood."""
    present = 0
    for i in range(len(work.usable)):
        present += 1 if work.usable[i] else 0
    if len(state.guard) > 0:
        opened = screen(p, u, k, gate_sigma, state, work)
    elif present > 0:
        opened = judge_sensors(p, u, k, gate_sigma, state, work)
    else:
        opened = False
    if present == 0:
        return 0.0
    if opened:
        compare(p, u, k, state, work)
    keep(p, state.x, state.P, work.saved)
    log_likelihood = correct_lower(p, state, work)
    give_back(p, state.x, state.P, work.saved)
    return log_likelihood


def filter_steps(b, state, out, work):
    """Run the Kalman filter over the K steps of `u` (see `filter_part`)."""
    filter_part(b, state, out, work, 0, len(b.step))


def filter_part(b, state, out, work, first, end):
    """Run the Kalman filter from step `first` up to `end`, changing `state` and filling `out`.

    A step with laws or known inputs that are not finite is invalid and does not change the state.
    """
    for k in range(first, end):
        if start_or_predict(b, k, state, work) == SKIPPED:
            skip(b.inputs, k, work.usable, state, out)
            continue
        compare(b.plant, b.inputs, k, state, work)
        write_innovations(work.nu, work.S_nu, work.usable, k, out)
        out.log_likelihood[k] = judge_and_correct(b.plant, b.inputs, k, b.gate_sigma, state, work)
        draw_near(b.plant, b.inputs.dt_s[k], state.x, state.around)
        is_valid = write_step(b.plant, b.inputs, k, state, work, out)
        report_learned(b.plant, state.x, state.P, k, work, out)
        if not is_valid:
            invalidate(out, k)
    mirror(state.P)


def run_kalman(b, state, out, work):
    """Run the Kalman filter over the K steps of `u` (see `kalman.filter_steps`)."""
    with cython.nogil:
        filter_steps(b, state, out, work)
