"""From frames to inputs: a block cut anywhere gives the same, whatever is missing in it."""

from __future__ import annotations

import numpy as np

from observer.frames import FrameBlock, Inputs
from observer.model.build import build_plant
from observer.model.drive import Drive
from tests.discovery.cases import frames, machine


def part(block: FrameBlock, k: int) -> FrameBlock:
    """One frame of a block."""
    rows = ("time_s", "dt_s", "values", "fresh", "quality", "age_s")
    return FrameBlock(block.channels, **{n: getattr(block, n)[k : k + 1] for n in rows}, path={})


def test_what_is_missing_in_a_block_is_held_as_if_it_came_row_by_row() -> None:
    config = machine()
    time_s = np.arange(8) * 0.5
    heat_W = np.array([np.nan, 5.0, 7.0, np.nan, np.nan, 9.0, np.nan, 0.0])
    columns = {"heater_W": heat_W, "n_rpm": np.full(8, 600.0)}
    block = frames(config, time_s, columns | {s.channel: np.full(8, 20.0) for s in config.sensor})
    drive = Drive(config, build_plant(config))
    _, whole = drive.run(drive.initial(), block)
    state, single = drive.initial(), []
    for k in range(8):
        state, inputs = drive.run(state, part(block, k))
        single.append(inputs)
    rows = Inputs.joined(single)
    np.testing.assert_array_equal(rows.law_W, whole.law_W)
    np.testing.assert_array_equal(rows.law_jump_W, whole.law_jump_W)
    source = [s.name for s in config.source].index("heater")
    assert whole.law_W[4, source] == 7.0  # the last one known, not that before the block
