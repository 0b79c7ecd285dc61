"""From frames to inputs: a block cut anywhere gives the same, whatever is missing in it."""

from __future__ import annotations

import numpy as np

from observer.frames import FrameBlock, Inputs, Quality
from observer.kernels.codes import INPUT_LOST, NUT_LOST
from observer.model.build import build_plant
from observer.model.drive import Drive
from tests.bits.shared import frames_of
from tests.logs.machines import machine
from tests.logs.plants import described
from tests.logs.simulated import frames

ROWS = ("time_s", "dt_s", "values", "fresh", "quality", "age_s")
AIR_K_H, SENSOR_K_H, BIAS_K = 3.0, 2.0, 0.3
DRIFTS = [
    {"kind": "ambient_drift", "rate_K_h": AIR_K_H},
    {"kind": "sensor_bias", "target": "t1", "offset_K": BIAS_K},
    {"kind": "sensor_drift", "target": "t2", "rate_K_h": SENSOR_K_H},
]


def part(block: FrameBlock, k: int) -> FrameBlock:
    """One frame of a block."""
    return FrameBlock(block.channels, **{n: getattr(block, n)[k : k + 1] for n in ROWS}, path={})


def row_by_row(drive: Drive, block: FrameBlock) -> Inputs:
    """The inputs of a block that comes frame by frame."""
    state, single = drive.initial(), []
    for k in range(len(block.time_s)):
        state, inputs = drive.run(state, part(block, k))
        single.append(inputs)
    return Inputs.joined(single)


def of_log(time_s: np.ndarray, *, moving: bool = False) -> tuple[Drive, FrameBlock, dict[str, int]]:
    """A drive of a machine whose air and sensors drift, frames at these times, and where each channel is: the
    air's is the first.
    """
    screw = described(2, 2, 2)[0].screw.model_dump(exclude_unset=True) | {"expansion_1_K": 11.8e-6}
    air = {"channel": "ambient_degC"}
    config, plant = described(3, 2, 2, moving=moving, effect=DRIFTS, ambient=air, screw=screw)
    block = frames_of(config, len(time_s))
    order = sorted(range(len(block.channels)), key=lambda j: block.channels[j] != "ambient_degC")
    rows = {n: getattr(block, n)[:, order] for n in ("values", "quality", "age_s")}
    rows |= {"time_s": time_s, "dt_s": block.dt_s, "fresh": np.ones_like(block.fresh)}
    channels = tuple(block.channels[j] for j in order)
    names = {name: j for j, name in enumerate(channels)}
    return Drive(config, plant), FrameBlock(channels, **rows, path=block.path), names


def test_what_is_missing_in_a_block_is_held_as_if_it_came_row_by_row() -> None:
    config = machine()
    time_s = np.arange(8) * 0.5
    heat_W = np.array([np.nan, 5.0, 7.0, np.nan, np.nan, 9.0, np.nan, 0.0])
    columns = {"heater_W": heat_W, "n_rpm": np.full(8, 600.0)}
    block = frames(config, time_s, columns | {s.channel: np.full(8, 20.0) for s in config.sensor})
    drive = Drive(config, build_plant(config))
    _, whole = drive.run(drive.initial(), block)
    rows = row_by_row(drive, block)
    np.testing.assert_array_equal(rows.law_W, whole.law_W)
    np.testing.assert_array_equal(rows.law_jump_W, whole.law_jump_W)
    source = [s.name for s in config.source].index("heater")
    assert whole.law_W[0, source] == 0.0, "a law that was never known is that of standstill"
    assert whole.law_W[4, source] == 7.0  # the last one known, not that before the block


def test_what_drifts_does_so_by_the_hours_since_the_first_frame() -> None:
    """The log begins at an epoch's second; the error's reference, which is not given, is the first air."""
    time_s = 1.7e9 + np.array([0.0, 900.0, 1800.0, 1801.0, 7200.0])
    drive, block, at = of_log(time_s)
    air_degC = np.array([20.0, 20.5, 21.0, 21.0, 25.0])
    block.values[:, at["ambient_degC"]] = air_degC
    _, whole = drive.run(drive.initial(), block)
    state, single = drive.initial(), []
    for k in range(len(time_s)):
        state, inputs = drive.run(state, part(block, k))
        single.append(inputs)
    hours = np.array([0.0, 0.25, 0.5, 1801.0 / 3600.0, 2.0])
    # the air, what is added to each sensor, and the error's reference
    ends = np.column_stack([air_degC + AIR_K_H * hours, np.full(5, BIAS_K), SENSOR_K_H * hours, [20.0] * 5])
    for found in (whole, Inputs.joined(single)):
        np.testing.assert_allclose(found.z_end, ends, rtol=1e-12, atol=1e-12)
        np.testing.assert_allclose(found.z_start, [ends[0], *ends[:-1]], rtol=1e-12, atol=1e-12)


def test_air_that_is_not_known_at_first_begins_alike_wherever_the_log_is_cut() -> None:
    drive, block, at = of_log(900.0 * np.arange(6.0))
    air = at["ambient_degC"]
    block.values[:2, air], block.quality[:2, air] = np.nan, Quality.MISSING
    _, whole = drive.run(drive.initial(), block)
    rows = row_by_row(drive, block)
    np.testing.assert_array_equal(rows.z_start, whole.z_start)
    np.testing.assert_array_equal(rows.z_end, whole.z_end)
    assert np.isnan(whole.z_end[1, 0])
    assert whole.z_start[2, 0] == whole.z_end[2, 0]


def test_a_step_is_marked_by_what_it_lacks() -> None:
    drive, block, at = of_log(0.5 * np.arange(8.0), moving=True)
    nut, speed, first = at["nut_position_m"], at["screw_speed_rpm"], at["t1_degC"]
    block.quality[1:4, nut] = Quality.MISSING, Quality.STALE, Quality.REJECTED
    block.quality[3:6, speed] = Quality.MISSING, Quality.STALE, Quality.REJECTED
    block.quality[6, first] = Quality.STALE
    block.fresh[7, first] = False
    _, u = drive.run(drive.initial(), block)
    assert u.degraded.tolist() == [0, NUT_LOST, NUT_LOST, NUT_LOST, INPUT_LOST, INPUT_LOST, 0, 0]
    assert u.usable[:, 0].tolist() == [True] * 6 + [False] * 2
    assert u.usable[:, 1].all()
    assert u.quality[:, 0].tolist() == [0] * 6 + [Quality.STALE, 0]
    np.testing.assert_array_equal(u.y_degC[:, 0], block.values[:, first])
