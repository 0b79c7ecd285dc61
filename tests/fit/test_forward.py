"""Predictions of logs, row by row and in ticks, and what they begin with and refuse."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from observer.align.aligner import AlignPlan, frames_of_log
from observer.config.machine import Config
from observer.config.sections import Node
from observer.errors import LogError
from observer.files.logs import Log
from observer.fit.calibrate import calibrate
from observer.fit.forward import Forward
from observer.fit.parameters import FILM, replaced
from observer.fit.runs import calibration_tick_s, joined, prepare, thinned
from observer.frames import FrameBlock, Quality
from observer.installation import parse
from observer.model.build import build_plant
from observer.model.drive import Drive
from observer.model.simulate import start_from_sensors
from tests.logs.machines import SCREW, machine, rig
from tests.logs.simulated import frames, made_log, run_model, simulated_rows

CHANGED = {
    "surface.convection_W_m2K": 12.0,
    "source.nut.share": 0.7,
    "source.left_bearing.scale": 1.3,
    "source.right_bearing.heat_W_rpm": 0.002,
}


def test_the_sum_of_responses_is_the_simulation() -> None:
    config, blocks = rig()
    run = prepare(config, blocks, "log")
    changed = replaced(config, CHANGED)
    # the same number of modes in both: the predictor keeps that of the configuration it was made for
    plant = build_plant(config)
    model = changed.model.model_copy(update={"modes": plant.modes - plant.bent})
    changed = changed.model_copy(update={"model": model})
    rows = simulated_rows(changed, run)[1]
    [predicted] = Forward(config, [run], tick_s=0.0)(replaced(config, CHANGED))
    # sums of the same numbers in another order: rounding of temperatures of 50 °C over 2e4 steps
    np.testing.assert_allclose(predicted, run.means(rows), rtol=0, atol=1e-9)


def test_the_sum_of_responses_is_the_simulation_beside_a_network_and_an_effect_that_heats() -> None:
    """What links and effects add to the sources belongs to the machine, not to the laws that are fitted."""
    bare = machine()
    block, heater = Node(name="block", capacity_J_K=300.0), bare.source[0].name
    config = parse(
        bare.model_dump(exclude_unset=True)
        | {
            "node": [block.model_dump()],
            "link": [{"between": ["block", heater], "conductance_W_K": 2.0}],
            "source": [
                s.model_dump(exclude_unset=True) | ({"nodes": {"block": 1.0}} if s.name == heater else {})
                for s in bare.source
            ],
            "effect": [{"kind": "motor_heat", "target": "right", "heat_W": 3.0}],
            "model": {"modes": 12},
        }
    )
    log = made_log(bare, seed=2, minutes=10.0)
    run = prepare(config, [log], "log")
    assert len(build_plant(config).source_names) == len(config.source) + 2
    rows = simulated_rows(config, run)[1]
    [predicted] = Forward(config, [run], tick_s=0.0)(config)
    np.testing.assert_allclose(predicted, run.means(rows), rtol=0, atol=1e-9)


def test_blocks_of_frames_join_to_the_whole_log() -> None:
    _, blocks = rig()
    assert len(blocks) > 1
    whole = joined(blocks)
    samples_s, samples_m, offset, *_ = whole.path["nut_position_m"]
    assert len(offset) == len(whole) + 1 == sum(map(len, blocks)) + 1
    column = whole.channels.index("nut_position_m")
    # one sample a row in this log, so the newest sample of each step is the row's own
    np.testing.assert_array_equal(samples_s[offset[1:] - 1], whole.time_s)
    np.testing.assert_array_equal(samples_m[offset[1:] - 1], whole.values[:, column])


def test_means_leave_out_what_is_not_usable() -> None:
    config = machine()
    log = made_log(config, seed=1, minutes=10.0)
    log.values[7:9, 0] = np.nan
    log.values[9:13, 0] = 900.0
    log.fresh[7:13, 0] = False
    log.quality[7:13, 0] = [1, 1, 3, 3, 3, 3]
    run = prepare(config, [log], "log")
    used = [*range(7), 13, 14]  # a row every 2 s
    assert run.count[0, 0] == len(used)
    assert run.measured_degC[0, 0] == pytest.approx(np.mean(log.values[used, 0]), abs=1e-12)
    rows = np.random.default_rng(1).normal(size=(len(log), 3))
    assert run.means(rows)[0, 0] == pytest.approx(np.mean(rows[used, 0]), abs=1e-12)
    assert run.means(rows)[1, 0] == pytest.approx(np.mean(rows[15:30, 0]), abs=1e-12)


def test_what_a_stuck_sensor_showed_before_it_was_known_to_be_stuck_is_left_out() -> None:
    """A log can be read backwards: the whole stretch of equal values goes, and nothing before it."""
    config = machine()
    log = made_log(config, seed=1, minutes=10.0)
    log.values[100:200, 1] = log.values[100, 1]
    log.quality[130:200, 1] = int(Quality.REJECTED)
    log.fresh[130:200, 1] = False
    run = prepare(config, [log], "log")
    assert run.usable[:100, 1].all()
    assert not run.usable[100:200, 1].any()
    assert run.usable[200:, 1].all()
    assert run.usable[:, [0, 2]].all()


# ---- calibration from logs with many rows a second ----


CLOSE = {FILM: 26.0, "source.heater.scale": 0.8}


def close_rows(every_s: float) -> FrameBlock:
    """Ten minutes: the heater on and off every 7 s, a row every so many seconds."""
    config = machine()
    truth = replaced(config, CLOSE)
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


# ---- a prediction keeps what a nut's path makes of the modes; for other modes it is made anew ----


TIME_S = np.arange(0.0, 1800.0)


def tied_to_a_body(film_W_m2K: float) -> Config:
    """A screw of two diameters whose moving nut is tied to a body: its modes change with the film."""
    section = {"from_m": 0.0, "to_m": 0.15, "diameter_m": 0.012}
    return machine(
        screw=SCREW | {"length_m": 0.4, "diameter_m": 0.02, "section": [section]},
        surface={"convection_W_m2K": film_W_m2K},
        node=[{"name": "body", "capacity_J_K": 400.0}],
        link=[
            {"between": ["body", "nut"], "conductance_W_K": 8.0},
            {"between": ["body", "ambient"], "conductance_W_K": 0.5},
        ],
        source=[
            {"name": "nut", "shape": "nut", "length_m": 0.05, "stroke_m": [0.08, 0.32],
             "position_channel": "x_m", "speed_channel": "n_rpm", "torque_Nm": 0.3},
        ],
    )  # fmt: skip


def forward_of(config: Config) -> Forward:
    columns = {s.channel: np.full_like(TIME_S, 20.0) for s in config.sensor}
    columns |= {"n_rpm": np.full_like(TIME_S, 1000.0), "x_m": 0.2 + 0.12 * np.sin(2 * np.pi * TIME_S / 40.0)}
    log = Log(Path("run.csv"), TIME_S, tuple(columns), np.column_stack(list(columns.values())))
    return Forward(config, [prepare(config, list(frames_of_log(log, AlignPlan.of(config))), "log")])


def test_a_screw_with_sections_is_predicted_alike_after_other_films() -> None:
    before, after = tied_to_a_body(20.0), tied_to_a_body(40.0)
    used, unused = forward_of(before), forward_of(before)
    used(before)
    # both share the lag's tables of the first film; shapes of its modes would be 4.6 K off
    np.testing.assert_allclose(used(after)[0], unused(after)[0], atol=1e-3)


# ---- what a prediction begins with ----


PRESCRIBED = {"left": {"kind": "prescribed", "channel": "left_degC"}}


def _z(plant, temperature_degC):
    return np.where(np.array(plant.known_names) == "reference", 0.0, temperature_degC)


@pytest.mark.parametrize("boundary", [{}, PRESCRIBED])
def test_a_screw_at_one_temperature_starts_at_it_everywhere(boundary) -> None:
    plant = build_plant(machine(boundary=boundary))
    state = start_from_sensors(plant, np.full(3, 31.0), np.full(3, 1e-4), np.zeros(2), _z(plant, 31.0))
    rows = plant.rows.C @ state + plant.rows.F @ _z(plant, 31.0)
    np.testing.assert_allclose(rows, 31.0, atol=1e-6)  # the steady field's closed forms, rounded


def test_the_start_agrees_with_the_sensors_and_is_smooth_between_them() -> None:
    plant = build_plant(machine())
    y_degC = np.array([20.0, 26.0, 23.0])
    state = start_from_sensors(plant, y_degC, np.full(3, 1e-6), np.zeros(2), _z(plant, 20.0))
    rows = plant.rows.C @ state + plant.rows.F @ _z(plant, 20.0)
    np.testing.assert_allclose(rows[:3], y_degC, atol=1e-2)  # ten standard deviations of the noise given
    assert rows[3:].min() > 18.0
    assert rows[3:].max() < 28.0


def test_a_sensor_without_a_value_takes_no_part() -> None:
    plant = build_plant(machine())
    law_W, R = np.array([3.0, 1.0]), np.full(3, 1e-3)
    y_degC = np.array([20.0, 26.0, 23.0])
    rows = replace(plant.rows, C=plant.rows.C[[0, 2]], F=plant.rows.F[[0, 2]], sensors=2)
    two = replace(plant, rows=rows, thermal=plant.thermal[[0, 2]])
    masked = start_from_sensors(plant, np.where([1, 0, 1], y_degC, np.nan), R, law_W, _z(plant, 20.0))
    without = start_from_sensors(two, y_degC[[0, 2]], R[:2], law_W, _z(plant, 20.0))
    np.testing.assert_allclose(masked, without, rtol=1e-12)
    with pytest.raises(ValueError, match="no thermocouple"):
        start_from_sensors(plant, np.full(3, np.nan), R, law_W, _z(plant, 20.0))


# ---- what is refused of a log before anything is fitted to it ----


@pytest.mark.parametrize("channel", ["heater_W", "n_rpm"])
def test_a_log_without_what_gives_a_heat_is_refused(channel: str) -> None:
    """No heat would be another one, and whatever the machine did would be missing from the model."""
    config = machine()
    log = made_log(config, 1)
    values = log.values.copy()
    values[:, log.channels.index(channel)] = np.nan
    with pytest.raises(LogError, match=f"^log 1: {channel}, an input of a heat law, has no value; fix that"):
        prepare(config, [replace(log, values=values)], "log 1")
    values[10, log.channels.index(channel)] = 1.0
    prepare(config, [replace(log, values=values)], "log 1")
