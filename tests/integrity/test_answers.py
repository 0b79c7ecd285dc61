"""Held readings are not good, a machine at rest is, and heats keep their bound where a law changes."""

import numpy as np
import pytest

from campaigns.integrity.catalogue import LISTED
from campaigns.integrity.days import FAULT_S, day_of
from campaigns.integrity.judge import OUT, RIG, faulty, verdict
from observer.estimators.answers import SensorAnswers, answers_of
from observer.frames import EstimateQuality
from tests.learning.cover import FROM_S, estimates
from tests.learning.machines import Day, Rough, config_of, draw, work
from tests.truth.machine.cycles import Phase
from tests.truth.machine.machine import SENSORS, stream

SEED, TUNED_SEED = 61_000, 12_300
"""Of machines that are tried here alone, and of those that the bound was tuned on."""
REST = (Phase(4000), *(Phase(seconds, 300.0 * (seconds < 60), 0.2, 0.3) for seconds in (4, 900) * 4))
"""A cold machine that is jogged for four seconds each quarter of an hour."""
LAW_CHANGES_S = 5400.0
"""When the speed of machines changes that are at work while the fault begins."""
WRONG = 0.10
"""Of the good steps of one machine, beyond 3 σ: twice what the campaign asks of twelve."""


def held(name: str, number: int):
    """The estimates and the day of a machine, some of whose readings are held."""
    day, fault = day_of(number, seed=SEED), LISTED[f"{name} held, with noise"]
    return estimates(config_of(RIG), faulty(day, fault, number)), day, fault


@pytest.mark.parametrize("number", [29, 37])
def test_heats_stay_within_their_bound_when_a_law_has_just_changed(number):
    day = day_of(number, seed=TUNED_SEED)
    day = Day(*(column[day.time_s < FROM_S + 60.0] for column in day))
    block = estimates(config_of(RIG), day)
    changed = (day.time_s >= FROM_S) & (block.quality == EstimateQuality.GOOD)
    assert changed.sum() > 30
    off_W = np.abs(block.heat_W - day.heat_W)
    assert np.all(off_W[changed] <= block.heat_bound_W[changed])


@pytest.mark.parametrize("number", [1, 5])
def test_held_readings_of_all_sensors_are_not_good_once_the_heats_ask_for_an_answer(number):
    block, day, fault = held("all", number)
    result = verdict(block, day, fault)
    assert result.wrong <= WRONG * result.good
    assert not np.any(block.quality[day.time_s > LAW_CHANGES_S + 120.0] == EstimateQuality.GOOD)


@pytest.mark.parametrize("name", ["t1", "t5"])
def test_a_held_sensor_is_named_and_stays_out_and_what_is_good_is_right(name):
    block, day, fault = held(name, 2)
    result = verdict(block, day, fault)
    assert (result.named, result.right) == (name, "yes")
    out = block.sensor_quality[:, SENSORS.index(name)] == OUT
    assert np.all(out[np.argmax(out) :])
    assert result.good > 0.5 * result.steps
    assert result.wrong <= WRONG * result.good


def test_a_machine_at_rest_asks_its_sensors_for_no_answer():
    rng = stream(SEED, "rest", "0")
    day = work(draw(SEED, 0, Rough()), REST, 0.2, rng, 0.0)
    block = estimates(config_of(RIG), day)
    late = day.time_s >= FAULT_S
    assert np.all(block.quality[late] == EstimateQuality.GOOD)
    assert not np.any(block.sensor_quality[late] == OUT)


def test_a_sensor_that_sends_nothing_is_not_taken_for_one_that_does_not_answer():
    answers = SensorAnswers.empty(2, 1)
    for step in range(120):
        rising_K = np.full((10, 2), 0.05 * step)
        answers.note(np.array([20.0 + 0.05 * step, np.nan if step > 5 else 20.0]), rising_K)
        answers.note_laws(np.array([40.0 if step > 5 else 0.0]), np.array([1.0]), 5.0)
        answers.judge(*answers_of(np.full(2, 0.05)), np.zeros((120, 2, 1)))
        assert not answers.silent[0]
    assert answers.since[1] == 120.0
    assert not answers.silent[1]


@pytest.mark.parametrize(("response_K_W", "silent"), [(0.0, True), (0.05, True), (0.5, False)])
def test_a_prediction_within_what_its_heats_leave_open_asks_no_single_sensor(response_K_W, silent):
    """A prediction moves by 6 K in ten minutes, from a heat known to 10 W; one reading is constant."""
    answers, step_K = SensorAnswers.empty(2, 1), 0.05
    for step in range(240):
        answers.note(np.array([20.0, 20.0 + step_K * step]), np.full((10, 2), 20.0 + step_K * step))
        answers.note_laws(np.array([90.0 if step > 5 else 0.0]), np.array([10.0]), 5.0)
        answers.judge(*answers_of(np.full(2, 0.05)), np.full((120, 2, 1), response_K_W))
    assert answers.silent.tolist() == [float(silent), 0.0]


def test_a_prediction_that_has_not_begun_asks_for_no_answer():
    """Each minute one more begins; those that wait stand at 0 °C, which warms to the air's temperature."""
    answers = SensorAnswers.empty(2, 1)
    for step in range(120):
        waiting_degC = np.where(step > 12 * np.arange(10), 20.0, 0.05 * step)[:, None]
        answers.note(np.full(2, 20.0), np.broadcast_to(waiting_degC, (10, 2)))
        answers.note_laws(np.array([90.0 if step > 5 else 0.0]), np.array([10.0]), 5.0)
        answers.judge(*answers_of(np.full(2, 0.05)), np.zeros((120, 2, 1)))
        assert not answers.silent.any()
