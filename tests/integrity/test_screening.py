"""Readings that no heat can explain are kept out before they correct, and named; the rest goes on."""

from __future__ import annotations

import re
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from campaigns.integrity.catalogue import NEW_PROGRAM, catalogue
from campaigns.integrity.days import FAULT_S, day_of
from campaigns.integrity.judge import HOUSED_RIG, RIG, Verdict, faulty, verdict
from observer.align.aligner import frames_of_log
from observer.estimate.pipeline import MachineModel
from observer.estimators.selftest import Fault as Found
from observer.files.logs import Log
from observer.frames import EstimateBlock, EstimateQuality, Quality
from observer.quality.conditions import of_finding
from tests.learning.cover import estimates, log_of
from tests.learning.machines import config_of
from tests.learning.probing import PROBE, probed_log
from tests.truth.machine.machine import stream

UNSCREENED = "[integrity]\nenabled = false\n"
MACHINES = (0, 1)
"""At the fault the first stands, and the nut of the second moves."""
OTHER_SEED = 12_300
"""Of machines on which air that leaps back leaves no doubt."""


def pipeline_of(machine: MachineModel) -> Any:
    pipeline = machine.pipeline(machine.estimator())
    pipeline.gap = None
    return pipeline


def judged(name: str, number: int) -> tuple[Verdict, dict[Found, str]]:
    """What is made of a day with a fault, and what is found until its end, as sentences."""
    machine, fault = MachineModel.of(config_of(RIG), learns=True), catalogue()[name]
    pipeline, day = pipeline_of(machine), day_of(number, new_stroke=name == NEW_PROGRAM)
    frames_of_day = frames_of_log(log_of(faulty(day, fault, number)), machine.plan)
    block = EstimateBlock.joined([pipeline.step(frames) for frames in frames_of_day])
    said = {finding.fault: of_finding(finding).sentence for finding, _ in pipeline.history}
    return verdict(block, day, fault), said


@pytest.mark.parametrize(
    ("name", "number"), [("t5 +3 K", 0), ("t3 +1 K", 1), ("t1 -2 K", 0), ("t2, t4 +2 and -2 K", 1)]
)
def test_a_sensor_that_steps_is_out_at_once_and_the_rest_is_right(name: str, number: int) -> None:
    found, _ = judged(name, number)
    assert (found.bad_s, found.right) == (0.0, "yes")
    assert found.good > 0.8 * found.steps
    assert found.wrong <= 0.01 * found.good


@pytest.mark.parametrize(
    ("name", "number"), [("all +1 K", 0), ("all +4 K", 1), ("all +15 K", 0), ("all -3 K", 1)]
)
def test_equal_steps_of_all_are_taken_out_of_all(name: str, number: int) -> None:
    """A reference junction that moves: nothing is wrong of what is good, and no sensor is lost."""
    found, sentences = judged(name, number)
    assert (found.bad_s, found.out) == (0.0, 0)
    assert found.again_s is not None
    assert 60.0 <= found.again_s <= 75.0
    assert found.wrong <= 0.01 * found.good
    said = sentences[Found.SHARED_OFFSET]
    size_K = abs(float(name.split()[1]))
    assert any(
        f"{size:.2f} K too {'low' if '-' in name else 'high'}" in said
        for size in np.arange(size_K - 0.08, size_K + 0.08, 0.01)
    )


@pytest.mark.parametrize("often", [1, 3600])
def test_they_are_taken_out_beside_a_laser_and_beside_a_probe(often: int) -> None:
    """A displacement shares no reference junction: the step is none of its own, nor of what it reads."""
    day = faulty(day_of(1), catalogue()["all +4 K"], 1)
    log = probed_log(day, np.arange(1800, len(day.time_s), often), stream(12_345, "probe", "1"))
    machine = MachineModel.of(config_of(RIG, PROBE), learns=True)
    pipeline = pipeline_of(machine)
    block = EstimateBlock.joined([pipeline.step(frames) for frames in frames_of_log(log, machine.plan)])
    (size_K,) = (f.value for f, _ in pipeline.history if f.fault == Found.SHARED_OFFSET)
    assert size_K == pytest.approx(4.0, abs=0.08)
    assert not (block.sensor_quality == Quality.EXCLUDED).any()
    later = (day.time_s > FAULT_S + 120.0) & (block.quality == EstimateQuality.GOOD)
    assert later.sum() > 3000
    off_um = np.abs(block.error_um - day.error_um)[later, 1:]
    assert (off_um <= 3.0 * block.error_sigma_um[later, 1:]).mean() > 0.99
    innovation_um = block.innovation_K[day.time_s > FAULT_S, -1]
    assert np.nanmax(np.abs(innovation_um)) < 3.5  # 0.7 µm of noise; 4 K off what it reads would be 4 µm


def test_two_that_take_each_others_place_are_swapped() -> None:
    """Where they differ: on a machine that works."""
    found, said = judged("t1 and t2 swapped", 1)
    assert (found.bad_s, found.right) == (0.0, "yes")
    assert found.wrong <= 0.01 * found.good
    assert "t1, t2 are exchanged" in said[Found.SWAPPED]


def test_a_gain_of_all_is_named_and_never_good() -> None:
    """A person must look, and reset. Where nothing is warm, a gain is no step (machine 0)."""
    found, said = judged("all at 85 % of their rise", 1)
    assert found.good == 0
    assert "their rise above the air" in said[Found.GAIN]


POLLED_S = 0.05


def polled_log(day: Any, faulty_day: Any) -> Log:
    """A day whose nut is polled often enough to show a jump of 50 mm; the rest comes once a second."""
    log = log_of(faulty_day)
    time_s = np.arange(day.time_s[0], day.time_s[-1], POLLED_S)
    second = np.searchsorted(day.time_s, time_s + 1e-6) - 1
    first = np.diff(second, prepend=-1) > 0
    values = np.where(first[:, None], log.values[second], np.nan)
    nut, speed = (log.channels.index(name) for name in ("nut_position_m", "screw_speed_rpm"))
    off_m = (faulty_day.nut_m - day.nut_m)[second]
    values[:, nut] = np.interp(time_s, day.time_s, day.nut_m) + off_m
    values[:, speed] = log.values[second, speed]
    return Log(log.path, time_s, log.channels, values, first, (None,) * len(time_s))


@pytest.mark.parametrize(("name", "number"), [("nut homed 50 mm off", 0), ("nut homed -50 mm off", 1)])
def test_a_nut_homed_again_is_not_good_until_temperatures_agree(name: str, number: int) -> None:
    machine, fault, day = MachineModel.of(config_of(RIG), learns=True), catalogue()[name], day_of(number)
    pipeline, log = pipeline_of(machine), polled_log(day, faulty(day, fault, number))
    block = EstimateBlock.joined([pipeline.step(frames) for frames in frames_of_log(log, machine.plan)])
    said = {finding.fault: of_finding(finding).sentence for finding, _ in pipeline.history}
    assert f"jumped by {'-' if '-' in name else '+'}0.05" in said[Found.LEAPT]
    since_s = block.time_s - day.time_s[0] - FAULT_S
    good = block.quality == EstimateQuality.GOOD
    assert not good[(since_s >= 0.0) & (since_s < 600.0)].any()


@pytest.mark.parametrize("number", MACHINES)
def test_a_jump_of_the_air_is_detected(number: int) -> None:
    """Nothing is good until a reset, or until the reading leaps back."""
    found, said = judged("ambient +5 K", number)
    assert (found.good, found.bad_s) == (0, 0.0)
    assert re.search(r"jumped by \+[45]\.\d K", said[Found.AIR_LEAPT])
    day = day_of(number, seed=OTHER_SEED)
    off = faulty(day, catalogue()["ambient +5 K"], number)
    since_s = day.time_s - day.time_s[0] - FAULT_S
    back = off._replace(air_degC=np.where(since_s > 300.0, day.air_degC, off.air_degC))
    block = estimates(config_of(RIG), back)
    assert set(block.quality[(since_s >= 0.0) & (since_s < 300.0)]) == {EstimateQuality.DEGRADED}
    assert (block.quality[since_s > 900.0] == EstimateQuality.GOOD).any()


def test_air_that_returns_wrong_is_detected() -> None:
    """Its reading was missing for half a minute, as where a plug is changed."""
    day = day_of(0)
    off = faulty(day, catalogue()["ambient +5 K"], 0)
    since_s = day.time_s - day.time_s[0] - FAULT_S
    air_degC = np.where((since_s >= 0.0) & (since_s < 30.0), np.nan, off.air_degC)
    block = estimates(config_of(RIG), off._replace(air_degC=air_degC))
    assert (block.quality[since_s < 0.0] == EstimateQuality.GOOD).any()
    assert EstimateQuality.GOOD not in set(block.quality[since_s >= 30.0])


@pytest.mark.parametrize(("name", "number"), [("none", 0), ("none", 1), (NEW_PROGRAM, 2), (NEW_PROGRAM, 3)])
def test_without_a_fault_nothing_is_found(name: str, number: int) -> None:
    found, _ = judged(name, number)
    assert found.out == 0
    assert found.wrong <= 0.01 * found.good


def test_sigma_of_a_healthy_machine_on_housings_is_that_of_its_estimate_and_of_drift() -> None:
    """Without the nut's sensor the field would rest on its law and be kelvins away: that is no fault."""
    day = day_of(0, housed=True)
    day = day._replace(**{name: column[:2400] for name, column in day._asdict().items()})
    screened, plain = (estimates(config_of(HOUSED_RIG, more), day) for more in ("", UNSCREENED))
    late = slice(1200, None)
    for name, most in (("field_sigma_K", 1.5), ("error_sigma_um", 1.5), ("heat_sigma_W", 1.2)):
        own, other = (np.mean(getattr(block, name)[late]) for block in (screened, plain))
        assert other <= own < most * other
    assert np.mean(screened.quality[late] == EstimateQuality.GOOD) > 0.95
    assert np.isnan(screened.error_bound_um).all()  # no sensor checks another


@pytest.mark.parametrize("name", ["all +4 K", "t5 +3 K", "t2 and t4 swapped", "nut homed 50 mm off"])
def test_step_by_step_gives_the_bits_of_a_whole_log(name: str) -> None:
    """What is remembered of each reading goes on from block to block."""
    machine = MachineModel.of(config_of(RIG), learns=True)
    log = log_of(faulty(day_of(1), catalogue()[name], 1))
    near = np.abs(log.time_s - FAULT_S) < 1200.0
    log = replace(log, time_s=log.time_s[near], values=log.values[near])
    blocks = []
    for size in (1 << 20, 37):
        pipeline = pipeline_of(machine)
        blocks.append([pipeline.step(frames) for frames in frames_of_log(log, machine.plan, size)])
    for column in ("heat_W", "field_sigma_K", "sensor_quality", "quality"):
        whole, parts = (np.concatenate([getattr(b, column) for b in found]) for found in blocks)
        assert np.array_equal(whole, parts), column
    if name != "nut homed 50 mm off":
        quality = np.concatenate([b.sensor_quality for b in blocks[0]])
        assert (quality == Quality.REJECTED).any()  # something was refused at all


def test_a_reset_starts_again() -> None:
    machine = MachineModel.of(config_of(RIG), learns=True)
    pipeline = pipeline_of(machine)
    log = log_of(faulty(day_of(1), catalogue()["all at 85 % of their rise"], 0))
    blocks = list(frames_of_log(log, machine.plan, 5000))
    assert pipeline.step(blocks[0]).quality[-1] == EstimateQuality.DEGRADED
    pipeline.reset()
    pipeline.step(blocks[1])
    assert Found.GAIN not in {finding.fault for finding in pipeline.findings}


def test_without_integrity_all_is_believed_again() -> None:
    """The switch switches: what was good before this was there is so again."""
    day, fault = day_of(0), catalogue()["all +4 K"]
    block = estimates(config_of(RIG, UNSCREENED), faulty(day, fault, 0))
    found = verdict(block, day, fault)
    assert found.wrong > 0.9 * found.good > 0


def test_a_drift_of_all_is_named_as_one_and_what_is_held_back_has_a_reason() -> None:
    _, found = judged("all +3 K in 10 min", 1)
    assert "all sensors together depart" in found[Found.DRIFTING]
    assert Found.UNEXPLAINED not in found
    _, found = judged("t5 +3 K", 1)
    assert "the estimate is settling" in found[Found.SETTLING]


def swapped_and_put_right(back_s: float | None) -> tuple[Any, Any, EstimateBlock]:
    """A day on which two plugs are exchanged and, where `back_s` is given, put right so much later."""
    day, fault = day_of(1), catalogue()["t1 and t2 swapped"]
    off = faulty(day, fault, 1)
    since_s = day.time_s - day.time_s[0] - FAULT_S
    if back_s is not None:
        pulled = (since_s > back_s - 20.0) & (since_s <= back_s)
        degC = np.where((since_s > back_s)[:, None], day.sensor_degC, off.sensor_degC)
        degC[pulled, :2] = np.nan
        off = off._replace(sensor_degC=degC)
    machine = MachineModel.of(config_of(RIG), learns=True)
    pipeline = pipeline_of(machine)
    frames_of_day = frames_of_log(log_of(off), machine.plan)
    return since_s, pipeline, EstimateBlock.joined([pipeline.step(frames) for frames in frames_of_day])


def test_exchanged_plugs_that_are_put_right_are_used_again_ten_minutes_later() -> None:
    since_s, pipeline, block = swapped_and_put_right(900.0)
    out = (block.sensor_quality[:, :2] == Quality.EXCLUDED).any(axis=1)
    assert out[(since_s > 60.0) & (since_s < 880.0)].all()
    assert out[(since_s > 900.0) & (since_s < 1470.0)].all()
    assert not out[since_s > 1560.0].any()
    assert Found.SWAPPED not in {finding.fault for finding in pipeline.findings}


def test_plugs_that_stay_exchanged_are_not_used_when_the_machine_has_cooled() -> None:
    """What they read meets as heat leaves, and proves nothing."""
    since_s, pipeline, block = swapped_and_put_right(None)
    assert (block.sensor_quality[since_s > 60.0, :2] == Quality.EXCLUDED).all()
    (said,) = {of_finding(f).sentence for f in pipeline.findings if f.fault is Found.SWAPPED}
    assert "exchange their plugs" in said
    assert "`observer reset`" in said
