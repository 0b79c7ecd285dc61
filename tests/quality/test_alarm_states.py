"""The life of an alarm, step by step, against ISA-18.2's diagram written out by hand."""

from __future__ import annotations

import re
from pathlib import Path

from hypothesis import given
from hypothesis import strategies as st

from observer.quality.alarm_classes import ALARM_CLASSES
from observer.quality.alarm_states import AlarmCause, acknowledged, advance

TROUBLESHOOT = Path(__file__).parents[2] / "docs" / "how-to" / "troubleshoot.md"
PLUG = AlarmCause("sensor_fault", "t3", "channel t3_degC is missing (open_circuit)", "open_circuit")
STUCK = AlarmCause("sensor_stuck", "t3", "channel t3_degC is rejected (stuck)", "stuck")


def _states(alarms) -> dict[str, str]:
    return {name: alarm.state for name, alarm in alarms.items()}


def test_an_alarm_is_raised_acknowledged_and_gone():
    name = "sensor_fault.t3.open_circuit"
    alarms = advance({}, [PLUG], 100.0)
    assert _states(alarms) == {name: "pending"}
    alarms = advance(alarms, [PLUG], 104.9)
    assert _states(alarms) == {name: "pending"}
    alarms = advance(alarms, [PLUG], 105.0)
    assert _states(alarms) == {name: "unacknowledged"}
    assert alarms[name].since_s == 100.0
    alarms = advance(acknowledged(alarms, name), [PLUG], 106.0)
    assert _states(alarms) == {name: "acknowledged"}
    alarms = advance(alarms, [], 115.9)
    assert _states(alarms) == {name: "acknowledged"}
    assert advance(alarms, [], 116.0) == {}


def test_a_momentary_condition_raises_no_alarm():
    alarms = advance(advance({}, [PLUG], 100.0), [], 103.0)
    assert alarms == {}
    assert _states(advance(alarms, [PLUG], 106.0)) == {"sensor_fault.t3.open_circuit": "pending"}


def test_one_that_is_latched_stays_until_somebody_has_seen_it():
    name = "sensor_stuck.t3.stuck"
    alarms = advance({}, [STUCK], 100.0)
    assert _states(alarms) == {name: "unacknowledged"}
    alarms = advance(alarms, [], 200.0)
    assert _states(alarms) == {name: "returned"}
    assert _states(advance(alarms, [STUCK], 300.0)) == {name: "unacknowledged"}
    assert acknowledged(alarms) == {}
    assert _states(acknowledged(alarms, "another")) == {name: "returned"}


def test_an_alarm_that_is_not_latched_clears_itself():
    alarms = advance(advance({}, [PLUG], 100.0), [PLUG], 110.0)
    assert advance(alarms, [], 120.0) == {}


@given(st.lists(st.tuples(st.booleans(), st.booleans(), st.floats(0.1, 100.0)), max_size=30))
def test_nothing_that_was_raised_and_is_latched_goes_unseen(steps):
    """Whatever comes and goes: it is there until somebody acknowledges it."""
    alarms, time_s, unseen = {}, 0.0, False
    for holds, seen, by_s in steps:
        time_s += by_s
        alarms = advance(alarms, [STUCK] if holds else [], time_s)
        unseen |= holds and alarms[STUCK.id].state == "unacknowledged"
        assert not unseen or STUCK.id in alarms
        if seen:
            alarms, unseen = acknowledged(alarms), False


def test_every_kind_says_what_to_do():
    rows = set(re.findall(r"^\| `(\w+)` \| \S", TROUBLESHOOT.read_text(encoding="utf-8"), re.MULTILINE))
    assert rows >= set(ALARM_CLASSES), "docs/how-to/troubleshoot.md says what to do at each alarm"
    assert all(
        kind.remedy and kind.severity in ("minor", "major", "invalid") for kind in ALARM_CLASSES.values()
    )


def test_a_name_is_fit_for_a_key():
    assert AlarmCause("wire", "fräse/x*", "gone").id == "wire.fr_se_x_"
