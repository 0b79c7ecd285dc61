"""The health of the service: one state, the reasons for it, and the counts behind them."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

from drivers.protocol import DriverStatus
from observer.estimators.selftest import Fault, Finding
from observer.exchange import PublishStatus
from observer.frames import EstimateQuality, FrameBlock, Quality
from observer.process.clock import STEP_S
from observer.quality.reasons import channel_sentence, sentence, unexplained
from observer.record.recorder import RecordStatus

HEALTH_PERIOD_S = 5.0
_DIGITS = 4
_FIGURES = re.compile(r"(?<![\w.])[-+]?\d[\d.]*(?:e[-+]?\d+)?")  # and no digit of a name, as of t3
_LEFT_OUT = {Fault.EXCLUDED: "K", Fault.SWAPPED: "K", Fault.LEAPT: "m"}
"""What has a channel left out, and the unit of what that reads too much."""


@dataclass(frozen=True, slots=True)
class Facts:
    """All that a health report is made of, gathered at one moment.

    `frame` and `estimate` are those of the last cycle, None before the first; `had_estimate` says that a
    valid estimate has been there; `failure` is what the last cycle failed with; `findings` what the self-test
    says; `notices` are more reasons; `gap` what is known of the open-loop prediction's; `sensors` are the
    names of the channels that are sensors'.
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
    sensors: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class Health:
    """How the service fares.

    `state` is `starting`, `good`, `degraded`, `stale` or `invalid`; `quality` that of the estimates, which is
    `invalid` before the first; `reasons` are sentences for people. Of each channel its `quality`, the `age_s`
    of its last usable value (None before the first) and its `fault`; one that comes as it should and is left
    out of the estimate is `excluded`. What is left out has an `excess`: by how much it reads too much, as
    `value`, its standard deviation `sigma` (both None while not known), and their `unit`.
    """

    time_s: float
    state: str
    quality: str
    reasons: tuple[str, ...]
    channels: Mapping[str, Mapping[str, Any]]
    counts: Mapping[str, Any]

    @property
    def essence(self) -> tuple[Any, ...]:
        """What makes a report worth sending at once when it changes: everything but ages, counts and the
        figures within the reasons.
        """
        reasons = tuple(_FIGURES.sub("", reason) for reason in self.reasons)
        return self.state, self.quality, reasons, tuple((n, c["quality"]) for n, c in self.channels.items())

    def document(self) -> dict[str, Any]:
        """The report as it is published."""
        head = {"time_s": self.time_s, "state": self.state, "quality": self.quality}
        return {**head, "reasons": self.reasons, "channels": self.channels, **self.counts}


def assess(facts: Facts) -> Health:
    """Judge the facts."""
    channels = _channels(facts)
    reasons = tuple(_reasons(facts, channels)) or tuple(_unexplained(facts))
    record = facts.record or RecordStatus()
    counts = {
        "drivers": {
            name: {
                "connected": status.connected,
                "samples": samples,
                "drops": status.drops,
                "errors": status.errors,
                "reconnects": status.reconnects,
            }
            for name, (status, samples) in facts.drivers.items()
        },
        "cycles": facts.cycles,
        "overruns": facts.overruns,
        "published": facts.publish.published,
        "publish_drops": facts.publish.dropped,
        "publish_reconnects": facts.publish.reconnects,
        "recorded": record.rows_written,
        "record_drops": record.rows_dropped,
        "recording": str(record.path) if record.path else None,
        "clock_offset_s": round(facts.clock_offset_s, 3),
        "gap": facts.gap,
    }
    state = _state(facts, bool(reasons))
    return Health(facts.time_s, state, _quality(facts).label, reasons, channels, counts)


def _quality(facts: Facts) -> EstimateQuality:
    """The estimates' own quality, whatever is wrong beside them."""
    if facts.failure or facts.estimate is None:
        return EstimateQuality.INVALID
    return facts.estimate


def _state(facts: Facts, has_reasons: bool) -> str:
    if facts.failure:
        return EstimateQuality.INVALID.label
    if facts.estimate is None or (facts.estimate == EstimateQuality.INVALID and not facts.had_estimate):
        return "starting"
    if facts.estimate == EstimateQuality.GOOD and has_reasons:
        return EstimateQuality.DEGRADED.label
    return facts.estimate.label


def _channels(facts: Facts) -> dict[str, dict[str, Any]]:
    if facts.frame is None:
        return {}
    frame, excess = facts.frame, _excess(facts)
    channels = {}
    for j, name in enumerate(frame.channels):
        quality, age_s = Quality(frame.quality[-1, j]), float(frame.age_s[-1, j])
        if name in excess and quality == Quality.GOOD:
            quality = Quality.EXCLUDED
        channels[name] = {
            "quality": quality.label,
            "age_s": round(age_s, 3) if math.isfinite(age_s) else None,
            "fault": facts.faults.get(name),
            **excess.get(name, {}),
        }
    return channels


def _excess(facts: Facts) -> dict[str, dict[str, Any]]:
    """Of the channels that are left out, what they read too much."""
    channels = {sensor: channel for channel, sensor in facts.sensors.items()}
    found = {}
    for finding in facts.findings:
        if (unit := _LEFT_OUT.get(finding.fault)) is not None:
            first, _, _ = finding.subject.partition(", ")  # of two that were exchanged, the one it is about
            name = first if finding.fault is Fault.LEAPT else channels.get(first, first)
            value = round(finding.value, _DIGITS) if math.isfinite(finding.value) else None
            sigma = round(finding.expected, _DIGITS) if finding.expected > 0.0 else None
            found[name] = {"excess": {"value": value, "sigma": sigma, "unit": unit}}
    return found


def _unexplained(facts: Facts) -> Iterator[str]:
    """What is said of an estimate that is not good where nothing else says why."""
    if facts.frame is None or facts.estimate is None:
        yield "no estimate yet: the first step is still to come"
    elif facts.estimate != EstimateQuality.GOOD:
        yield unexplained(facts.estimate)


def _reasons(facts: Facts, channels: Mapping[str, Mapping[str, Any]]) -> Iterator[str]:
    if facts.failure:
        yield f"the estimator's step failed: {facts.failure}"
    for name, channel in channels.items():
        quality, fault = channel["quality"], channel["fault"]
        if quality not in (Quality.GOOD.label, Quality.EXCLUDED.label):  # a finding reports these
            yield channel_sentence(name, quality, fault)
    yield from dict.fromkeys(map(sentence, facts.findings))
    for name, (status, _) in facts.drivers.items():
        if not status.connected:
            why = f": {status.last_error}" if status.last_error else ""
            yield f"driver {name} is not connected{why}"
    if facts.record and facts.record.reason:
        yield f"recording: {facts.record.reason}"
    if facts.publish.reason:
        yield f"publishing: {facts.publish.reason}"
    yield from facts.notices
    if abs(facts.clock_offset_s) > STEP_S:
        step = f"{facts.clock_offset_s:+.1f} s"
        yield f"the computer's clock stepped by {step}; times go on from the service's start"
