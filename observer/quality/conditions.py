"""Problems as one list of typed conditions, from which health, alarms and sentences are made.

A condition is identified by its kind and by what it is about. Its sentence is made last (`quality.reasons`)
and is never compared or parsed.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from enum import Enum, auto
from typing import Any

from drivers.protocol import DriverStatus
from observer.estimators.selftest import Fault, Finding
from observer.exchange import PublishStatus
from observer.frames import EstimateQuality, FrameBlock, Quality
from observer.process.clock import STEP_S
from observer.quality.gap import Departure
from observer.record.recorder import RecordStatus


class Trouble(Enum):
    """Kinds of conditions beside those that the self-test and the screening find (`Fault`)."""

    STEP_FAILED = auto()
    CHANNEL = auto()
    DRIVER = auto()
    SILENT = auto()
    BUS = auto()
    RECORDING = auto()
    PUBLISHING = auto()
    DEPARTED = auto()
    NOTICE = auto()
    CLOCK = auto()
    NO_ESTIMATE = auto()
    JUST_BEGUN = auto()
    UNEXPLAINED = auto()
    OFFSET_MOVED = auto()
    HEAT_HIGH = auto()
    HEAT_LOW = auto()
    HEATS_TOGETHER = auto()
    RELEASED = auto()
    NOT_ZEROED = auto()


OF_COMPENSATION = (Trouble.RELEASED, Trouble.NOT_ZEROED)
BESIDE_THE_ERROR = (*OF_COMPENSATION, Fault.UNKNOWN)
"""The kinds that say nothing of field and thermal error; of heats alone the last one does."""


@dataclass(frozen=True, slots=True)
class Condition:
    """One problem.

    `about` is the sensor, channel, source or driver, and `other` one that shares it; `detail` a fault or a
    phase in one word, or the words of whoever reports it; `value`, `expected` and `unit` as in `Finding`, NaN
    without; `quality` that of a channel or of the estimate; `returns_s` as in `Finding`.
    """

    kind: Trouble | Fault
    about: str = ""
    detail: str = ""
    since_s: float = math.nan
    value: float = math.nan
    expected: float = math.nan
    other: str = ""
    quality: Quality | EstimateQuality | None = None
    unit: str = "K"
    returns_s: float = math.nan

    @property
    def identity(self) -> tuple[Any, ...]:
        """The identity of the condition, whatever its present figures."""
        returns = math.isfinite(self.returns_s)
        return self.kind, self.about, self.other, self.detail, self.quality, returns

    def document(self, reason: str) -> dict[str, Any]:
        """The condition as it is published, with its sentence."""
        return {
            "kind": self.kind.name.lower(),
            "about": [name for name in (self.about, self.other) if name],
            "since_s": self.since_s if math.isfinite(self.since_s) else None,
            "reason": reason,
        }


@dataclass(frozen=True, slots=True)
class Facts:
    """The facts behind conditions and a health report, gathered at one moment.

    `frame` and `estimate` are those of the last cycle, None before the first; `had_estimate` says that a
    valid estimate has been there; `failure` is the error of the last cycle; `findings` those of the self-test
    and the screening; `notices` are more reasons, in words; `gap` the figures of the open-loop prediction,
    `departure` what is beyond its tolerances; `sensors` maps the sensors' channels to their names;
    `used_sensors` are the names of those that the last estimate uses; `observed` are the problems beside the
    estimates, such as those of the compensation; `service` are the options that name the machine and axis to
    a command. `error_known_to_um` is half of the 95 % interval of the thermal error at the nut, or the
    largest along the screw where the nut's place is unknown.
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
        """The names of the sensors that the last estimate does not use."""
        used = frozenset() if self.failure else self.used_sensors
        return tuple(name for name in self.sensors.values() if name not in used)


def of_finding(found: Finding, service: str = "") -> Condition:
    """The condition that the self-test or the screening has found; `service` are options of a command."""
    detail = service if found.fault is Fault.LEAPT else ""
    return Condition(
        found.fault, found.subject, detail, found.since_s, found.value, found.expected, found.other,
        unit=found.unit, returns_s=found.returns_s,
    )  # fmt: skip


def of_departure(found: Departure) -> Condition:
    """The condition that the prediction has departed from a sensor."""
    return Condition(Trouble.DEPARTED, found.sensor, found.phase, found.since_s, found.rms_K, found.allowed_K)


def of_channel(name: str, quality: Quality, fault: str | None = None) -> Condition:
    """The condition of a channel that is not good: its quality, and its driver's or aligner's fault."""
    return Condition(Trouble.CHANNEL, name, fault or "", quality=quality)


def conditions(facts: Facts) -> tuple[Condition, ...]:
    """All problems; an unexplained one only where nothing is found that concerns field and thermal error."""
    found = tuple(_found(facts))
    is_explained = any(condition.kind not in BESIDE_THE_ERROR for condition in found)
    return found if is_explained else (*found, *_unexplained(facts))


def _found(facts: Facts) -> Iterator[Condition]:
    if facts.failure:
        yield Condition(Trouble.STEP_FAILED, detail=facts.failure)
    if (frame := facts.frame) is not None:
        for name, quality in zip(frame.channels, frame.quality[-1].tolist(), strict=True):
            if quality != Quality.GOOD:
                yield of_channel(name, Quality(quality), facts.faults.get(name))
    yield from (of_finding(finding, facts.service) for finding in facts.findings)
    for name, (status, _) in facts.drivers.items():
        if not status.connected:
            kind = Trouble.SILENT if status.is_silent else Trouble.DRIVER
            yield Condition(kind, name, status.last_error or "")
        if status.bus_error:
            yield Condition(Trouble.BUS, name, status.bus_error, value=status.error_frames)
    if facts.record and facts.record.reason:
        yield Condition(Trouble.RECORDING, detail=facts.record.reason)
    if facts.publish.reason:
        yield Condition(Trouble.PUBLISHING, detail=facts.publish.reason)
    if facts.departure is not None:
        yield of_departure(facts.departure)
    yield from facts.observed
    for notice in facts.notices:
        yield Condition(Trouble.NOTICE, detail=notice)
    if abs(facts.clock_offset_s) > STEP_S:
        yield Condition(Trouble.CLOCK, value=facts.clock_offset_s)


def _unexplained(facts: Facts) -> Iterator[Condition]:
    """The condition of an estimate that is not good although nothing else is found."""
    if facts.frame is None or facts.estimate is None:
        yield Condition(Trouble.NO_ESTIMATE)
    elif facts.estimate == EstimateQuality.STARTING:
        yield Condition(Trouble.JUST_BEGUN)
    elif facts.estimate != EstimateQuality.GOOD:
        yield Condition(Trouble.UNEXPLAINED, quality=facts.estimate)
