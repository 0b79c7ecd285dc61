"""The daemon's loop: readings in as they come, and at each tick frame → estimate → subscribers → recording.

The loop knows neither buses nor networks nor the model: drivers, clock, drive, estimator, publisher and
recorder are handed in. Nothing in it waits for anything but the next tick.
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
from observer.control.compensation import Compensator
from observer.control.steering import Steering
from observer.errors import UserError
from observer.estimate.checkpoint import Snapshot
from observer.estimate.pipeline import FrameDrive, Pipeline
from observer.estimators.protocol import Estimator
from observer.estimators.selftest import SelfTest
from observer.exchange import Command, PublishStatus
from observer.frames import EstimateBlock, EstimateQuality, FrameBlock, Reading
from observer.live.commands import Commands
from observer.live.observers import Step, StepObserver
from observer.live.renewal import Renewal, Renewals
from observer.live.wires import Wires
from observer.quality.conditions import Facts
from observer.quality.gap import GapWatch
from observer.quality.health import HEALTH_PERIOD_S, Health, assess
from observer.record.recorder import Recorder

_LOOK_S = 0.5
_LATE_S = 1.0  # a reading may have waited so long on its way
_SETTLE_S = 6.0
_SETTLE_LOOK_S = 0.02
_DRIVERS_END_S = 0.3
_RECORDER_END_S = 0.4
_PUBLISHER_END_S = 0.7
_CONTROL_END_S = 0.3

log = structlog.get_logger()


class Clock(Protocol):
    """What the loop knows of time."""

    def now(self) -> float:
        """Seconds since the epoch, ever increasing."""

    def offset_s(self) -> float:
        """How far the computer's clock is ahead."""

    async def sleep_until(self, time_s: float) -> None:
        """Wait until a time."""


class Publisher(Protocol):
    """Where estimates go; no method waits for a network."""

    @property
    def status(self) -> PublishStatus:
        """How publishing stands."""

    def start(self) -> None:
        """Begin to open the session."""

    def commands(self) -> list[Command]:
        """Give the commands that came since the last call."""

    def publish(self, block: EstimateBlock, sequence: int) -> None:
        """Publish a block of one estimate."""

    def readings(self, frame: FrameBlock, sequence: int) -> None:
        """Publish what the estimate of this number was made of: a frame of one step."""

    def document(self, key: str, document: Mapping[str, Any]) -> None:
        """Publish a document under a key; called by any thread."""

    def close(self, timeout_s: float) -> bool:
        """End the session."""


def no_alarms(_name: str | None) -> str:
    """Say why no alarm can be acknowledged where there are none."""
    return "there are no alarms; set enabled = true in [alarms]"


@dataclass(frozen=True, slots=True)
class Service:
    """The parts of a service.

    `notify` reports to the service manager (`sd_notify`), `instance` names a start, `start` is the state the
    estimator continues from, None if cold. With `alone` it makes sure, before the first tick, that no other
    service has the axis. `sensors` maps sensors' channels to their names. `acknowledge` marks an alarm as
    seen, or says why not.
    """

    drivers: tuple[Driver, ...]
    plan: AlignPlan
    drive: FrameDrive[Any]
    estimator: Estimator
    publisher: Publisher
    recorder: Recorder | None
    clock: Clock
    notify: Callable[[str], object]
    compensator: Compensator | None = None
    self_test: SelfTest | None = None
    instance: str = ""
    start: Snapshot | None = None
    renewals: Renewals[Any] | None = None
    alone: bool = True
    gap: GapWatch | None = None
    control: Steering | None = None
    sensors: Mapping[str, str] = field(default_factory=dict)
    observers: tuple[StepObserver, ...] = ()
    acknowledge: Callable[[str | None], str | None] = no_alarms


async def serve(service: Service, when_ready: Callable[[], None] | None = None) -> Renewal[Any] | None:
    """Serve until cancelled or until a renewal is due, then end every part within 1.7 s.

    `when_ready` is called before the first tick. Raises `UserError` where another service has the axis
    already.
    """
    cycles = _Cycles(service)
    service.publisher.start()
    cycles.wires.start()
    renewal = None
    try:
        for observer in service.observers:
            observer.begin()
        if service.alone:
            await _refuse_a_second_service(service.publisher)
        if when_ready is not None:
            when_ready()
        renewal = await cycles.tick_until_renewed()
        return renewal
    finally:
        _end(service, cycles)
        log.info(
            "stopped" if renewal is None else "parts ended", cycles=cycles.count, overruns=cycles.overruns
        )


def _end(service: Service, cycles: _Cycles) -> None:
    """End every part, the control first; log those that do not end in time."""
    if service.control is not None and not service.control.close(_CONTROL_END_S):
        log.warning("the control could not be released in time; its dead-man takes it to zero")
    snapshot = cycles.snapshot()
    for observer in service.observers:
        observer.finish(snapshot)
    if not cycles.wires.close(_DRIVERS_END_S):
        log.warning("a driver did not end in time")
    if service.recorder is not None and not service.recorder.close(_RECORDER_END_S):
        log.error("recording not complete", reason=service.recorder.status.reason)
    if not service.publisher.close(_PUBLISHER_END_S):
        log.warning("zenoh did not close in time; its peer does not answer")
    for observer in service.observers:
        if (unfinished := observer.finished()) is not None:
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
    """What changes while a service runs."""

    def __init__(self, service: Service) -> None:
        self._service = service
        start = service.start
        self.wires = Wires(service.drivers, service.clock.now, self._take)
        self._aligner = Aligner(service.plan, math.nan if start is None else start.tick_s)
        self._pipeline = Pipeline(service.drive, service.estimator, service.self_test, service.gap)
        if start is not None:
            self._pipeline.restore(start.drive, start.estimator, start.gap)
        self._commands = Commands(
            service.plan.period_s,
            service.compensator,
            service.recorder,
            self._aligner.ingest,
            self._pipeline.reset,
            self._acknowledge,
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
        self._health: Health | None = None
        self._sent_s = self._looked_s = -math.inf

    def snapshot(self) -> Snapshot | None:
        """Where the pipeline stands after its last step, None while the estimator knows nothing yet."""
        snapshot, compensator, gap = self._service.start, self._service.compensator, self._service.gap
        if self._last is not None:
            states = self._pipeline.snapshot()
            known = None if gap is None else gap.state
            snapshot = Snapshot(float(self._last.frame.time_s[0]), *states, gap=known)
        if snapshot is None or not snapshot.estimator.started:
            return None
        return snapshot if compensator is None else replace(snapshot, compensation=compensator.held)

    def _acknowledge(self, name: str | None) -> str | None:
        """Mark an alarm as seen, published at the next look; returns why not."""
        self._looked_s = -math.inf
        return self._service.acknowledge(name)

    def _take(self, name: str, reading: Reading) -> None:
        """Take a reading: none from the future; a late one keeps its time, one far too late is a fault."""
        now_s = self._service.clock.now()
        time_s = reading.time_s if reading.time_s <= now_s else now_s
        if time_s < self._newest_s[name] - _LATE_S:
            faults = dict.fromkeys(reading.values, "time_backwards")
            reading = Reading(now_s, dict.fromkeys(reading.values, math.nan), faults)
        else:
            self._newest_s[name] = max(time_s, self._newest_s[name])
            reading = Reading(time_s, reading.values, reading.faults)
        self._samples[name] += 1
        used = self._aligner.ingest(reading)
        if self._service.recorder is not None:
            self._service.recorder.reading(used)

    async def tick_until_renewed(self) -> Renewal[Any] | None:
        """Tick at the whole multiples of the period, until the parts are to be built anew.

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
            if renewal := self._renewal():
                return replace(renewal, snapshot=self.snapshot(), last=self._last)

    def _renewal(self) -> Renewal[Any] | None:
        renewals, clock = self._service.renewals, self._service.clock
        return None if renewals is None else renewals.due(clock.now(), clock.offset_s())

    def _tick(self, time_s: float) -> None:
        self.wires.drain()  # what came while this tick was waiting for its turn belongs to it
        self._commands.before_step(self._service.publisher.commands(), time_s)
        frame = self._aligner.tick(time_s)
        changed = self._estimate_of(frame)  # first: what nobody waits for comes after
        for observer in self._service.observers:
            observer.see(frame)
        if self._service.recorder is not None:
            self._service.recorder.tick(float(frame.time_s[0]))
        changed |= self._frame is None or bool((frame.quality != self._frame.quality).any())
        self._frame = frame
        self._commands.after_step(time_s)
        now_s = self._service.clock.now()
        if changed or now_s - self._looked_s >= _LOOK_S:
            self._looked_s = now_s
            self._report(now_s)

    def _estimate_of(self, frame: FrameBlock) -> bool:
        """Step and publish; says whether the estimate's quality has changed."""
        compensator = self._service.compensator
        if compensator is not None:
            compensator.see_clock(self._service.clock.offset_s())
        try:
            estimate = self._pipeline.step(frame)
        except Exception as error:  # reported as invalid; the watchdog is not pinged
            changed = self._failure is None
            self._failure = f"{type(error).__name__}: {error}"
            if changed:
                log.error("step failed", exc_info=True)
            if compensator is not None:
                self._compensation(compensator.fail(float(frame.time_s[0]), self.count, self._failure))
            return changed
        self._service.publisher.publish(estimate, self.count)
        self._service.publisher.readings(frame, self.count)
        if compensator is not None:
            if (rival := self._service.publisher.status.rival) is not None:
                compensator.disarm(f"{rival}, then arm again")
            control = self._service.control
            if control is not None and control.failure is not None and compensator.reason is None:
                compensator.disarm(f"{control.failure}; arm again")
            self._compensation(compensator.step(estimate, frame, self.count))
        self.count += 1
        now_s = self._service.clock.now()
        self._last = Step(frame, self._pipeline.inputs, estimate, now_s, self.snapshot)
        for observer in self._service.observers:
            observer.follow(self._last)
        self._ping()
        before, self._estimate = self._estimate, EstimateQuality(estimate.quality[0])
        self._had_estimate |= self._estimate != EstimateQuality.INVALID
        self._failure = None
        return before != self._estimate

    def _compensation(self, document: Mapping[str, Any]) -> None:
        """Send the compensation to the subscribers and the control."""
        self._service.publisher.document("compensation", document)
        if self._service.control is not None:
            self._service.control.take(document)

    def _ping(self) -> None:
        """Report to the service manager that a cycle is complete and, if so, that all threads are alive."""
        words = ["READY=1"] if self.count == 1 else []
        words += ["WATCHDOG=1"] if self._all_alive() else []
        if words:
            self._service.notify("\n".join(words))

    def _all_alive(self) -> bool:
        """Whether every thread that the service needs is alive; if not, the watchdog is not pinged."""
        service = self._service
        parts = (self.wires, service.publisher.status, service.recorder, *service.observers)
        return all(part is None or part.alive for part in parts)

    def _notices(self) -> Iterator[str]:
        """What is wrong beside the estimates."""
        service = self._service
        if not self.wires.alive:
            yield "drivers: their thread has ended; restart the service"
        for observer in service.observers:
            yield from observer.notices()
        if service.control is not None and service.control.failure is not None:
            yield f"compensation: {service.control.failure}"
        if service.renewals is not None:
            yield from service.renewals.notices()

    def _report(self, now_s: float) -> None:
        """Publish the health when it has changed or five seconds have passed."""
        service, statuses = self._service, self.wires.statuses()
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
            service.recorder.status if service.recorder else None,
            service.publisher.status,
            service.clock.offset_s(),
            self._pipeline.findings,
            tuple(self._notices()),
            None if service.gap is None else service.gap.figures,
            None if service.gap is None else service.gap.departure,
            service.sensors,
        )
        health = assess(facts)
        for observer in service.observers:
            observer.report(facts)
        changed = self._health is None or health.essence != self._health.essence
        if changed:
            log.info("health", state=health.state, reasons=health.reasons)
        if changed or now_s - self._sent_s >= HEALTH_PERIOD_S:
            self._health, self._sent_s = health, now_s
            document = health.document() | {"adoption": None, "instance": service.instance}
            for observer in service.observers:
                document |= observer.health()
            service.publisher.document("health", document)
