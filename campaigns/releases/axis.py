"""An axis whose compensation is armed, in simulated time: the daemon's own parts behind drawn estimates.

`CompensatedAxis` steps what the daemon steps: the commands, the compensation with its observer, health, the
alarms, the checkpoint and the alarms' file. Estimates, readings and the control are drawn by its caller.
After every step it asserts what an operator relies on:

- Each time that the compensation goes off although no person disarms it, exactly one alarm of its kind is
  raised anew. It has a cause and a remedy, and health and log have the same cause.
- Without such a release no alarm of its kind is raised anew.
- A written value never moves by more than the limited rate allows in a period.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, field, replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import structlog

from observer.bus.exchange import Command, Outcome, PublishStatus
from observer.control.compensation import plan_of, valid_s
from observer.control.compensator import Compensator
from observer.control.steering import NoControl
from observer.estimate.checkpoint import CheckpointFit, Snapshot
from observer.estimate.pipeline import MachineModel
from observer.frames import EstimateBlock, EstimateQuality, FloatArray, FrameBlock, Quality
from observer.installation import Installation, parse
from observer.quality.alarms import AlarmDesk
from observer.quality.conditions import Facts
from observer.quality.health import assess
from observer.quality.kinds import Condition
from observer.service.commands import Commands
from observer.service.observers import CompensationObserver, Keeper, Step, stored

PERIOD_S = 0.5
HOLD_S = 5.0
RATE_UM_S = 2.0
LIMIT_UM = 60.0
CHECKPOINT_S = 20.0
START_S = 1.8e9
GRID_M = np.linspace(0.0, 0.4, 9)
SENSORS = ("left_housing", "right_housing", "nut_body")
_END_S = 60.0


def configuration() -> Installation:
    """A small machine with a nut and three sensors, whose compensation is enabled."""
    nut = {"name": "nut", "shape": "nut", "length_m": 0.05, "stroke_m": [0.1, 0.3], "position_channel": "x_m"}
    sensors = zip(SENSORS, (0.05, 0.2, 0.35), strict=True)
    return parse({
        "screw": {
            "length_m": 0.4, "diameter_m": 0.02, "conductivity_W_mK": 50.0, "density_kg_m3": 7800.0,
            "specific_heat_J_kgK": 460.0, "expansion_1_K": 11.8e-6,
        },
        "surface": {"convection_W_m2K": 20.0},
        "ambient": {"temperature_degC": 20.0},
        "source": [nut],
        "sensor": [{"name": n, "channel": f"{n}_degC", "position_m": x, "noise_K": 0.05} for n, x in sensors],
        "estimator": {"period_s": PERIOD_S},
        "compensation": {
            "enabled": True, "controller_compensates": False, "position_feedback": "motor",
            "hold_s": HOLD_S, "rate_limit_um_s": RATE_UM_S, "limit_um": LIMIT_UM,
            "zero_at_m": 0.2,
        },
    })  # fmt: skip


@cache
def _machine() -> tuple[Installation, MachineModel]:
    config = configuration()
    return config, MachineModel.of(config, learns=True)


@dataclass
class StepInput:
    """The drawn inputs of one step: by default all are good."""

    error_um: float = 20.0
    bound_um: float = 5.0
    quality: EstimateQuality = EstimateQuality.GOOD
    sensor_quality: tuple[Quality, ...] = (Quality.GOOD,) * len(SENSORS)
    position_age_s: float = 0.0
    pause_s: float = 0.0
    clock_offset_s: float = 0.0
    rival: str | None = None
    failure: str | None = None
    control_failure: str | None = None
    is_pending: bool = False


@dataclass
class DrawnControl(NoControl):
    """In the place of a control: `failure` and `is_pending` are drawn; `writes` is what it was given."""

    failure: str | None = None
    is_pending: bool = False
    written_um: FloatArray | None = None

    def take(self, document: Any) -> None:
        """Keep the table that is written; None where the control is released."""
        table_um = document["error_um"]
        self.written_um = None if table_um is None or self.failure else np.asarray(table_um)


@dataclass
class Tally:
    """Counts over the steps of an axis."""

    steps: int = 0
    releases: int = 0
    alarms: int = 0
    largest_step_um: float = 0.0
    causes: dict[str, int] = field(default_factory=dict)


class CompensatedAxis:
    """The daemon's parts around a compensation, step by step, with the assertions of this module."""

    def __init__(self, folder: Path) -> None:
        self._config, self._machine = _machine()
        self._fit = CheckpointFit.of(self._machine)
        self._checkpoint, self._alarms_file = folder / "m-x.checkpoint", folder / "m-x.alarms.json"
        self._snapshot = Snapshot(START_S, self._machine.drive.initial(), self._machine.estimator().initial())
        self.time_s, self.tally = START_S, Tally()
        self._step_input = StepInput()
        self._was_armed, self._person_disarms = False, False
        self._start(None)

    @property
    def is_armed(self) -> bool:
        """Whether the compensation is armed."""
        return self._compensator.state.armed

    def step(
        self, step_input: StepInput | None = None, *commands: str, without: tuple[str, ...] = ()
    ) -> list[Outcome]:
        """Take one step of the loop with these commands; returns their outcomes."""
        drawn = self._step_input = step_input or StepInput()
        if PERIOD_S + drawn.pause_s > valid_s(plan_of(self._config)):
            self._last_um = None  # the values have lapsed: the control has gone to zero by its own ramp
        self.time_s += PERIOD_S + drawn.pause_s
        outcomes: list[Outcome] = []
        requests = [self._command(kind, outcomes, without) for kind in commands]
        self._person_disarms = "disarm" in commands
        with structlog.testing.capture_logs() as logs:
            self._commands.before_step(requests, self.time_s)
            block, frame = self._estimate(drawn), self._frame(drawn)
            self._control.failure, self._control.is_pending = drawn.control_failure, drawn.is_pending
            if drawn.failure is None:
                at = Step(
                    frame, None, block, now_s=self.time_s, clock_offset_s=drawn.clock_offset_s,  # type: ignore[arg-type]
                    snapshot=self._snapshot_now,
                )  # fmt: skip
                self._observer.follow(at)
                self._keeper.follow(at)
                self._keeper.finished(_END_S)
            else:
                self._observer.miss(self.time_s, 0, drawn.failure)
            self._judge(self._report(drawn, frame), logs)
            self._commands.after_step(self.time_s)
        return outcomes

    def restart(self, *, is_orderly: bool, away_s: float) -> None:
        """End the service, by a signal or by force, and start it again after a while."""
        if is_orderly:
            self._keeper.finish(self._snapshot_now())
            with structlog.testing.capture_logs() as logs:
                self._observer.finish(None)
                self._judge(self._report(StepInput(), self._frame(StepInput())), logs)
        self.close()
        self.time_s += away_s
        snapshot, _, compensation = stored(self._checkpoint, self._fit, self.time_s, 900.0)
        self._last_um = None  # the control has gone to zero by its own ramp
        with structlog.testing.capture_logs() as logs:
            self._start(compensation if snapshot is None else snapshot.compensation)
            self._observer.begin()
            self._judge(self._report(StepInput(), self._frame(StepInput())), logs)

    def close(self) -> None:
        """Wait until its files are written."""
        self._keeper.finished(_END_S)
        assert self._desk.close(_END_S)

    def acknowledge(self) -> None:
        """A person has seen all alarms."""
        self._desk.acknowledge(None)

    def _start(self, earlier_state: Any) -> None:
        layout = self._machine.layout
        self._compensator = Compensator(self._config, GRID_M, "0a0a0a0a", earlier_state)
        self._control = DrawnControl()
        self._documents: list[dict[str, Any]] = []
        self._observer = CompensationObserver(
            self._compensator,
            self._publish,
            lambda: self._step_input.rival,
            self._control,
        )
        self._keeper = Keeper(self._checkpoint, self._fit, CHECKPOINT_S)
        self._desk = AlarmDesk(self._config, layout, self._config.alarms, self._alarms_file)
        self._commands = Commands(
            PERIOD_S, lambda: None, [self._observer, self._keeper], lambda _time_s, _kind, _outcome: None
        )

    def _publish(self, document: Any) -> None:
        self._documents = [dict(document)]

    def _snapshot_now(self) -> Snapshot:
        return self._observer.remember(replace(self._snapshot, tick_s=self.time_s))

    def _command(self, kind: str, outcomes: list[Outcome], without: tuple[str, ...]) -> Command:
        return Command(kind, "anna@desk", time.monotonic(), outcomes.append, without=without)

    def _estimate(self, drawn: StepInput) -> EstimateBlock:
        g, s = len(GRID_M), len(SENSORS)
        is_known = drawn.quality != EstimateQuality.INVALID
        error_um = np.full((1, g), drawn.error_um if is_known else np.nan)
        return EstimateBlock(
            np.array([self.time_s]), np.full((1, 1), 50.0), np.ones((1, 1)), np.full((1, g), 30.0),
            np.ones((1, g)), error_um, np.full((1, g), 0.5), np.zeros((1, s)),
            np.array([drawn.sensor_quality], np.int8), np.array([drawn.quality], np.int8), np.ones((1, s)),
            np.full((1, 1), 50.0), error_bound_um=np.full((1, g), drawn.bound_um),
        )  # fmt: skip

    def _frame(self, drawn: StepInput) -> FrameBlock:
        channels = self._config.channels
        k, late = channels.index("x_m"), drawn.position_age_s > 0.0
        quality, age_s = np.zeros((1, len(channels)), np.int8), np.zeros((1, len(channels)))
        quality[0, k], age_s[0, k] = (Quality.STALE if late else Quality.GOOD), drawn.position_age_s
        values = np.full((1, len(channels)), 0.2)
        time_s, dt_s = np.array([self.time_s]), np.array([PERIOD_S])
        return FrameBlock(channels, time_s, dt_s, values, quality == Quality.GOOD, quality, age_s, {})

    def _report(self, drawn: StepInput, frame: FrameBlock) -> tuple[str, ...]:
        """Report as the loop does; returns the reasons of health."""
        observed: tuple[Condition, ...] = self._observer.conditions()
        facts = Facts(
            self.time_s, frame, {}, drawn.quality, True, drawn.failure, self.tally.steps, 0, {}, None,
            PublishStatus(True), drawn.clock_offset_s,
            sensors={f"{name}_degC": name for name in SENSORS}, observed=observed,
        )  # fmt: skip
        report = assess(facts)
        self._desk.look(self.time_s, report.conditions)
        return report.reasons

    def _judge(self, reasons: tuple[str, ...], logs: list[Any]) -> None:
        """Assert what is promised of a step, and count it."""
        state, tally = self._compensator.state, self.tally
        tally.steps += 1
        is_released = self._was_armed and not state.armed and not self._person_disarms
        alarms = [
            alarm for alarm in self._desk.document(self.time_s)["alarms"] if alarm["kind"] == "compensation"
        ]
        since = {alarm["since_s"] for alarm in alarms if alarm["state"] == "unacknowledged"}
        raised, self._since = since - self._since, since | self._since
        logged = [entry["reason"] for entry in logs if entry["event"] == "compensation released"]
        assert len(raised) == int(is_released), (raised, state)
        if is_released:
            self._assert_release(reasons, logged)
        self._assert_rate()
        self._was_armed = state.armed

    def _assert_release(self, reasons: tuple[str, ...], logged: list[str]) -> None:
        state, tally = self._compensator.state, self.tally
        document = self._desk.document(self.time_s)
        alarms = [alarm for alarm in document["alarms"] if alarm["kind"] == "compensation"]
        assert len(alarms) == 1
        reason = alarms[0]["reason"]
        assert reason == f"compensation {state.released}"
        assert "switched off at" in reason
        assert "observer arm" in alarms[0]["remedy"]
        assert reason in reasons
        assert state.released in logged
        cause = state.released.split(": ", 1)[1].removesuffix("; arm again")
        assert cause
        tally.releases += 1
        tally.alarms += 1
        tally.causes[cause] = tally.causes.get(cause, 0) + 1

    def _assert_rate(self) -> None:
        """Assert that written values move by at most the rate, and that they begin and end near zero."""
        before_um, now_um = self._last_um, self._control.written_um
        self._last_um = now_um
        if before_um is None and now_um is None:
            return
        if now_um is None and self._control.failure is not None:
            return  # it cannot be written to: its own ramp
        begin_um = np.zeros_like(now_um) if before_um is None else before_um
        end_um = np.zeros_like(begin_um) if now_um is None else now_um
        step_um = float(np.abs(end_um - begin_um).max())
        self.tally.largest_step_um = max(self.tally.largest_step_um, step_um)
        assert step_um <= RATE_UM_S * PERIOD_S * (1.0 + 1e-6) + 2e-6, (begin_um, end_um)

    _last_um: FloatArray | None = None
    _since: frozenset[float] | set[float] = frozenset()
