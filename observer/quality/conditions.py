"""Problems as one list of typed conditions, from which health, alarms and sentences are made.

A condition is identified by its kind and its subject. Its sentence (`quality.kinds`) is made last and is
never compared or parsed.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

from drivers.protocol import DriverStatus
from observer.bus.exchange import PublishStatus
from observer.estimators.selftest import Fault, Finding
from observer.frames import EstimateQuality, FrameBlock, Quality
from observer.process.clock import STEP_S
from observer.quality.gap import Departure
from observer.quality.kinds import KIND_OF_FAULT, Condition, ConditionKind
from observer.record.recorder import RecordStatus


@dataclass(frozen=True, slots=True)
class Facts:
    """The facts behind conditions and a health report, gathered at one moment.

    Attributes:
        time_s: The moment, in s of the service's clock.
        frame: The frame of the last cycle; None before the first.
        faults: The present fault of each faulty channel.
        estimate: The quality of the last estimate; None before the first.
        had_estimate: Whether there has been a valid estimate.
        failure: The error of the last cycle; None without.
        cycles: Estimates so far.
        overruns: Ticks that were missed.
        drivers: The status of each driver, and its readings so far.
        record: The state of the recording; None if nothing is recorded.
        publish: The state of publishing.
        clock_offset_s: How far the computer's clock is ahead.
        findings: Those of the self-test and the screening.
        notices: Further reasons, in words.
        gap: The figures of the open-loop prediction; None before an hour of work.
        departure: The part of its residual beyond the tolerances; None without.
        sensors: The names of sensors by channel.
        used_sensors: Those that the last estimate uses.
        observed: Problems beside the estimates, such as those of the compensation.
        service: The options that name the machine and axis to a command.
        error_known_to_um: Half of the 95 % interval of the thermal error at the nut, or the largest along the
            screw where the place of the nut is unknown; None if it is not known.
    """

    time_s: float
    frame: FrameBlock | None
    faults: Mapping[str, str]
    estimate: EstimateQuality | None
    had_estimate: bool
    failure: str | None
    cycles: int
    overruns: int
    drivers: Mapping[str, tuple[DriverStatus, int]]
    record: RecordStatus | None
    publish: PublishStatus
    clock_offset_s: float
    findings: tuple[Finding, ...] = ()
    notices: tuple[str, ...] = ()
    gap: Mapping[str, Any] | None = None
    departure: Departure | None = None
    sensors: Mapping[str, str] = field(default_factory=dict)
    used_sensors: frozenset[str] = frozenset()
    observed: tuple[Condition, ...] = ()
    service: str = ""
    error_known_to_um: float | None = None

    @property
    def degraded_sensors(self) -> tuple[str, ...]:
        """The names of the sensors that the last estimate does not use; all of them after a failed step."""
        used = frozenset() if self.failure else self.used_sensors
        return tuple(name for name in self.sensors.values() if name not in used)


def of_finding(finding: Finding, service: str = "") -> Condition:
    """Return the condition of a finding.

    Args:
        finding: One of the self-test or the screening.
        service: The options that name the machine and axis, for a remedy that is a command.
    """
    detail = service if finding.fault is Fault.LEAPT else ""
    return Condition(
        KIND_OF_FAULT[finding.fault], finding.subject, detail, finding.since_s, finding.value,
        finding.expected, finding.other, unit=finding.unit, returns_s=finding.returns_s,
    )  # fmt: skip


def of_departure(departure: Departure) -> Condition:
    """Return the condition that the prediction has departed from a sensor."""
    return Condition(
        ConditionKind.DEPARTED,
        departure.sensor,
        departure.phase,
        departure.since_s,
        departure.rms_K,
        departure.allowed_K,
    )


def of_channel(name: str, quality: Quality, fault: str | None = None) -> Condition:
    """Return the condition of a channel that is not good.

    Args:
        name: The channel.
        quality: Its quality, not good.
        fault: Its fault; None if it has none, as for a stale value.
    """
    return Condition(ConditionKind.CHANNEL, name, fault or "", quality=quality)


def conditions(facts: Facts) -> tuple[Condition, ...]:
    """Return all problems, in a fixed order of their kinds.

    An estimate that is not good always has a reason: one is added if no other problem concerns field and
    thermal error.
    """
    problems = tuple(_problems(facts))
    is_explained = not all(condition.kind.value.is_beside_the_error for condition in problems)
    return problems if is_explained else (*problems, *_unexplained(facts))


def _problems(facts: Facts) -> Iterator[Condition]:
    if facts.failure:
        yield Condition(ConditionKind.STEP_FAILED, detail=facts.failure)
    if (frame := facts.frame) is not None:
        for name, quality in zip(frame.channels, frame.quality[-1].tolist(), strict=True):
            if quality != Quality.GOOD:
                yield of_channel(name, Quality(quality), facts.faults.get(name))
    yield from (of_finding(finding, facts.service) for finding in facts.findings)
    for name, (status, _) in facts.drivers.items():
        if not status.connected:
            kind = ConditionKind.SILENT if status.is_silent else ConditionKind.DRIVER
            yield Condition(kind, name, status.last_error or "")
        if status.bus_error:
            yield Condition(ConditionKind.BUS, name, status.bus_error, value=status.error_frames)
    if facts.record and facts.record.reason:
        yield Condition(ConditionKind.RECORDING, detail=facts.record.reason)
    if facts.publish.reason:
        yield Condition(ConditionKind.PUBLISHING, detail=facts.publish.reason)
    if facts.departure is not None:
        yield of_departure(facts.departure)
    yield from facts.observed
    for notice in facts.notices:
        yield Condition(ConditionKind.NOTICE, detail=notice)
    if abs(facts.clock_offset_s) > STEP_S:
        yield Condition(ConditionKind.CLOCK, value=facts.clock_offset_s)


def _unexplained(facts: Facts) -> Iterator[Condition]:
    """The condition of an estimate that is not good although no other problem explains it."""
    if facts.frame is None or facts.estimate is None:
        yield Condition(ConditionKind.NO_ESTIMATE)
    elif facts.estimate == EstimateQuality.STARTING:
        yield Condition(ConditionKind.JUST_BEGUN)
    elif facts.estimate != EstimateQuality.GOOD:
        yield Condition(ConditionKind.UNEXPLAINED, quality=facts.estimate)
