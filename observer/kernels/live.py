"""One reading and one tick, on records that persist from tick to tick.

The kernels are those of whole logs, with one call for each stage. Each stage receives a record. Its memory
belongs to the part that takes the steps.
"""

from __future__ import annotations

from observer.kernels.bank import gather, put_bounds
from observer.kernels.codes import GOOD, INPUT_LOST, NUT_LOST, TICKS_PER_S
from observer.kernels.kalman import filter_steps
from observer.kernels.libc import bytes_of, isfinite, isnan, rint, take_bytes
from observer.kernels.path import average_columns
from observer.kernels.selftest import compare_ways, run_selftest
from observer.kernels.walk import walk_rows


def put_reading(walk, time_s, late_s, values):
    """Queue the values of a reading as a row; return the number of floats of channels, -1 without room."""
    rows, row, taken = walk.rows, walk.waiting, 0
    if row == len(rows.time_s):
        return -1
    rows.time_s[row], rows.late_s[row] = time_s, late_s
    for j in range(len(walk.names)):
        rows.present[row, j] = False
        if walk.names[j] in values:
            value = values[walk.names[j]]
            rows.values[row, j], rows.present[row, j], rows.faulted[row, j] = value, True, False
            taken += type(value) is float
    walk.waiting = row + 1
    return taken


def tick_on(walk, time_s):
    """Walk over the queued rows and a tick after them; return a copy of its frame, None without room."""
    rows, count = walk.rows, walk.waiting
    if count == len(rows.time_s):
        return None
    rows.time_s[count], rows.late_s[count], rows.step[count] = time_s, 0.0, True
    for j in range(rows.present.shape[1]):
        rows.present[count, j] = False
    walk_rows(rows, count + 1, walk.plan, walk.memory, walk.frames)
    rows.step[count], walk.waiting = False, 0
    return bytes_of(walk.octets, len(walk.octets))


def fill_inputs(read, desk, begin_s, last_s):
    """Fill in the inputs of K steps from the values of frames, and missing values of `desk.law`.

    Shapes are those of `Inputs`.
    """
    time_s, quality, degraded = desk.time_s, desk.quality, desk.degraded
    for k in range(len(time_s)):
        hours = (time_s[k] - begin_s) / 3600.0
        hours_before = ((time_s[k - 1] if k > 0 else last_s) - begin_s) / 3600.0
        if isnan(hours_before):
            hours_before = hours
        ready = _fill_known(read, desk, k, hours, hours_before)
        _fill_laws(desk, k)
        for i in range(len(read.sensors)):
            column = read.sensors[i]
            desk.y_degC[k, i], desk.sensor_quality[k, i] = desk.values[k, column], quality[k, column]
            desk.usable[k, i] = desk.fresh[k, column] and quality[k, column] == GOOD and ready
        degraded[k] = 0
        for i in range(len(read.required)):
            if quality[k, read.required[i]] != GOOD:
                degraded[k] = INPUT_LOST
        for i in range(len(read.nuts)):
            if quality[k, read.nuts[i]] != GOOD:
                degraded[k] = NUT_LOST


def _fill_known(read, desk, k, hours, hours_before):
    """Fill in the known inputs at both ends of step k; return whether all are numbers.

    The error's reference, which comes after it, is the first ambient unless it is given.
    """
    ready, known_inputs, z_start, z_end = True, desk.z, desk.z_start, desk.z_end
    for q in range(known_inputs.shape[1]):
        before = known_inputs[k - 1, q] if k > 0 else desk.z_before[q]
        known_inputs[k, q] = desk.values[k, read.inputs[q]] if read.inputs[q] >= 0 else before
        if q == read.reference and isnan(known_inputs[k, q]):
            known_inputs[k, q] = known_inputs[k, read.ambient]
        z_end[k, q] = known_inputs[k, q] + read.shift_K[q] + hours * read.rate_K_h[q]
        start = before + read.shift_K[q] + hours_before * read.rate_K_h[q]
        z_start[k, q] = z_end[k, q] if isnan(start) else start
        ready = ready and isfinite(z_end[k, q])
    return ready


def _fill_laws(desk, k):
    """Fill in the heats by law over step k; one that was never known is that of standstill."""
    law = desk.law
    for j in range(law.shape[1]):
        before = law[k - 1, j] if k > 0 else desk.law_before_W[j]
        if isnan(law[k, j]):
            law[k, j] = 0.0 if isnan(before) else before
        if isnan(before):
            before = law[k, j]
        desk.law_W[k, j], desk.jump_W[k, j] = (before + law[k, j]) / 2, law[k, j] - before


def drive_frame(tick):
    """Fill in the inputs of one frame, and the state after it."""
    desk, inputs, moment = tick.desk, tick.inputs, tick.moment
    if isnan(moment[0]):
        moment[0] = desk.time_s[0]
    fill_inputs(tick.read, desk, moment[0], moment[1])
    moment[1] = desk.time_s[0]
    for j in range(len(desk.law_before_W)):
        desk.law_before_W[j] = desk.law[0, j]
    for q in range(len(desk.z_before)):
        desk.z_before[q] = desk.z[0, q]
    inputs.time_s[0], inputs.dt_s[0] = desk.time_s[0], tick.dt_s[0]
    for i in range(len(tick.nuts)):
        nut = tick.nuts[i]
        average_columns(nut.table, nut.desk, tick.dt_s, nut.path)


def watch_frame(tick):
    """Compare the ways of nuts with their speeds over one frame (see `selftest.compare_ways`)."""
    for i in range(len(tick.paths)):
        compare_ways(
            tick.paths[i], tick.travel_m[i], tick.state.motion[i : i + 1], tick.tested.motion[:, i],
            tick.inputs.degraded,
        )  # fmt: skip


def estimate_frame(tick):
    """Take the step of one frame, by the Kalman filter or by `tick.other`."""
    length_s = rint(tick.batch.inputs.dt_s[0] * TICKS_PER_S) / TICKS_PER_S
    if length_s != tick.length_s:
        tick.batch.table, tick.length_s = tick.table_of(length_s), length_s
    if tick.other is not None:
        tick.other()
    else:
        filter_steps(tick.batch, tick.running, tick.results, tick.work)
    tick.time_s[0] = tick.batch.inputs.time_s[0]
    if tick.step_bank is not None:
        if gather(tick.batch.inputs, 0, tick.gathered):
            tick.step_bank()
        put_bounds(tick.batch.plant, tick.batch.inputs, tick.results, 0, tick.bounds)
    if tick.finish is not None:
        tick.finish()


def step_frame(step, data):
    """Take a frame, stored as `data`, through drive, estimator and, if there is one, self-test.

    Stages without a kernel are called in Python. Returns a copy of the estimate.
    """
    drive, estimator, test = step.drive, step.estimator, step.test
    take_bytes(drive.octets, data)
    drive.before()
    drive_frame(drive)
    if drive.after is not None:
        drive.after()
    if test is not None:
        watch_frame(test)
    estimate_frame(estimator)
    if test is not None:
        run_selftest(
            test.tested,
            test.trust,
            test.state,
            estimator.results.quality,
            estimator.results.part_quality,
            test.scores,
        )
    return bytes_of(estimator.octets, len(estimator.octets))
