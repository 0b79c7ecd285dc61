"""The daemon's loop: takes readings as they come, and at each tick frame → estimate → subscribers →
recording.

The loop knows neither buses nor networks nor the model: drivers, clock, pipeline, publisher, recorder and
what follows each step are handed in. Nothing in it waits for anything but the next tick.
"""

from __future__ import annotations

import asyncio
import contextlib
import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import Any, Protocol

import structlog

from drivers.protocol import Driver
from observer.align.aligner import Aligner, AlignPlan
from observer.bus.exchange import Command, PublishStatus
from observer.errors import UserError
from observer.estimate.checkpoint import Snapshot, shifted
from observer.estimate.pipeline import Pipeline
from observer.frames import EstimateBlock, EstimateQuality, FrameBlock, Quality, Reading
from observer.process.notify import reloading
from observer.quality.conditions import Facts
from observer.quality.health import HEALTH_PERIOD_S, Health, assess
from observer.quality.kinds import Condition
from observer.record.recorder import NoRecorder, Recorder
from observer.service.commands import Commands
from observer.service.observers import Step, StepObserver
from observer.service.restarts import Restarts
from observer.service.wires import Wires

_LOOK_S = 0.5
_LATE_S = 1.0  # a reading may be delayed this long
_SETTLE_S = 6.0
_SETTLE_LOOK_S = 0.02
_DRIVERS_END_S = 0.3
_RECORDER_END_S = 0.4
_PUBLISHER_END_S = 0.7
_OBSERVER_END_S = 0.1
_WRITTEN_S = 4.0
"""Before a restart, recording and checkpoint have so long instead: the new process continues from them."""

log = structlog.get_logger()


class Clock(Protocol):
    """The loop's clock, which a computer whose time is set does not disturb."""

    def now(self) -> float:
        """Return seconds since the epoch, ever increasing."""

    def offset_s(self) -> float:
        """Return how far the computer's clock is ahead of this one, in s; not 0 after the computer's time was
        set.
        """

    async def sleep_until(self, time_s: float) -> None:
        """Wait until a time in s of this clock; returns at once for a time in the past."""


class Publisher(Protocol):
    """Where estimates go; no method waits for a network."""

    @property
    def status(self) -> PublishStatus:
        """The state of publishing: connection, counts, problems."""

    def start(self) -> None:
        """Begin to open the session; returns at once, and the session is opened again for ever."""

    def commands(self) -> list[Command]:
        """Return the commands that came since the last call, oldest first."""

    def publish(self, block: EstimateBlock, sequence: int) -> None:
        """Publish a block of one estimate; without a connection it is dropped and counted.

        Args:
            block: One estimate.
            sequence: Its number.
        """

    def readings(self, frame: FrameBlock, sequence: int) -> None:
        """Publish the readings behind the estimate of this number.

        Args:
            frame: A frame of one step.
            sequence: The estimate's number.
        """

    def document(self, key: str, document: Mapping[str, Any]) -> None:
        """Publish a document under a key; from any thread.

        Args:
            key: The key below the axis.
            document: Plain data without NaN.
        """

    def close(self, timeout_s: float) -> bool:
        """End the session, waiting at most `timeout_s`; return whether it ended in that time."""


@dataclass(frozen=True, slots=True)
class Service:
    """The parts of a service.

    Attributes:
        drivers: The sources of readings.
        plan: How readings become frames.
        pipeline: Turns frames into estimates.
        publisher: Where estimates and documents go.
        clock: The clock of ticks and readings.
        notify: Reports to the service manager (`sd_notify`).
        recorder: Records readings and commands.
        observers: Follow each step, in their order.
        instance: Names a start.
        start: The state from which the pipeline continues; None if cold.
        restarts: Decides when the process is to be executed anew; None never.
        restarted: Time and reason of the last restart, for health; None without one.
        alone: Whether it verifies before the first tick that no other service has the axis.
        sensors: The names of sensors by channel.
        options: The options that name the machine and axis to a command.
        nut_channel: The channel of the nut's position; None where none is read.
    """

    drivers: tuple[Driver, ...]
    plan: AlignPlan
    pipeline: Pipeline[Any]
    publisher: Publisher
    clock: Clock
    notify: Callable[[str], object]
    recorder: Recorder | NoRecorder = NoRecorder()  # noqa: RUF009 (it has no state)
    observers: tuple[StepObserver, ...] = ()
    instance: str = ""
    start: Snapshot | None = None
    restarts: Restarts | None = None
    restarted: Mapping[str, Any] | None = None
    alone: bool = True
    sensors: Mapping[str, str] = field(default_factory=dict)
    options: str = ""
    nut_channel: str | None = None


async def serve(service: Service, when_ready: Callable[[], None] | None = None) -> str:
    """Serve until cancelled or until a restart is due, then end every part.

    After a cancellation that takes 1.7 s at most. Before a restart, recording and checkpoint have 4 s.

    A step that fails is logged and published as invalid; the loop goes on, and the watchdog is not pinged.

    Args:
        service: The parts; each is used once.
        when_ready: Called before the first tick; None for nothing.

    Returns:
        The reason of the restart.

    Raises:
        UserError: If another service has the axis already.
    """
    cycles = _Cycles(service)
    service.publisher.start()
    cycles.wires.start()
    reason = None
    try:
        for observer in service.observers:
            observer.begin()
        if service.alone:
            await _refuse_a_second_service(service.publisher)
        if when_ready is not None:
            when_ready()
        reason = await cycles.tick_until_restart()
        service.notify(reloading())
        return reason
    finally:
        _end(service, cycles, restarts=reason is not None)
        log.info(
            "stopped" if reason is None else "parts ended", cycles=cycles.count, overruns=cycles.overruns
        )


def _end(service: Service, cycles: _Cycles, *, restarts: bool) -> None:
    """End every part; log those that do not end in time."""
    snapshot = cycles.snapshot()
    recorder_s, observer_s = (_WRITTEN_S, _WRITTEN_S) if restarts else (_RECORDER_END_S, _OBSERVER_END_S)
    if restarts:
        moved_s = service.clock.offset_s()
        snapshot = None if snapshot is None else shifted(snapshot, moved_s)
        for observer in service.observers:
            observer.set_clock(moved_s)
    for observer in service.observers:
        observer.finish(snapshot)
    cycles.report_changes()
    if not cycles.wires.close(_DRIVERS_END_S):
        log.warning("a driver did not end in time")
    if not service.recorder.close(recorder_s):
        status = service.recorder.status
        log.error("recording not complete", reason=status and status.reason)
    if not service.publisher.close(_PUBLISHER_END_S):
        log.warning("zenoh did not close in time; its peer does not answer")
    for observer in service.observers:
        if (unfinished := observer.finished(observer_s)) is not None:
            log.warning(unfinished)


async def _refuse_a_second_service(publisher: Publisher) -> None:
    """Raise `UserError` where another service has the axis, as far as the network shows in six seconds."""
    with contextlib.suppress(TimeoutError):
        async with asyncio.timeout(_SETTLE_S):
            while not publisher.status.settled:
                await asyncio.sleep(_SETTLE_LOOK_S)
    if (taken := publisher.status.taken) is not None:
        raise UserError(taken)


class _Cycles:
    """The variables of a running service."""

    def __init__(self, service: Service) -> None:
        self._service = service
        start = service.start
        self.wires = Wires(service.drivers, service.clock.now, self._take)
        self._aligner = Aligner(service.plan, math.nan if start is None else start.tick_s)
        self._pipeline = service.pipeline
        if start is not None:
            self._pipeline.restore(start.drive, start.estimator, start.gap)
        self._commands = Commands(
            service.plan.period_s, self._pipeline.reset, service.observers, self._put_on_record
        )
        self.count = 0
        self.overruns = 0
        self._samples = {driver.name: 0 for driver in service.drivers}
        self._newest_s = {driver.name: -math.inf for driver in service.drivers}
        self._frame: FrameBlock | None = None
        self._last: Step | None = None
        self._estimate: EstimateQuality | None = None
        self._had_estimate = False
        self._failure: str | None = None
        self._observed: tuple[Condition, ...] = ()
        self._health: Health | None = None
        self._sent_s = self._looked_s = -math.inf
        self._restart = service.restarted

    def snapshot(self) -> Snapshot | None:
        """The pipeline's state after its last step, None before the first estimate."""
        snapshot = self._service.start
        if self._last is not None:
            snapshot = Snapshot(float(self._last.frame.time_s[0]), *self._pipeline.snapshot())
        if snapshot is None or not snapshot.estimator.started:
            return None
        for observer in self._service.observers:
            snapshot = observer.remember(snapshot)
        return snapshot

    def _standing(self) -> Snapshot | None:
        """The state from which the next recording continues, if this one ends with the step just done."""
        if self._failure is not None or (snapshot := self.snapshot()) is None:
            return None
        memory, test = self._aligner.memory, self._pipeline.test_state
        return replace(snapshot, walk=memory, test=test, sequence=self.count)

    def _put_on_record(self, time_s: float, kind: str, outcome: str) -> None:
        """Record a command, in a row without values that the aligner puts among the others."""
        self._looked_s = -math.inf  # what it changed is published at once
        self._service.recorder.command(self._aligner.ingest(Reading(time_s, {})).time_s, kind, outcome)

    def _take(self, name: str, reading: Reading) -> None:
        """Take a reading: none from the future; a late one keeps its time, one that is far too late is a
        fault.
        """
        now_s = self._service.clock.now()
        if reading.time_s > now_s:
            reading = Reading(now_s, reading.values, reading.faults)
        if reading.time_s < self._newest_s[name] - _LATE_S:
            faults = dict.fromkeys(reading.values, "time_backwards")
            reading = Reading(now_s, dict.fromkeys(reading.values, math.nan), faults)
        else:
            self._newest_s[name] = max(reading.time_s, self._newest_s[name])
        self._samples[name] += 1
        for observer in self._service.observers:
            observer.hear(reading)
        for news in self._aligner.news_of(reading):
            self._service.recorder.reading(self._aligner.ingest(news))

    async def tick_until_restart(self) -> str:
        """Tick at whole multiples of the period until a restart is due, and announce it; returns its reason.

        A tick that is missed is counted and left out.
        """
        clock, period_s = self._service.clock, self._service.plan.period_s
        number = math.floor(clock.now() / period_s) + 1
        while True:
            await clock.sleep_until(number * period_s)
            self._tick(number * period_s)
            due = math.floor(clock.now() / period_s)
            self.overruns += max(0, due - number)
            number = max(due, number) + 1
            restarts = self._service.restarts
            if restarts is not None and (reason := restarts.due(clock.now(), clock.offset_s())) is not None:
                self._restart, self._health = {"time_s": clock.now(), "reason": reason}, None
                self._report(clock.now())
                return reason

    def _tick(self, time_s: float) -> None:
        self.wires.drain()  # what arrived while this tick was waiting belongs to it
        observer_commands = [command for observer in self._service.observers for command in observer.asks()]
        self._commands.before_step([*self._service.publisher.commands(), *observer_commands], time_s)
        frame = self._aligner.tick(time_s)
        changed = self._estimate_of(frame)  # first: work that nobody waits for comes after
        self._service.recorder.tick(float(frame.time_s[0]), self._standing)
        changed |= self._frame is None or bool((frame.quality != self._frame.quality).any())
        self._frame = frame
        changed |= self._observe()
        self._commands.after_step(time_s)
        now_s = self._service.clock.now()
        if changed or now_s - self._looked_s >= _LOOK_S:
            self._looked_s = now_s
            self._report(now_s)

    def _observe(self) -> bool:
        """Gather the observers' conditions; says whether they have changed."""
        before, observers = self._observed, self._service.observers
        self._observed = tuple(condition for observer in observers for condition in observer.conditions())
        return self._observed != before

    def report_changes(self) -> None:
        """Report the conditions that changed as the service ended, such as a released compensation."""
        if self._observe():
            self._report(self._service.clock.now())

    def _estimate_of(self, frame: FrameBlock) -> bool:
        """Step and publish; says whether the estimate's quality has changed."""
        try:
            estimate = self._pipeline.step(frame)
        except Exception as error:  # reported as invalid; the watchdog is not pinged
            changed = self._failure is None
            self._failure = f"{type(error).__name__}: {error}"
            if changed:
                log.error("step failed", exc_info=True)
            for observer in self._service.observers:
                observer.miss(float(frame.time_s[0]), self.count, self._failure)
            return changed
        self._service.publisher.publish(estimate, self.count)
        self._service.publisher.readings(frame, self.count)
        now_s, ahead_s = self._service.clock.now(), self._service.clock.offset_s()
        self._last = Step(frame, self._pipeline.inputs, estimate, self.count, now_s, ahead_s, self.snapshot)
        self.count += 1
        for observer in self._service.observers:
            observer.follow(self._last)
        self._ping()
        before, self._estimate = self._estimate, EstimateQuality(estimate.quality[0])
        self._had_estimate |= self._estimate != EstimateQuality.INVALID
        self._failure = None
        return before != self._estimate

    def _ping(self) -> None:
        """Report to the service manager that a cycle is complete and, if so, that all threads are alive."""
        words = ["READY=1"] if self.count == 1 else []
        words += ["WATCHDOG=1"] if self._all_alive() else []
        if words:
            self._service.notify("\n".join(words))

    def _all_alive(self) -> bool:
        """Whether every thread that the service needs is alive; if not, the watchdog is not pinged."""
        service = self._service
        parts = (self.wires, service.publisher.status, service.recorder)
        return all(part.alive for part in parts)

    def _notices(self) -> Iterator[str]:
        """Problems beside the estimates."""
        if not self.wires.alive:
            yield "drivers: their thread has ended; restart the service"
        for observer in self._service.observers:
            yield from observer.notices()
        if self._service.restarts is not None:
            yield from self._service.restarts.notices()

    def _used_sensors(self) -> frozenset[str]:
        """The names of the sensors that the last estimate uses."""
        if self._last is None:
            return frozenset()
        names = self._pipeline.layout.sensors
        return frozenset(n for n, used in zip(names, self._last.estimate.used[0], strict=True) if used)

    def _error_known_to_um(self) -> float | None:
        """Half of the 95 % interval of the last estimate's thermal error at the nut; None where unknown."""
        if self._last is None:
            return None
        frame, nut = self._last.frame, self._service.nut_channel
        nut_m = math.nan
        if nut is not None and frame.quality[0, column := frame.channels.index(nut)] == Quality.GOOD:
            nut_m = float(frame.values[0, column])
        grid_m = self._pipeline.layout.position_m
        known_to_um = float(self._last.estimate.error_known_to_um(grid_m, nut_m)[0])
        return known_to_um if math.isfinite(known_to_um) else None

    def _report(self, now_s: float) -> None:
        """Publish the health when it has changed or five seconds have passed."""
        service, statuses, gap = self._service, self.wires.statuses(), self._pipeline.gap
        facts = Facts(
            now_s,
            self._frame,
            self._aligner.faults,
            self._estimate,
            self._had_estimate,
            self._failure,
            self.count,
            self.overruns,
            {name: (status, self._samples[name]) for name, status in statuses.items()},
            service.recorder.status,
            service.publisher.status,
            service.clock.offset_s(),
            self._pipeline.findings,
            tuple(self._notices()),
            *((None, None) if gap is None else (gap.figures, gap.departure)),
            service.sensors,
            self._used_sensors(),
            self._observed,
            service.options,
            self._error_known_to_um(),
        )
        health = assess(facts)
        for observer in service.observers:
            observer.report(now_s, health.conditions)
        changed = self._health is None or health.essence != self._health.essence
        if changed:
            log.info("health", state=health.state, reasons=health.reasons)
        if changed or now_s - self._sent_s >= HEALTH_PERIOD_S:
            self._health, self._sent_s = health, now_s
            start = {"restart": self._restart, "instance": service.instance}
            service.publisher.document("health", health.document() | start)
