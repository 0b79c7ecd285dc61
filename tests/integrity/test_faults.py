"""Each fault does to readings what its name says, to its own sensors alone, and to nothing before it."""

from types import SimpleNamespace

import numpy as np
import pytest

from campaigns.integrity import faults as of
from campaigns.integrity import trial
from campaigns.integrity.catalogue import LISTED, NEW_PROGRAM, NONE, Fault
from campaigns.integrity.days import FAULT_S, day_of, with_new_stroke
from campaigns.integrity.faults import Readings
from campaigns.integrity.judge import OUT, faulty, verdict
from campaigns.integrity.promise import short_of
from campaigns.integrity.rates import rates
from campaigns.resumable import read_rows
from observer.frames import EstimateBlock, EstimateQuality
from tests.learning.cover import estimates
from tests.learning.machines import config_of
from tests.truth.machine.cycles import Phase
from tests.truth.machine.machine import SENSORS

ROWS = 3600


@pytest.fixture
def readings():
    """An hour of five sensors at 20, 30, … °C in air at 20 °C, with noise."""
    rng = np.random.default_rng(1)
    value = np.arange(20.0, 70.0, 10.0) + 0.05 * rng.standard_normal((ROWS, 5))
    return Readings(np.arange(ROWS) * 1.0, of.written(value), np.full(ROWS, 0.3), np.full(ROWS, 20.0))


@pytest.fixture
def changed(readings):
    """By how much a change moves each reading."""

    def by(change):
        after = change(readings, np.random.default_rng(2))
        assert after.since_s is readings.since_s
        return after.sensor_degC - readings.sensor_degC

    return by


@pytest.mark.parametrize("fault", LISTED.values(), ids=lambda fault: fault.name)
def test_a_fault_changes_what_its_name_says_and_only_from_its_time_on(fault: Fault):
    day = day_of(1)
    after = faulty(day, fault, 1)
    early = day.time_s < FAULT_S
    moved = np.any(after.sensor_degC != day.sensor_degC, axis=0)
    assert {n for n, m in zip(SENSORS, moved, strict=True) if m} == set(fault.sensors)
    assert np.any(after.nut_m != day.nut_m) == (fault.group == "nut position")
    assert np.any(after.air_degC != day.air_degC) == (fault.group == "ambient")
    for name in day._fields:
        np.testing.assert_array_equal(getattr(after, name)[early], getattr(day, name)[early])


def test_a_drift_goes_up_by_its_rate_and_no_further_than_its_most(changed):
    by = changed(of.drift(("t2",), 18.0, 3.0))[:, 1]
    np.testing.assert_allclose(by[[0, 200, 600, -1]], [0.0, 1.0, 3.0, 3.0], atol=1e-9)


def test_a_gain_takes_its_part_of_the_rise_above_the_air(changed):
    np.testing.assert_allclose(changed(of.gain(SENSORS, 0.85))[5], [0, -1.5, -3.0, -4.5, -6.0], atol=0.05)


def test_a_held_sensor_keeps_its_value_and_its_noise():
    ramp = Readings(
        np.arange(ROWS) * 1.0, np.linspace(20, 40, ROWS)[:, None] + np.zeros(5), *np.zeros((2, ROWS))
    )
    value = of.held(("t3",))(ramp, np.random.default_rng(2)).sensor_degC[:, 2]
    assert np.mean(value) == pytest.approx(20.0, abs=0.05)
    assert np.std(value) == pytest.approx(0.05, rel=0.1)


def test_noise_grows_by_its_factor(readings):
    value = of.noisy(("t3",), 10.0)(readings, np.random.default_rng(2)).sensor_degC
    assert np.std(value[:, 2]) == pytest.approx(0.5, rel=0.1)


def test_coarse_steps_are_whole_kelvins(readings):
    value = of.coarse(("t3",), 1.0)(readings, np.random.default_rng(2)).sensor_degC
    np.testing.assert_array_equal(value[:, 2], np.round(value[:, 2]))


def test_spikes_and_what_comes_and_goes_are_there_for_their_time(changed):
    assert np.sum(changed(of.spikes(("t1",), 5.0, 60.0)) > 4.0) == ROWS / 60
    there = changed(of.now_and_then(("t1",), 3.0, 120.0, 300.0))[:, 0] > 2.0
    np.testing.assert_array_equal(there[:420], np.arange(420) < 120)


def test_a_new_program_has_other_strokes_from_the_fault_on_and_the_same_length():
    phases = (Phase(3000, 1000, 0.2, 0.8), Phase(3000, 2000, 0.3, 0.7), Phase(100))
    after = with_new_stroke(phases)
    assert [(p.duration_s, p.speed_rpm) for p in after] == [
        (3000, 1000),
        (1000, 2000),
        (2000, 2000),
        (100, 0),
    ]
    assert (after[1].low_m, after[1].high_m) == (0.3, 0.7)
    assert (after[2].low_m, after[2].high_m) == pytest.approx((0.35, 0.6))


@pytest.fixture(scope="module")
def judged_before():
    """A day with an offset of all sensors, and the estimates of it."""
    day, fault = day_of(1), LISTED["all +4 K"]
    unscreened = config_of(more="\n[integrity]\nenabled = false\n")
    return day, fault, estimates(unscreened, faulty(day, fault, 1))


def _columns(block):
    return {name: getattr(block, name) for name in EstimateBlock.__dataclass_fields__}


def _with_quality(block, quality):
    return EstimateBlock(**_columns(block) | {"quality": quality})


def test_only_values_marked_good_count_as_wrong(judged_before):
    day, fault, block = judged_before
    steps = int((day.time_s >= FAULT_S).sum())
    all_good = verdict(_with_quality(block, np.zeros(len(block), np.int8)), day, fault)
    none_good = verdict(_with_quality(block, np.full(len(block), EstimateQuality.DEGRADED)), day, fault)
    assert (all_good.steps, all_good.good) == (steps, steps)
    assert all_good.wrong > 0.9 * steps
    assert all_good.bad_s is None
    assert (none_good.good, none_good.wrong, none_good.bad_s, none_good.again_s) == (0, 0, 0.0, None)


def test_the_truth_itself_is_never_wrong(judged_before):
    day, fault, block = judged_before
    truth = {name: getattr(day, name) for name in ("heat_W", "field_degC", "error_um")}
    right = EstimateBlock(**_columns(block) | truth)
    found = verdict(right, day, fault)
    assert (found.wrong, found.sigmas, found.worst_um) == (0, 0.0, 0.0)


AS_PROMISED = {
    "steps": "1000", "good": "1000", "wrong": "10", "beyond": "5", "out": "0", "half_um": "3",
    "bound_um": "9", "bad_s": "5", "named_s": "5", "right": "yes",
}  # fmt: skip


@pytest.mark.parametrize(
    ("name", "cells", "words"),
    [
        ("t3 +1 K", {}, ""),
        ("t3 +1 K", {"wrong": "11"}, "beyond 3 σ"),
        ("t3 +1 K", {"beyond": "6"}, "beyond the bound"),
        ("t3 +1 K", {"beyond": ""}, "no estimate has a bound"),
        ("all +1 K/h", {"wrong": "1000"}, ""),
        (NONE, {"good": "969", "wrong": "0", "beyond": "0"}, "96.9 % good"),
        (NONE, {}, "beyond the bound on 1 of 1"),
        (NONE, {"beyond": "0", "out": "1"}, "taken out"),
        (NONE, {"beyond": "0", "bound_um": "9.1"}, "interval"),
        (NEW_PROGRAM, {"beyond": "0"}, ""),
    ],
)
def test_what_falls_short_of_the_promise_is_said(name, cells, words):
    found = short_of([{"fault": name} | AS_PROMISED | cells])
    assert len(found) == bool(words)
    assert not words or words in found[0]


def test_the_page_has_the_table_of_the_rows_that_are_kept():
    assert rates(read_rows(trial.RESULTS)) in trial.PAGE.read_text(encoding="utf-8")


@pytest.mark.parametrize(
    ("out", "named", "right"),
    [
        ({}, "", "no"),
        ({"t2": 10, "t3": 50}, "t2 t3", "yes"),
        ({"t2": 10, "t3": 80}, "t2", "part"),
        ({"t2": 10, "t5": 12}, "t2 t5", "no"),
    ],
)
def test_the_sensors_taken_out_within_a_minute_of_the_first_are_the_answer(judged_before, out, named, right):
    day, _, block = judged_before
    quality = np.zeros_like(block.sensor_quality)
    for name, after_s in out.items():
        quality[int(FAULT_S) + after_s : int(FAULT_S) + 200, SENSORS.index(name)] = OUT
    if "t5" not in out:
        quality[:, 4] = OUT  # it has been since long before, which is no answer
    found = verdict(
        EstimateBlock(**_columns(block) | {"sensor_quality": quality}), day, LISTED["t2, t3 +1 K"]
    )
    assert (found.named, found.right, found.out) == (named, right, len(out))
    assert found.named_s == (min(out.values()) if out else None)


@pytest.mark.parametrize(("size_um", "beyond"), [(np.inf, 0.0), (0.0, 1.0), (np.nan, 1.0)])
def test_a_good_step_is_beyond_the_bound_if_one_value_is_or_the_bound_is_nan(judged_before, size_um, beyond):
    day, fault, block = judged_before
    bounds = {
        "heat_bound_W": np.full_like(block.heat_W, np.inf),
        "field_bound_K": np.full_like(block.field_degC, np.inf),
        "error_bound_um": np.full_like(block.error_um, size_um),
    }
    bounded = SimpleNamespace(**_columns(block) | bounds)
    found = verdict(bounded, day, fault)
    assert found.good > 0
    assert found.beyond == beyond * found.good
