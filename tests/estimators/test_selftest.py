"""The self-test is the same whatever the blocks are, and its means are those of their definition."""

from __future__ import annotations

from functools import cache
from itertools import islice
from pathlib import Path

import numpy as np
import pytest

from observer.align.aligner import frames_of_log
from observer.estimate.pipeline import MachineModel
from observer.estimators.selftest import Fault
from observer.files.logs import Log
from observer.frames import EstimateQuality
from observer.kernels.judging import QUIET_S
from tests.reference import live
from tests.truth.shifts import Axis, record, work


@cache
def day() -> tuple[MachineModel, Log]:
    rng = np.random.default_rng(5)
    seen = record(Axis(film_W_m2K=40.0), work(0.03, rng), rng)  # a film that is far off
    machine = MachineModel.of(live.demo())
    names = [*(s.channel for s in machine.config.sensor), "nut_position_m", "screw_speed_rpm"]
    cells = np.column_stack([seen.seen_degC, seen.position_m, seen.speed_rpm])
    cells[2000:2400, 2] += 2.0  # one sensor is off for a while
    return machine, Log(Path("day.csv"), seen.time_s, tuple(names), cells)


def _run(block: int):
    machine, log = day()
    pipeline = machine.pipeline(machine.estimator())
    quality = [pipeline.step(frames).quality for frames in frames_of_log(log, machine.plan, block)]
    return np.concatenate(quality), pipeline.history


def test_blocks_of_any_size_give_the_same_qualities_and_reasons() -> None:
    whole, reasons = _run(100_000)
    assert {EstimateQuality.GOOD, EstimateQuality.STARTING, EstimateQuality.DEGRADED} <= set(whole.tolist())
    for block in (1, 7, 500):
        parts, again = _run(block)
        np.testing.assert_array_equal(parts, whole)
        assert again == reasons


def test_says_what_is_off_and_begins_with_unknown_heats() -> None:
    whole, reasons = _run(100_000)
    faults = {finding.fault for finding, _ in reasons}
    assert {Fault.UNKNOWN, Fault.REFUSED} <= faults
    assert faults & {Fault.ALL_OFF_LAW, Fault.OFF_LAW, Fault.BIASED}
    assert (whole[:10] == EstimateQuality.STARTING).all()
    refused = next(f for f, _ in reasons if f.fault is Fault.REFUSED)
    assert refused.subject == "t3"


@pytest.mark.parametrize("kind", ["kalman", "luenberger"])
def test_every_step_that_is_degraded_has_its_reason(kind: str) -> None:
    machine, log = day()
    settings = machine.config.estimator.model_copy(update={"kind": kind})
    machine = MachineModel.of(machine.config.model_copy(update={"estimator": settings}))
    pipeline = machine.pipeline(machine.estimator())
    first_good_s = log.time_s[0] + QUIET_S + 1.0  # readings are not judged before
    for frames in islice(frames_of_log(log, machine.plan, 1), 2600):  # until after the sensor that is off
        block = pipeline.step(frames)
        if block.quality[0] in {EstimateQuality.DEGRADED, EstimateQuality.STARTING}:
            has_begun = block.quality[0] == EstimateQuality.STARTING and block.time_s[0] <= first_good_s
            assert pipeline.findings or (frames.quality != 0).any() or has_begun
