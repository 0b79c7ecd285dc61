"""Health is a pure function of facts; each trouble is one sentence, and good means that there is none."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from drivers.protocol import DriverStatus
from observer.align.aligner import Aligner
from observer.bus.codec import EstimateEncoder, to_json
from observer.bus.exchange import PublishStatus
from observer.estimators.selftest import Fault, Finding
from observer.frames import EstimateQuality, Quality, Reading
from observer.model.build import build_plant
from observer.quality.conditions import Facts, of_finding
from observer.quality.health import assess
from observer.quality.kinds import Condition, ConditionKind
from observer.record.recorder import RecordStatus
from tests.logs.machines import config_of
from tests.logs.recordings import CHANNELS, plan


def _facts(**changes) -> Facts:
    aligner = Aligner(plan())
    aligner.ingest(Reading(10.0, dict.fromkeys(CHANNELS, 20.0)))
    facts = Facts(
        time_s=10.1,
        frame=aligner.tick(10.1),
        faults={},
        estimate=EstimateQuality.GOOD,
        had_estimate=True,
        failure=None,
        cycles=7,
        overruns=1,
        drivers={"amp": (DriverStatus(connected=True, reconnects=2, drops=3), 40)},
        record=RecordStatus(Path("r.csv"), 80, 0, None),
        publish=PublishStatus(True, 20, 4, 1, None, unsent={"mqtt": {"steps": 12, "duration_s": 12.0}}),
        clock_offset_s=0.01,
    )
    return replace(facts, **changes)


def test_where_all_is_well_health_is_good_and_has_the_counts():
    gap = {"hours": 3.5, "rms_K": 0.4, "allowed_K": 0.6, "per_sensor": {"t1": 0.4}, "since_s": None}
    health = assess(_facts(gap=gap))
    assert (health.state, health.reasons) == ("good", ())
    document = json.loads(to_json(health.document()))
    assert document["gap"] == gap
    assert document["drivers"]["amp"] == {
        "connected": True, "state": "connected", "samples": 40, "drops": 3, "errors": 0, "reconnects": 2,
        "error_frames": 0, "error_passive": 0, "bus_off": 0,
    }  # fmt: skip
    assert document["channels"]["t1_degC"] == {"quality": "good", "age_s": 0.1, "fault": None}
    assert document["unsent"] == {"mqtt": {"steps": 12, "duration_s": 12.0}}
    assert (document["published"], document["publish_drops"], document["recorded"]) == (20, 4, 80)
    assert document["publish_reconnects"] == 1


def test_an_occasional_channel_is_not_there_until_its_first_value_which_is_no_reason():
    expected_s = plan().expected_s.copy()
    expected_s[1] = np.inf
    aligner = Aligner(replace(plan(), expected_s=expected_s))
    for time_s, known, quality in ((10.0, CHANNELS[::2], "missing"), (10.5, CHANNELS, "good")):
        aligner.ingest(Reading(time_s, dict.fromkeys(known, 20.0)))
        frame = aligner.tick(time_s + 0.1)
        health = assess(_facts(frame=frame))
        assert (health.state, health.reasons) == ("good", ())
        assert health.channels[CHANNELS[1]]["quality"] == quality
        said = json.loads(EstimateEncoder(build_plant(config_of(2, 2, 2)).layout, "").readings(frame, 0, 1))
        assert said["channels"][CHANNELS[1]]["quality"] == quality


@pytest.mark.parametrize(
    ("changes", "state", "quality", "words"),
    [
        ({}, "good", "good", ""),
        ({"estimate": None, "frame": None}, "starting", "invalid", "no estimate yet"),
        ({"estimate": EstimateQuality.STARTING}, "starting", "starting", "readings are checked for 20 s"),
        ({"estimate": EstimateQuality.INVALID, "had_estimate": False}, "starting", "invalid",
         "is invalid although"),
        ({"estimate": EstimateQuality.INVALID}, "invalid", "invalid", "is invalid although no channel"),
        ({"estimate": EstimateQuality.STALE}, "stale", "stale", "is stale although no channel"),
        ({"estimate": EstimateQuality.DEGRADED}, "degraded", "degraded", "is degraded although no channel"),
        ({"failure": "ZeroDivisionError"}, "invalid", "invalid", "step failed: ZeroDivisionError"),
        ({"drivers": {"amp": (DriverStatus(last_error="refused"), 0)}}, "degraded", "good",
         "amp is not connected: refused"),
        ({"record": RecordStatus(None, 0, 9, "disk full")}, "degraded", "good", "recording: disk full"),
        ({"publish": PublishStatus(reason="nobody answers")}, "degraded", "good",
         "publishing: nobody answers"),
        ({"clock_offset_s": -7.0}, "degraded", "good", "clock stepped by -7.0 s"),
    ],
)  # fmt: skip
def test_each_trouble_has_its_state_quality_and_sentence(changes, state, quality, words):
    health = assess(_facts(**changes))
    assert health.state == state
    assert words in " ".join(health.reasons)
    assert bool(health.reasons) == bool(words)
    assert json.loads(to_json(health.document()))["quality"] == quality


@pytest.mark.parametrize("quality", [Quality.MISSING, Quality.STALE, Quality.REJECTED])
def test_a_channel_that_is_not_good_is_named(quality):
    frame = _facts().frame
    codes = frame.quality.copy()
    codes[0, 1] = quality
    age_s = np.where(codes == quality, np.inf, frame.age_s)
    health = assess(
        _facts(frame=replace(frame, quality=codes, age_s=age_s), faults={"t2_degC": "open_circuit"})
    )
    assert health.reasons == (f"channel t2_degC is {quality.label} (open_circuit)",)
    assert health.state == "degraded"
    assert health.channels["t2_degC"]["age_s"] is None
    to_json(health.document())


SENSORS = {"t1_degC": "t1", "t2_degC": "t2"}


def _left_out(finding: Finding, **changes):
    """The channels of a health document while a finding holds."""
    health = assess(_facts(findings=(finding,), sensors=SENSORS, **changes))
    return json.loads(to_json(health.document()))["channels"], health


@pytest.mark.parametrize(
    ("finding", "channel", "excess"),
    [
        (Finding(Fault.EXCLUDED, "t2", 5.0, 3.00004, 0.2), "t2_degC",
         {"value": 3.0, "sigma": 0.2, "unit": "K"}),
        (Finding(Fault.SWAPPED, "t1", 5.0, -4.5, 0.1, "t2"), "t1_degC",
         {"value": -4.5, "sigma": 0.1, "unit": "K"}),
        # it has only just been left out, and nothing has come of it since
        (Finding(Fault.EXCLUDED, "t1", 5.0, np.nan, 0.0), "t1_degC",
         {"value": None, "sigma": None, "unit": "K"}),
        (Finding(Fault.LEAPT, "nut_position_m", 5.0, -0.05, 0.0), "nut_position_m",
         {"value": -0.05, "sigma": None, "unit": "m"}),
    ],
)  # fmt: skip
def test_an_excluded_channel_has_its_excess(finding, channel, excess):
    channels, health = _left_out(finding)
    assert channels.pop(channel) == {"quality": "excluded", "age_s": 0.1, "fault": None, "excess": excess}
    assert all(other == {"quality": "good", "age_s": 0.1, "fault": None} for other in channels.values())
    assert health.reasons == (of_finding(finding).sentence,)  # which says it once
    assert health.essence != assess(_facts()).essence


def test_a_channel_that_is_left_out_and_missing_is_missing():
    frame = _facts().frame
    quality = np.where(np.arange(frame.quality.shape[1]) == 1, Quality.MISSING, frame.quality)
    channels, _ = _left_out(
        Finding(Fault.EXCLUDED, "t2", 5.0, 3.0, 0.2), frame=replace(frame, quality=quality)
    )
    assert channels["t2_degC"]["quality"] == "missing"
    assert channels["t2_degC"]["excess"] == {"value": 3.0, "sigma": 0.2, "unit": "K"}


@pytest.mark.parametrize("fault", [f for f in Fault if f not in (Fault.EXCLUDED, Fault.SWAPPED, Fault.LEAPT)])
def test_a_doubted_channel_in_use_has_no_excess(fault):
    channels, _ = _left_out(Finding(fault, "t2", 5.0, 3.0, 0.2))
    assert channels["t2_degC"] == {"quality": "good", "age_s": 0.1, "fault": None}


def test_every_kind_of_condition_has_its_sentence():
    for kind in ConditionKind:
        assert Condition(kind, "t1", "x", 5.0, 1.5, 0.5, quality=Quality.STALE).sentence


def test_conditions_say_for_programs_what_the_reasons_say_for_people():
    swapped = [Finding(Fault.SWAPPED, a, 5.0, 1.0, 0.1, b) for a, b in (("t1", "t2"), ("t2", "t1"))]
    document = json.loads(to_json(assess(_facts(findings=tuple(swapped), clock_offset_s=9.0)).document()))
    assert [(c["kind"], c["about"], c["since_s"]) for c in document["conditions"]] == [
        ("swapped", ["t1", "t2"], 5.0), ("swapped", ["t2", "t1"], 5.0), ("clock", [], None)
    ]  # fmt: skip
    assert document["reasons"] == list(dict.fromkeys(c["reason"] for c in document["conditions"]))
    assert len(document["reasons"]) == 2


def test_a_correlation_in_time_is_not_a_percentage():
    """A mean product in σ² may be more than one: "it repeats by 170 %" is nothing that anyone can picture."""
    said = of_finding(Finding(Fault.COLOURED, "t3", 12.0, 1.7, 0.0)).sentence
    assert "%" not in said
    assert "product of consecutive ones +1.7 σ²" in said


EXCLUDED = Finding(Fault.EXCLUDED, "t2", 5.0, 3.0, 0.2)
BOTH, ONE = frozenset(("t1", "t2")), frozenset(("t1",))


@pytest.mark.parametrize(
    ("changes", "state", "unused"),
    [
        ({"used_sensors": BOTH}, "good", []),
        ({"used_sensors": ONE, "findings": (EXCLUDED,)}, "good", ["t2"]),
        ({"used_sensors": ONE, "findings": (EXCLUDED,), "notices": ("x",)}, "degraded", ["t2"]),
        ({"failure": "ZeroDivisionError"}, "invalid", ["t1", "t2"]),
    ],
)
def test_health_names_the_sensors_that_a_good_estimate_does_not_use(changes, state, unused):
    document = assess(_facts(sensors=SENSORS, **changes)).document()
    assert (document["state"], list(document["degraded_sensors"])) == (state, unused)
    assert (document["sensors_used"], document["sensors"]) == (2 - len(unused), 2)


def test_a_heat_that_is_uncertain_leaves_the_state_good_and_is_said():
    finding = Finding(Fault.UNKNOWN, "nut", 0.0, 26.0, 18.0)
    document = assess(_facts(findings=(finding,), error_known_to_um=4.9)).document()
    assert document["state"] == "good"
    assert "the heat of nut is still uncertain: ±26 W, needed ±18 W" in document["reasons"][0]
    assert document["error_known_to_um"] == 4.9


def _refused(sensor: str, apart_K: float) -> dict:
    return {"findings": (Finding(Fault.REFUSED, sensor, 5.0, apart_K, 0.1),)}


@pytest.mark.parametrize(
    ("one", "other", "is_news"),
    [
        ({}, {"cycles": 9, "time_s": 11.0}, False),
        ({}, {"clock_offset_s": 9.0}, True),
        ({"estimate": EstimateQuality.INVALID, "had_estimate": False},
         {"estimate": EstimateQuality.STARTING}, True),
        (_refused("t3", 1.02), _refused("t3", -0.98), False),
        (_refused("t3", 1.02), _refused("t4", 1.02), True),
        ({"sensors": SENSORS, "used_sensors": BOTH}, {"sensors": SENSORS, "used_sensors": ONE}, True),
    ],
    ids=["counts", "a clock", "the first estimate", "figures", "another sensor", "a sensor that falls out"],
)  # fmt: skip
def test_conditions_make_a_report_new_and_figures_do_not(one, other, is_news):
    assert (assess(_facts(**one)).essence != assess(_facts(**other)).essence) == is_news


def excluded(
    value: float, sigma: float, returns_s: float = float("nan"), kind: ConditionKind = ConditionKind.EXCLUDED
) -> str:
    """The sentence of an excluded sensor."""
    return Condition(kind, "t1", "", 10.0, value, sigma, returns_s=returns_s).sentence


def test_an_excluded_sensor_says_when_it_is_used_again_or_the_command():
    assert (
        "check it: it is used again ten minutes after it reads right, or at once after `observer reset`"
        in (excluded(8.0, 0.3))
    )
    assert "agrees again and is used in 7 min" in excluded(0.1, 0.3, returns_s=400.0)
    assert "check it" not in excluded(0.1, 0.3, returns_s=400.0)
    perhaps = excluded(0.8, 6.3)
    assert "+0.8 ± 6.3 K off, which may be right" in perhaps
    assert "run `observer reset`" in perhaps
    assert "exchange their plugs" in excluded(3.0, 0.3, kind=ConditionKind.SWAPPED)
    assert "agrees again and is used in 7 min" in excluded(0.0, 0.3, 400.0, ConditionKind.SWAPPED)


def test_a_sensor_that_agrees_again_is_news():
    out, back = (Condition(ConditionKind.EXCLUDED, "t1", returns_s=s) for s in (float("nan"), 400.0))
    assert out.identity != back.identity
