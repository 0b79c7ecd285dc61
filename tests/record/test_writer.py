"""The thread that writes steps: it packs closed hours, and waits for a disk that refuses."""

from __future__ import annotations

import math

import numpy as np
import pytest

from observer.frames import EstimateBlock, FrameBlock
from observer.record.step_columns import StepSource
from observer.record.step_files import step_files
from observer.record.step_store import Past
from observer.service.observers import Step
from observer.service.past_writer import PastWriter
from tests.patience import PATIENCE_S, until
from tests.record.made import LAYOUT

pytestmark = pytest.mark.system
HOUR_S = 1.7e9 // 3600 * 3600


def _step(sequence: int, time_s: float) -> Step:
    """A step of one channel whose values are its number."""
    value, codes = np.array([[float(sequence)]]), np.zeros((1, 1), np.int8)
    time = np.array([time_s])
    frame = FrameBlock(("t1_degC",), time, time * 0.0, value, codes == 0, codes, value * 0.0, {})
    curve = np.zeros((1, len(LAYOUT.position_m)))
    block = EstimateBlock(
        time, value, value, curve, curve, curve, curve, value, codes, np.zeros(1, np.int8), value, value
    )
    return Step(frame, None, block, sequence)


@pytest.fixture
def writer(tmp_path):
    source = StepSource(LAYOUT, ("t1_degC",), {"hash": "abc", "instance": "00000001"})
    writer = PastWriter(tmp_path / "recordings", "lathe-z", source)
    yield writer
    writer.finish(None)
    assert writer.finished(PATIENCE_S) is None


def test_every_step_is_written_and_a_closed_hour_is_packed(writer, tmp_path):
    past = Past(tmp_path / "recordings", "lathe-z")
    times_s = HOUR_S + np.arange(-5.0, 5.0)
    writer.begin()
    for sequence, time_s in enumerate(times_s):
        writer.follow(_step(sequence, time_s))
        until(lambda time_s=time_s: past.span_s()[1] == time_s)
    until(lambda: [file.is_packed for file in past.files()] == [True, False])
    columns = past.columns(["t1_degC", "heat_nut_W"], -math.inf, math.inf)
    np.testing.assert_array_equal(columns["time_s"], times_s)
    np.testing.assert_array_equal(columns["t1_degC"], np.arange(10.0))
    np.testing.assert_array_equal(columns["heat_nut_W"], np.arange(10.0))
    assert writer.notices() == ()


def test_steps_wait_while_the_disk_refuses_them(writer, tmp_path):
    folder = tmp_path / "recordings"
    folder.write_text("a file where the folder should be")
    writer.begin()
    writer.follow(_step(0, HOUR_S))
    (notice,) = until(writer.notices)
    assert "published steps cannot be written" in notice
    writer.follow(_step(1, HOUR_S + 1.0))
    folder.unlink()
    until(lambda: writer.notices() == ())
    assert len(step_files(folder, "lathe-z")) == 1
    assert Past(folder, "lathe-z").span_s() == (HOUR_S, HOUR_S + 1.0)
