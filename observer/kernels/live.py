"""The way of a tick to its inputs, on records that live on from tick to tick.

The same kernels as over whole logs, but what they work on is handed over as three or four records instead of
some fifty arrays, and lives as long as what it belongs to.
"""

from __future__ import annotations

from observer.kernels.drive import fill_inputs
from observer.kernels.moving import average_columns
from observer.kernels.walk import walk_rows


def walk_on(rows, count, plan, memory, frames):
    """Walk over the first rows (see `walk.walk_rows`)."""
    for p in range(len(frames.end)):
        frames.end[p] = 0
    walk_rows(
        rows.time_s[:count], rows.late_s, rows.step, rows.values, rows.present, rows.faulted, plan, memory,
        frames.time_s, frames.dt_s, frames.values, frames.fresh, frames.quality, frames.age_s, frames.samples,
        frames.offset, frames.end, frames.counts,
    )  # fmt: skip


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
