"""The desk of a service: what it makes of estimates, what it says meanwhile, and what it keeps."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from drivers.protocol import DriverStatus
from observer.bus.exchange import PublishStatus
from observer.estimators.selftest import Fault, Finding
from observer.frames import EstimateBlock, EstimateQuality, FrameBlock
from observer.quality.alarms import AlarmDesk
from observer.quality.conditions import Facts, conditions
from tests.bus.blocks import block
from tests.quality.desk import LAYOUT, alarm_desk

STEP_S = 20.0


def _estimate(time_s: float, quality=EstimateQuality.GOOD, **values: float) -> EstimateBlock:
    """An estimate of a machine that is as its laws say, but for the values that are given."""
    row = lambda n, value: np.full((1, n), value)  # noqa: E731
    learned = row(5, 0.1)
    learned[0, 2] += values.get("t3_offset_K", 0.0)
    heat_W = row(3, 20.0 * values.get("factor", 1.0))
    heat_W[0, 0] *= values.get("nut", 1.0)
    return replace(
        block(time_s, quality=quality, layout=LAYOUT), heat_W=heat_W,
        heat_sigma_W=row(3, 1.0), law_W=row(3, 20.0), innovation_K=row(5, 0.0), learned=learned,
        learned_sigma=row(5, values.get("sigma_K", 0.05)),
    )  # fmt: skip


def _frame(time_s: float) -> FrameBlock:
    one = np.zeros((1, 0))
    return FrameBlock((), np.array([time_s]), np.array([STEP_S]), one, one, one, one, {})


def _facts(time_s: float, *findings: Finding) -> Facts:
    return Facts(
        time_s, None, {}, EstimateQuality.GOOD, True, None, 0, 0, {"wire": (DriverStatus(connected=True), 0)},
        None, PublishStatus(0, 0, 0), 0.0, findings=findings,
    )  # fmt: skip


def _run(desk: AlarmDesk, hours: float, from_h: float = 0.0, *findings: Finding, **values) -> set[str]:
    """Let it see estimates for some hours and look each minute; returns what is raised then."""
    for k in range(int(hours * 3600.0 / STEP_S)):
        time_s = 1.8e9 + from_h * 3600.0 + k * STEP_S
        desk.see(_estimate(time_s, **values), _frame(time_s), 22.0)
        if k % 3 == 0:
            desk.look(time_s, conditions(_facts(time_s, *findings)))
    return {alarm["id"] for alarm in desk.document(0.0)["alarms"]}


def test_learning_is_described_in_words():
    desk = alarm_desk(learn_h=10.0)
    assert desk.document(0.0)["bands"]["nut"]["learning"] == "0.0 of 10 h of running"
    _run(desk, 2.5)
    band = desk.document(0.0)["bands"]["nut"]
    assert (band["known"], band["learning"], band["ratio"]) == (False, "2.5 of 10 h of running", None)
    _run(desk, 8.0, 2.5)
    band = desk.document(0.0)["bands"]["nut"]
    assert (band["known"], band["learning"], band["ratio"]) == (True, None, 1.0)


def test_a_raised_heat_is_reported_with_its_evidence():
    desk = alarm_desk(learn_h=10.0)
    assert not _run(desk, 12.0)
    assert _run(desk, 20.0, 12.0, nut=1.6) == {"heat_high.nut"}
    (alarm,) = desk.document(0.0)["alarms"]
    assert alarm["evidence"]["ratio"] == pytest.approx(1.6, rel=0.05)
    assert "10 h of running" in alarm["reason"]


def test_a_fallen_heat_is_reported_as_lost_preload():
    desk = alarm_desk(learn_h=10.0)
    assert not _run(desk, 12.0)
    assert _run(desk, 20.0, 12.0, nut=0.6) == {"heat_low.nut"}
    (alarm,) = desk.document(0.0)["alarms"]
    assert "has fallen to 0.6" in alarm["reason"]
    assert "backlash" in alarm["remedy"]


@pytest.mark.parametrize("factor", [0.5, 2.0])
def test_heats_that_are_off_together_are_the_channel_they_go_by_and_no_wear(factor):
    desk = alarm_desk(learn_h=10.0)
    assert not _run(desk, 12.0)
    assert _run(desk, 20.0, 12.0, factor=factor) == {"heat_off_law.screw_speed_rpm"}
    (alarm,) = desk.document(0.0)["alarms"]
    assert "all heats that depend on screw_speed_rpm are" in alarm["reason"]


def test_a_sensor_whose_learnt_offset_moves_is_reported_as_drifting():
    desk = alarm_desk(learn_h=10.0)
    assert not _run(desk, 12.0)
    assert not _run(desk, 12.0, 12.0, t3_offset_K=0.4)
    assert _run(desk, 12.0, 24.0, t3_offset_K=0.7) == {"sensor_disagrees.t3.drifting"}
    (alarm,) = desk.document(0.0)["alarms"]
    assert alarm["evidence"]["usual_K"] == pytest.approx(0.1, abs=0.01)
    assert not _run(alarm_desk(learn_h=10.0), 36.0, 0.0, sigma_K=0.3, t3_offset_K=0.7)


@pytest.mark.parametrize(
    ("fault", "value", "is_raised"),
    [
        (Fault.BIASED, -0.8, False), (Fault.COLOURED, 0.9, False), (Fault.NOISY, 1.6, False),
        (Fault.NOISY, 4.0, True), (Fault.REFUSED, 2.0, True),
    ],
)  # fmt: skip
def test_hundredths_of_a_kelvin_lower_a_quality_without_an_alarm(fault, value, is_raised):
    desk = alarm_desk()
    raised = _run(desk, 0.5, 0.0, Finding(fault, "t3", 0.0, value, 1.0))
    assert raised == ({f"sensor_disagrees.t3.{fault.name.lower()}"} if is_raised else set())


def test_usual_values_survive_a_restart_and_start_again_for_a_changed_sensor(tmp_path):
    file = tmp_path / "kept.json"
    desk = alarm_desk(file, learn_h=10.0)
    _run(desk, 12.0)
    assert desk.close(10.0)
    again = alarm_desk(file, learn_h=10.0)
    assert again.document(0.0)["bands"]["nut"]["known"]
    assert _run(again, 12.0, 12.0, t3_offset_K=0.7) == {"sensor_disagrees.t3.drifting"}
    assert again.close(10.0)
    kept = json.loads(file.read_text())
    kept["offsets"]["t3"]["said"] = "another place"
    file.write_text(json.dumps(kept | {"alarms": {}}))
    anew = alarm_desk(file, learn_h=10.0)
    assert not _run(anew, 5.0, 24.0, t3_offset_K=0.7)
    assert anew.close(10.0)


@pytest.mark.parametrize("spoilt", ["", "[]", '{"format": 1}', '{"format": 1, "bands": {}, "alarms": {}}'])
def test_an_unreadable_file_is_discarded(tmp_path, spoilt):
    file = tmp_path / "kept.json"
    file.write_text(spoilt)
    assert alarm_desk(file).document(0.0)["alarms"] == []


def test_a_heat_that_cannot_be_learnt_says_so_on_every_outlet():
    desk = alarm_desk(learn_h=10.0)
    uncertain = replace(_estimate(0.0), heat_sigma_W=np.full((1, 3), 15.0))
    for step in range(int(1.5 * 3600 / STEP_S)):
        desk.see(replace(uncertain, time_s=np.array([STEP_S * step])), _frame(STEP_S * step), 20.0)
    band = desk.document(0.0)["bands"]["nut"]
    assert "uncertain by 75% of the heat" in band["unsure"]
    assert band["learning"].startswith("0.0 of 10 h of running; no alarm is possible")
