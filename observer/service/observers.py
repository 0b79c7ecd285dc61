"""The observers of the loop's steps: what follows each estimate."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import structlog

from observer.bus.exchange import Command
from observer.control.compensation import CompensationState
from observer.control.compensator import Compensator
from observer.control.steering import NoControl, Steering
from observer.estimate.checkpoint import CheckpointFit, Snapshot, UnfitError, load, pack, recent
from observer.estimate.pipeline import MachineModel
from observer.estimate.screw_state import ScrewState
from observer.files.state import StateWriter
from observer.frames import EstimateBlock, FrameBlock, Inputs, Reading
from observer.quality.alarms import AlarmDesk
from observer.quality.gap import GapState
from observer.quality.health import HEALTH_PERIOD_S
from observer.quality.kinds import Condition, ConditionKind
from observer.service.zero_signal import ZeroSignal

_CONTROL_END_S = 0.3

Publish = Callable[[Mapping[str, Any]], None]
Answer = Callable[[], tuple[bool, str] | None]
"""Whether a command was done, and its outcome in words; asked after each step until that is known."""

log = structlog.get_logger()


@dataclass(frozen=True, slots=True)
class Step:
    """The loop's inputs and outputs at a tick; all blocks have one step.

    Attributes:
        frame: The frame.
        inputs: What drove the plant in it.
        estimate: The estimate, as published.
        sequence: The estimate's number.
        now_s: The time in s of the loop's clock.
        clock_offset_s: How far the computer's clock is ahead, in s.
        snapshot: Gives the state of the pipeline after the step, None before the first estimate; it may only
            be called in `follow`.
    """

    frame: FrameBlock
    inputs: Inputs
    estimate: EstimateBlock
    sequence: int = 0
    now_s: float = math.nan
    clock_offset_s: float = 0.0
    snapshot: Callable[[], Snapshot | None] = lambda: None


class StepObserver:
    """Follows the loop; hooks that a subclass leaves out do nothing.

    All hooks are called in the loop's thread, and only `finished` may wait. A hook must not raise.
    """

    def begin(self) -> None:
        """Start threads and the like, before the first tick."""

    def hear(self, reading: Reading) -> None:
        """Take a reading as it comes, before the tick reduces it to one value a channel."""

    def asks(self) -> list[Command]:
        """Return commands that follow from readings; all observers obey them before the next step."""
        return []

    def follow(self, step: Step) -> None:
        """Take a step that succeeded, once its estimate is published."""

    def miss(self, time_s: float, sequence: int, reason: str) -> None:
        """Note that the step of a tick has failed.

        Args:
            time_s: The time of the tick.
            sequence: The number that the estimate would have had.
            reason: The error in words.
        """

    def obey(self, command: Command) -> Answer | None:
        """Carry out a command with the next step.

        Returns:
            A function that gives the outcome, or None while that is not known; None where the command is not
            for this observer.
        """

    def report(self, time_s: float, conditions: tuple[Condition, ...]) -> None:
        """Take the conditions of a health report; called twice a second, and when something changes.

        Args:
            time_s: The time of the report.
            conditions: All of them, in the order of the report.
        """

    def notices(self) -> tuple[str, ...]:
        """Return sentences that become reasons of health."""
        return ()

    def conditions(self) -> tuple[Condition, ...]:
        """Return problems for health and alarms; a change of them is reported at once."""
        return ()

    def remember(self, snapshot: Snapshot) -> Snapshot:
        """Return the snapshot with the state from which this observer continues after a restart."""
        return snapshot

    def finish(self, snapshot: Snapshot | None) -> None:
        """Begin to end; `finished` waits for it.

        Args:
            snapshot: The state of the pipeline; None before the first estimate.
        """

    def set_clock(self, by_s: float) -> None:
        """Move everything that lasts by the step of the computer's clock, in s, before a restart."""

    def finished(self, timeout_s: float) -> str | None:
        """Wait for the end, at most `timeout_s`.

        Returns:
            A sentence on what was not done by then; None if all was.
        """
        del timeout_s
        return None


class CompensationObserver(StepObserver):
    """Publishes the compensation after each step, has it written to the control, and arms and disarms it.

    Args:
        compensator: Follows the estimates.
        publish: Publishes a document of the compensation.
        duplicate: Returns a sentence on another service of the axis; None without.
        control: Writes the values to a control.
        signal: Reports a new zero; None without such a channel.
    """

    def __init__(
        self,
        compensator: Compensator,
        publish: Publish,
        duplicate: Callable[[], str | None],
        control: Steering | NoControl,
        signal: ZeroSignal | None = None,
    ) -> None:
        self._compensator, self._publish, self._control = compensator, publish, control
        self._duplicate, self._signal = duplicate, signal
        self._logged = compensator.state

    def begin(self) -> None:
        """Log the release that the end of an earlier service was."""
        if self._logged.released:
            log.warning("compensation released", reason=self._logged.released)

    def hear(self, reading: Reading) -> None:
        """Watch the signal."""
        if self._signal is not None:
            self._signal.hear(reading)

    def asks(self) -> list[Command]:
        """Zero when the signal rises."""
        return [] if self._signal is None else self._signal.commands()

    def follow(self, step: Step) -> None:
        """Take an estimate, publish the correction and hand it to the control.

        Another publisher, a control that does not follow and a clock that was set release the compensation
        first.
        """
        compensator = self._compensator
        compensator.see_clock(step.clock_offset_s)
        if (duplicate := self._duplicate()) is not None:
            compensator.release(duplicate)
        if self._control.failure is not None:
            compensator.release_unfollowed(self._control.failure)
        lost = None if self._signal is None else self._signal.lost(step.now_s)
        self._send(compensator.step(step.estimate, step.frame, step.sequence, lost))

    def miss(self, time_s: float, sequence: int, reason: str) -> None:
        """Hold the values, or go on to zero."""
        self._send(self._compensator.fail(time_s, sequence, reason))

    def _send(self, document: Mapping[str, Any]) -> None:
        self._publish(document)
        self._control.take(document)
        self._log(self._compensator.state)

    def _log(self, state: CompensationState) -> None:
        """Log each release, and the begin of each hold."""
        if state.released and state.released != self._logged.released:
            log.warning("compensation released", reason=state.released)
        elif state.doubt and not self._logged.doubt:
            log.info("compensation holds its values", reason=state.doubt)
        self._logged = state

    def obey(self, command: Command) -> Answer | None:
        """Arm, disarm or set to zero; a reset releases too, and is answered by the estimator."""
        before = self._compensator.reason
        if command.kind == "arm":
            self._compensator.arm(command.without)
            return self._armed
        if command.kind == "disarm":
            self._compensator.disarm(f"disarmed by {command.by}; arm again")
            return lambda: (True, "disarmed" if before is None else f"it was off already: {before}")
        if command.kind == "zero":
            self._compensator.zero(command.by)
            return self._zeroed
        if command.kind == "reset":
            self._compensator.release(f"{command.by} has reset the estimator")
        return None

    def _armed(self) -> tuple[bool, str] | None:
        """The outcome of arming; None until it is known whether the control follows."""
        reason = self._compensator.reason
        if reason is None and self._control.is_pending:
            return None
        return reason is None, "armed" if reason is None else f"not armed: {reason}"

    def _zeroed(self) -> tuple[bool, str]:
        zero, reason = self._compensator.state.zero, self._compensator.reason
        if zero.missed:
            return False, reason or ""
        text = f"zeroed at {zero.at_m:.4g} m on the screw, where the error was {zero.error_um:.4g} µm"
        return True, text if reason is None else f"{text}; off: {reason}"

    def conditions(self) -> tuple[Condition, ...]:
        """The last release, until a person arms or disarms, and a zero that was refused."""
        state, conditions = self._compensator.state, []
        if state.released:
            conditions.append(
                Condition(ConditionKind.RELEASED, detail=state.released, since_s=state.released_s)
            )
        if state.zero.missed and state.reason != state.released:
            conditions.append(Condition(ConditionKind.NOT_ZEROED, detail=state.reason or ""))
        return tuple(conditions)

    def remember(self, snapshot: Snapshot) -> Snapshot:
        """Add the table and line in force."""
        return replace(snapshot, compensation=self._compensator.state)

    def finish(self, _snapshot: Snapshot | None) -> None:
        """Release the compensation and the control."""
        if self._compensator.reason is None:
            self._publish(self._compensator.ended())
            self._log(self._compensator.state)
        if not self._control.close(_CONTROL_END_S):
            log.warning("the control could not be released in time; its dead-man takes it to zero")


class AlarmObserver(StepObserver):
    """Publishes alarms on change and every five seconds.

    Args:
        desk: Learns usual heats, and raises alarms.
        publish: Publishes the document of alarms.
        air: The column of the ambient in `z_end`.
        instance: Names the start of the service.
    """

    def __init__(self, desk: AlarmDesk, publish: Publish, air: int, instance: str) -> None:
        self._desk, self._publish, self._air, self._instance = desk, publish, air, instance
        self._sent_s = -math.inf

    def follow(self, step: Step) -> None:
        """Take an estimate."""
        self._desk.see(step.estimate, step.frame, float(step.inputs.z_end[0, self._air]))

    def obey(self, command: Command) -> Answer | None:
        """Mark an alarm, or all, as seen."""
        if command.kind != "acknowledge":
            return None
        why_not = self._desk.acknowledge(command.about)
        return lambda: (why_not is None, why_not or f"acknowledged: {command.about or 'all'}")

    def report(self, time_s: float, conditions: tuple[Condition, ...]) -> None:
        """Judge and publish."""
        changed = self._desk.look(time_s, conditions)
        if changed or time_s - self._sent_s >= HEALTH_PERIOD_S:
            self._sent_s = time_s
            self._publish(self._desk.document(time_s) | {"instance": self._instance})

    def set_clock(self, by_s: float) -> None:
        """Move the times of the alarms."""
        self._desk.move(by_s)

    def finished(self, timeout_s: float) -> str | None:
        """Wait until the alarms are on the disk."""
        if self._desk.close(timeout_s):
            return None
        return "the state of the alarms could not be saved in time; check the disk"


def stored(
    path: Path, fit: CheckpointFit, now_s: float, oldest_s: float, machine: MachineModel | None = None
) -> tuple[Snapshot | None, GapState | None, CompensationState | None]:
    """Return the service's state when it last ran; whether and why the start is cold is logged.

    Args:
        path: The checkpoint.
        fit: What a checkpoint must belong to.
        now_s: The present time in s since 1970.
        oldest_s: The largest age, in s, of a state that is continued.
        machine: With it, a state of another model of the same screw continues in this machine; None without.

    Returns:
        The state, None for a cold start. Also the last known state of the prediction's gap and of the
        compensation, however old; None without.
    """
    gap: GapState | None = None
    compensation: CompensationState | None = None
    try:
        snapshot = load(path, fit, machine)
        gap = None if snapshot.gap is None else replace(snapshot.gap, time_s=math.nan)
        compensation = snapshot.compensation
        recent(snapshot, now_s, oldest_s)
    except UnfitError as error:
        log.warning("cold start", checkpoint=str(path), reason=str(error))
        return None, gap, compensation
    log.info("warm start", checkpoint=str(path), age_s=round(now_s - snapshot.tick_s, 3))
    return snapshot, snapshot.gap, compensation


class Keeper(StepObserver):
    """Writes the newest snapshot to one file, at most every `period_s`, and the last one at the end.

    Each is written in a thread of its own; a period in which the one before is not written yet is left out. A
    file that cannot be written is a reason of health, and is tried again.

    Args:
        path: The checkpoint.
        fit: What the checkpoint belongs to.
        period_s: The shortest interval between two of them, in s.
        machine: With it, the last one also holds the state of the screw, from which another model continues.
    """

    def __init__(
        self, path: Path, fit: CheckpointFit, period_s: float, machine: MachineModel | None = None
    ) -> None:
        self._file = StateWriter(path)
        self._fit, self._period_s, self._machine = fit, period_s, machine
        self._last: Step | None = None
        self._given_s = -math.inf

    def follow(self, step: Step) -> None:
        """Write the state of the service after a step, if due."""
        self._last = step
        if step.now_s - self._given_s >= self._period_s and self._file.wait():
            self._given_s = step.now_s
            self._begin(step.snapshot(), None)

    def notices(self) -> tuple[str, ...]:
        """Why the last checkpoint could not be written."""
        return (f"checkpoint: {self._file.problem}",) if self._file.problem else ()

    def obey(self, _command: Command) -> Answer | None:
        """Write the state after the next step: a command may have armed the compensation."""
        self._given_s = -math.inf
        return None

    def finish(self, snapshot: Snapshot | None) -> None:
        """Begin to write the last snapshot."""
        self._begin(snapshot, self._last)

    def _begin(self, snapshot: Snapshot | None, last: Step | None) -> None:
        if snapshot is not None:
            self._file.replace(partial(self._packed, snapshot, last))

    def finished(self, timeout_s: float) -> str | None:
        """Wait until the last snapshot is on the disk."""
        if self._file.wait(timeout_s):
            return None
        return "the last checkpoint could not be written in time; check the disk"

    def _packed(self, snapshot: Snapshot, last: Step | None) -> bytes:
        if last is not None and self._machine is not None:
            screw = ScrewState.of(self._machine, snapshot.estimator, last.inputs, last.estimate, last.frame)
            snapshot = replace(snapshot, screw=screw)
        return pack(snapshot, self._fit)
