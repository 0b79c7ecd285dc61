"""Every release of the compensation raises one alarm, whatever is drawn; and the judge of that can fail."""

from __future__ import annotations

import tempfile
from pathlib import Path

import pytest
from hypothesis import HealthCheck, settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, precondition, rule

from campaigns.releases.axis import CompensatedAxis, StepInput
from campaigns.releases.faults import (
    AT_ONCE,
    COMMANDS,
    DISARMED,
    HELD,
    LATE_CONTROL,
    RESTARTS,
    STALLED,
    arm,
    run,
)
from observer.service.observers import CompensationObserver

GOOD = StepInput()
SECONDS = st.sampled_from([0.5, 1.0, 4.5, 5.0, 5.5, 8.0, 30.0])


class Faults(RuleBasedStateMachine):
    """An armed axis and what may happen to it; the axis asserts its promises after each step."""

    def __init__(self) -> None:
        super().__init__()
        self._folder = tempfile.TemporaryDirectory()
        self.axis = CompensatedAxis(Path(self._folder.name))

    def teardown(self) -> None:
        self.axis.close()
        self._folder.cleanup()

    @initialize()
    def armed_at_the_beginning(self) -> None:
        arm(self.axis, GOOD)

    @rule(steps=st.integers(1, 40), error_um=st.floats(-50.0, 50.0))
    def goes_on(self, steps: int, error_um: float) -> None:
        for _ in range(steps):
            self.axis.step(StepInput(error_um=error_um))

    @precondition(lambda self: self.axis.is_armed)
    @rule(
        kind=st.sampled_from([*HELD, *AT_ONCE, STALLED, LATE_CONTROL]),
        seconds=SECONDS,
        size=st.floats(0.0, 1.0),
    )
    def fault_that_lasts(self, kind: str, seconds: float, size: float) -> None:
        run(self.axis, kind, seconds, size, GOOD)

    @precondition(lambda self: self.axis.is_armed)
    @rule(kind=st.sampled_from([*COMMANDS, *RESTARTS, DISARMED]), seconds=SECONDS)
    def command_or_restart(self, kind: str, seconds: float) -> None:
        run(self.axis, kind, seconds, 0.5, GOOD)

    @precondition(lambda self: not self.axis.is_armed)
    @rule()
    def armed_again(self) -> None:
        arm(self.axis, GOOD)

    @rule()
    def acknowledged(self) -> None:
        self.axis.acknowledge()


TestFaults = Faults.TestCase
TestFaults.settings = settings(
    max_examples=6, stateful_step_count=15, deadline=None, suppress_health_check=[HealthCheck.too_slow]
)


def test_a_release_that_raises_no_alarm_is_noticed(tmp_path, monkeypatch) -> None:
    axis = CompensatedAxis(tmp_path)
    arm(axis, GOOD)
    monkeypatch.setattr(CompensationObserver, "conditions", lambda _self: ())
    with pytest.raises(AssertionError):
        run(axis, "no position", 8.0, 0.0, GOOD)


def test_a_value_that_jumps_is_noticed(tmp_path, monkeypatch) -> None:
    axis = CompensatedAxis(tmp_path)
    arm(axis, GOOD)
    for _ in range(10):
        axis.step(GOOD)
    monkeypatch.setattr("observer.control.compensation._most_um", lambda *_: 1e3)
    with pytest.raises(AssertionError):
        axis.step(StepInput(error_um=40.0))
