"""Calibration from logs with many rows a second."""

from __future__ import annotations

import numpy as np
import pytest

from observer.fit.calibrate import calibrate
from observer.fit.forward import Forward
from observer.fit.parameters import FILM, replaced
from observer.fit.runs import calibration_tick_s, prepare, thinned
from observer.frames import FrameBlock
from observer.model.build import build_plant
from observer.model.drive import Drive
from tests.logs.machines import machine
from tests.logs.simulated import frames, made_log, run_model

CHANGED = {FILM: 26.0, "source.heater.scale": 0.8}


def close_rows(every_s: float) -> FrameBlock:
    """Ten minutes: the heater on and off every 7 s, a row every so many seconds."""
    config = machine()
    truth = replaced(config, CHANGED)
    time_s = np.arange(0.0, 600.0, every_s)
    columns = {"heater_W": np.where(time_s % 14.0 < 7.0, 40.0, 0.0), "n_rpm": np.zeros_like(time_s)}
    blank = {s.channel: np.full_like(time_s, 20.0) for s in config.sensor}
    plant = build_plant(truth)
    log = frames(truth, time_s, columns | blank)
    _, rows = run_model(plant, Drive(truth, plant), log, 20.0)
    return frames(truth, time_s, columns | {s.channel: rows[:, i] for i, s in enumerate(config.sensor)})


def test_a_log_with_close_rows_is_predicted_in_ticks_as_row_by_row() -> None:
    config = machine()
    run = prepare(config, [close_rows(0.05)], "log")
    tick_s = calibration_tick_s([run])
    in_ticks, by_row = (Forward(config, [run], tick_s=s) for s in (tick_s, 0.0))
    steps = [len(forward.runs[0].ticks.first) for forward in (in_ticks, by_row)]
    assert steps == [300, 12_000]
    here, there = (forward(config)[0] for forward in (in_ticks, by_row))
    # blocks begin with the row at their start, ticks end with it: a row of 0.05 s makes a mean of 30 s 1/600
    assert np.max(np.abs(here - there)) < 2 / 600 * np.ptp(there)


def test_a_log_with_a_row_a_second_is_predicted_row_by_row() -> None:
    assert calibration_tick_s([prepare(machine(), [close_rows(1.0)], "log")]) == 0.0


def test_the_heat_of_a_log_with_close_rows_is_found() -> None:
    heater = calibrate(machine(), [[close_rows(0.1)]]).values["source.heater.scale"]
    assert abs(heater / 0.8 - 1.0) < 0.05


def test_thinned_frames_keep_their_time() -> None:
    log = close_rows(0.05)
    every_2_s = thinned(log, 2.0)
    assert len(every_2_s) == 300
    assert np.sum(every_2_s.dt_s[1:]) == pytest.approx(every_2_s.time_s[-1] - every_2_s.time_s[0])
    assert thinned(made_log(machine(), 1, minutes=10.0), 2.0).time_s[3] == 6.0


def test_thinned_frames_bring_the_readings_that_came_between_them() -> None:
    log = close_rows(0.1)
    comes = np.arange(len(log)) % 5 == 0
    log.fresh[:, :3] &= comes[:, None]
    assert thinned(log, 2.0).fresh.all()
