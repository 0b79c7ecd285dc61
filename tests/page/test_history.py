"""What is told of recordings: which there are, and the least and the most of each part of a span."""

from __future__ import annotations

import math

import numpy as np
import pytest

from observer.frames import Reading
from observer.page import history as subject
from observer.page.history import history, recordings
from observer.service.record import Recorder

CHANNELS = ("t1_degC", "nut_position_m")
RATE_HZ = 20
SECONDS = 600
START_S = 1199.975  # between two readings: none is on the edge of a part


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Ten minutes as the service records them: a slow temperature and a fast position, in blocks."""
    path = tmp_path_factory.mktemp("recordings")
    recorder = Recorder(path, "lathe-z", CHANNELS, 1e9, 5.0)
    for k in range(SECONDS * RATE_HZ):
        time_s = 1000.0 + k / RATE_HZ
        recorder.reading(Reading(time_s, {"nut_position_m": math.sin(time_s)}))
        if k % RATE_HZ == 0:
            recorder.reading(Reading(time_s, {"t1_degC": 20.0 + k / RATE_HZ}))
            recorder.tick(time_s)
    assert recorder.close(30.0)
    return path


def test_a_recording_has_its_first_and_last_time(folder):
    (found,) = recordings(folder, "lathe-z")
    assert found.from_s == 1000.0
    assert found.to_s == pytest.approx(1000.0 + SECONDS - 1 / RATE_HZ)
    assert recordings(folder, "mill-z") == []
    assert recordings(folder / "none", "lathe-z") == []


@pytest.mark.parametrize("block", [1 << 12, 1 << 16, 4 << 20])
def test_each_part_has_the_least_and_the_most_of_its_readings(folder, monkeypatch, block):
    monkeypatch.setattr(subject, "_BLOCK_BYTES", block)
    told = history(recordings(folder, "lathe-z"), START_S, START_S + 100.0, 50)
    time_s = 1000.0 + np.arange(SECONDS * RATE_HZ) / RATE_HZ
    part = np.floor((time_s - START_S) / 2.0)
    for k in range(50):
        position = np.sin(time_s[part == k])
        assert told["channels"]["nut_position_m"]["least"][k] == pytest.approx(position.min(), abs=1e-6)
        assert told["channels"]["nut_position_m"]["most"][k] == pytest.approx(position.max(), abs=1e-6)
        assert told["channels"]["t1_degC"]["least"][k] == 220.0 + 2 * k
        assert told["channels"]["t1_degC"]["most"][k] == 221.0 + 2 * k
    assert told["time_s"][0] == START_S + 1.0


def test_where_nothing_was_recorded_nothing_is_told(folder):
    told = history(recordings(folder, "lathe-z"), 1590.0, 1610.0, 20)
    assert told["channels"]["t1_degC"]["least"][9] == 619.0
    assert told["channels"]["t1_degC"]["least"][10:] == [None] * 10
    assert history(recordings(folder, "lathe-z"), 1e6, 2e6, 10)["channels"] == {}


@pytest.mark.parametrize(
    "span", [(2.0, 1.0, 5), (1.0, math.inf, 5), (math.nan, 1.0, 5), (1.0, 2.0, 0), (1.0, 2.0, 9999)]
)
def test_what_is_no_span_is_refused(span):
    with pytest.raises(ValueError, match="no span"):
        history([], *span)
