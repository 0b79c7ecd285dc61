"""Whatever comes, goes, is acknowledged, restarted or set: alarms live by ISA-18.2's diagram."""

from __future__ import annotations

import shutil
import tempfile
from pathlib import Path

from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, rule

from observer.estimators.selftest import Fault, Finding
from observer.frames import Quality
from observer.quality.alarm_classes import ALARM_CLASSES
from observer.quality.conditions import of_finding
from observer.quality.kinds import Condition, ConditionKind
from tests.patience import PATIENCE_S
from tests.quality.desk import alarm_desk

CONDITIONS = {
    "sensor_fault.t3.open_circuit": Condition(
        ConditionKind.CHANNEL, "t3_degC", "open_circuit", quality=Quality.MISSING
    ),
    "sensor_stuck.t3.stuck": Condition(ConditionKind.CHANNEL, "t3_degC", "stuck", quality=Quality.REJECTED),
    "sensor_disagrees.t3.refused": of_finding(Finding(Fault.REFUSED, "t3", 1.7e9, 3.0, 0.1)),
    "estimate.estimator": Condition(ConditionKind.STEP_FAILED),
    "clock.computer": Condition(ConditionKind.CLOCK, value=3600.0),
}
NAMES = sorted(CONDITIONS)
RANKS = {"invalid": 0, "major": 1, "minor": 2}


class AlarmDiagram(RuleBasedStateMachine):
    """A desk beside the diagram of ISA-18.2 by hand, whose state is "absent" where there is no alarm."""

    @initialize()
    def begin(self) -> None:
        self.folder = Path(tempfile.mkdtemp())
        self.desk = alarm_desk(self.folder / "alarms.json")
        self.time_s, self.shift_s = 1.8e9, 0.0
        self.states = dict.fromkeys(CONDITIONS, "absent")
        self.since_s, self.seen_s = dict.fromkeys(CONDITIONS, 0.0), dict.fromkeys(CONDITIONS, 0.0)
        self.reported = self.raised()
        self.held: set[str] = set()

    def teardown(self) -> None:
        assert self.desk.close(PATIENCE_S)
        shutil.rmtree(self.folder)

    def raised(self) -> dict[str, str]:
        return {name: state for name, state in self.states.items() if state not in ("absent", "pending")}

    def next_state(self, name: str) -> str:
        alarm, state = ALARM_CLASSES[name.split(".", maxsplit=1)[0]], self.states[name]
        if name in self.held and state in ("absent", "pending"):
            return "unacknowledged" if self.time_s - self.since_s[name] >= alarm.on_s else "pending"
        if name in self.held:
            return "unacknowledged" if state == "returned" else state
        if state in ("absent", "pending"):
            return "absent"
        if state == "returned" or self.time_s - self.seen_s[name] < alarm.off_s:
            return state
        return "returned" if alarm.latched and state == "unacknowledged" else "absent"

    @rule(held=st.sets(st.sampled_from(NAMES)), by_s=st.sampled_from([0.5, 4.5, 5.0, 60.0, 600.0]))
    def look(self, held: set[str], by_s: float) -> None:
        self.time_s += by_s
        self.held = held
        for name in held:
            if self.states[name] in ("absent", "returned"):
                self.since_s[name] = self.time_s
            self.seen_s[name] = self.time_s
        self.states = {name: self.next_state(name) for name in CONDITIONS}
        news = self.desk.look(self.time_s, tuple(CONDITIONS[name] for name in held))
        assert news == (self.raised() != self.reported)
        self.reported = self.raised()

    @rule(name=st.none() | st.sampled_from(NAMES))
    def acknowledge(self, name: str | None) -> None:
        known = name is None or name in self.raised()
        assert (self.desk.acknowledge(name) is None) == known
        for one in self.raised():
            if name in (None, one):
                self.states[one] = "absent" if self.states[one] == "returned" else "acknowledged"

    @rule(by_s=st.sampled_from([3600.0, -3600.0]))
    def set_the_clock(self, by_s: float) -> None:
        self.desk.move(by_s)
        self.time_s += by_s
        for times_s in (self.since_s, self.seen_s):
            times_s.update({name: time_s + by_s for name, time_s in times_s.items()})

    @rule()
    def restart(self) -> None:
        """What is raised is kept and not announced again; what is pending begins anew."""
        assert self.desk.close(PATIENCE_S)
        self.desk = alarm_desk(self.folder / "alarms.json")
        self.reported = self.raised()
        self.states = {name: self.reported.get(name, "absent") for name in NAMES}

    @invariant()
    def the_document_lists_what_is_raised_the_worst_first(self) -> None:
        alarms = self.desk.document(self.time_s)["alarms"]
        assert {alarm["id"]: alarm["state"] for alarm in alarms} == self.raised()
        assert {alarm["id"]: alarm["since_s"] for alarm in alarms} == {
            n: self.since_s[n] for n in self.raised()
        }
        ranks = [(alarm["state"] == "acknowledged", RANKS[alarm["severity"]]) for alarm in alarms]
        assert ranks == sorted(ranks)


AlarmDiagram.TestCase.settings = settings(max_examples=40, stateful_step_count=20)
TestAlarmsLiveByTheDiagramOfISA182 = AlarmDiagram.TestCase


def test_figures_move_with_the_clock_and_survive_a_restart(tmp_path):
    before = alarm_desk(tmp_path / "alarms.json")
    stands = CONDITIONS["sensor_disagrees.t3.refused"]
    for time_s in (1.8e9, 1.8e9 + 700.0):
        before.look(time_s, (stands,))
    before.move(3600.0)
    assert before.close(PATIENCE_S)
    (alarm,) = alarm_desk(tmp_path / "alarms.json").document(0.0)["alarms"]
    assert alarm["evidence"]["since_s"] == stands.since_s + 3600.0
