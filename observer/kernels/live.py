"""The way of one reading and one tick, on records that live on from tick to tick.

The same kernels as over whole logs, one call a stage: what they work on is handed over as a record, whose
memory belongs to the part that takes the steps.
"""

from __future__ import annotations

from observer.kernels.bank import gather, put_bounds
from observer.kernels.codes import NO_PRODUCT, OF_NOTHING, OF_SPEED, TICKS_PER_S
from observer.kernels.drive import fill_inputs
from observer.kernels.kalman import filter_steps
from observer.kernels.libm import isnan, rint
from observer.kernels.moving import average_columns
from observer.kernels.octets import bytes_of, take_bytes
from observer.kernels.selftest import compare_ways, run_selftest
from observer.kernels.walk import walk_rows


def put_reading(own, time_s, late_s, values):
    """Have the values of a reading wait as a row; return how many are floats of channels, -1 without room."""
    rows, row, taken = own.rows, own.waiting, 0
    if row == len(rows.time_s):
        return -1
    rows.time_s[row], rows.late_s[row] = time_s, late_s
    for j in range(len(own.names)):
        rows.present[row, j] = False
        if own.names[j] in values:
            value = values[own.names[j]]
            rows.values[row, j], rows.present[row, j], rows.faulted[row, j] = value, True, False
            taken += type(value) is float
    own.waiting = row + 1
    return taken


def walk_on(rows, count, plan, memory, frames):
    """Walk over the first rows (see `walk.walk_rows`)."""
    for p in range(len(frames.end)):
        frames.end[p] = 0
    walk_rows(
        rows.time_s[:count], rows.late_s, rows.step, rows.values, rows.present, rows.faulted, plan, memory,
        frames.time_s, frames.dt_s, frames.values, frames.fresh, frames.quality, frames.age_s, frames.samples,
        frames.offset, frames.end, frames.counts,
    )  # fmt: skip


def tick_on(own, time_s):
    """Walk over the rows that wait and a tick behind them; return its frame for good, None without room."""
    rows, count = own.rows, own.waiting
    if count == len(rows.time_s):
        return None
    rows.time_s[count], rows.late_s[count], rows.step[count] = time_s, 0.0, True
    for j in range(rows.present.shape[1]):
        rows.present[count, j] = False
    walk_on(rows, count + 1, own.plan, own.memory, own.frames)
    rows.step[count], own.waiting = False, 0
    return bytes_of(own.octets, len(own.octets))


def drive_on(read, desk, begin_s, last_s):
    """Fill in the inputs (see `drive.fill_inputs`)."""
    fill_inputs(
        read, desk.time_s, desk.values, desk.fresh, desk.quality, desk.law_before_W, desk.z_before, begin_s,
        last_s, desk.law, desk.known, desk.z_start, desk.z_end, desk.law_W, desk.jump_W, desk.y_degC,
        desk.usable, desk.sensor_quality, desk.degraded,
    )  # fmt: skip


def average_on(nut, desk, dt_s, sample_s, sample_m, offset, driven_m_s):
    """Average a nut's columns (see `moving.average_columns`)."""
    average_columns(
        desk.scalars, desk.weight_s, desk.B, desk.C, desk.sum_B, desk.sum_C, dt_s, sample_s, sample_m, offset,
        driven_m_s, desk.out_B, desk.out_C, nut.mu_1_m, nut.phase, nut.scale, nut.conductance_W_m, nut.nut_m,
        nut.screw_m, nut.stroke_m, nut.lag, nut.lag_decay_1_s, nut.table_C, nut.mean_B, nut.mean_C,
        nut.turn, desk.step_B, desk.step_C,
    )  # fmt: skip


def put_products(laws, values, law):
    """Fill in the heats at a tick of the laws that are products (see `observer.model.law.Product`)."""
    for j in range(len(laws.base)):
        if laws.base[j] == NO_PRODUCT:
            continue
        heat_W = 1.0 if laws.base[j] == OF_NOTHING else values[0, laws.column[j]]
        if laws.base[j] == OF_SPEED:
            heat_W = abs(heat_W)
        for f in range(laws.factors.shape[1]):
            heat_W = laws.factors[j, f] * heat_W
        law[0, j] = heat_W


def drive_frame(own):
    """Fill in the inputs of one frame, and the state after it."""
    desk, inputs, moment = own.desk, own.inputs, own.moment
    put_products(own.laws, desk.values, desk.law)
    if isnan(moment[0]):
        moment[0] = desk.time_s[0]
    drive_on(own.read, desk, moment[0], moment[1])
    moment[1] = desk.time_s[0]
    for j in range(len(desk.law_before_W)):
        desk.law_before_W[j] = desk.law[0, j]
    for q in range(len(desk.z_before)):
        desk.z_before[q] = desk.known[0, q]
    inputs.time_s[0], inputs.dt_s[0] = desk.time_s[0], own.dt_s[0]
    for i in range(len(own.nuts)):
        nut = own.nuts[i]
        average_on(
            nut.table, nut.desk, own.dt_s, nut.path.time_s, nut.path.position_m, nut.path.offset,
            nut.path.driven_m_s,
        )  # fmt: skip


def watch_frame(own):
    """Compare the ways of nuts with their speeds over one frame (see `selftest.compare_ways`)."""
    for i in range(len(own.paths)):
        path = own.paths[i]
        compare_ways(
            path.time_s, path.position_m, path.offset, path.driven_m_s, own.strokes_m[i], own.state.motion[i],
            own.seen.motion[:, i], own.seen.motion[:, len(own.paths) + i], own.inputs.degraded,
        )  # fmt: skip


def estimate_frame(own):
    """Take the step of one frame: by the Kalman filter, unless `own.other` takes it."""
    length_s = rint(own.inputs.dt_s[0] * TICKS_PER_S) / TICKS_PER_S
    if length_s != own.length_s:
        own.table, own.length_s = own.table_of(length_s), length_s
    if own.other is not None:
        own.other()
    else:
        filter_steps(
            own.plant, own.table, own.inputs, own.step, own.running, own.gate_sigma, own.results, own.work
        )
    own.time_s[0] = own.inputs.time_s[0]
    if own.step_bank is not None:
        if gather(own.inputs, 0, own.gathered):
            own.step_bank()
        put_bounds(own.results, 0, own.held, own.sigmas)
    if own.finish is not None:
        own.finish()


def step_frame(own, data):
    """Take a frame, kept as `data`, through drive, estimator and, if there is one, self-test.

    What only Python can do is called on the way. Returns the estimate for good.
    """
    drive, estimator, test = own.drive, own.estimator, own.test
    take_bytes(drive.octets, data)
    if drive.before is not None:
        drive.before()
    drive_frame(drive)
    if drive.after is not None:
        drive.after()
    if test is not None:
        watch_frame(test)
    estimate_frame(estimator)
    if test is not None:
        run_selftest(test.seen, test.trust, test.state, estimator.results.quality, test.scores)
    return bytes_of(estimator.octets, len(estimator.octets))
