"""What holds now that somebody should come for, from what the loop knows at one moment."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence

from observer.alarms.states import Condition
from observer.estimators.selftest import Fault, Finding
from observer.frames import FrameBlock, Quality
from observer.quality.gap import Departure
from observer.quality.health import Facts
from observer.quality.reasons import departure_sentence, sentence

_CLOCK_STEP_S = 0.5
_STUCK, _DISCONNECTED = "stuck", "disconnected"
_RESTLESS = 3.0
"""Times as restless as configured, from which it is worth a way to the sensor."""


def conditions(facts: Facts, departure: Departure | None, sensors: Mapping[str, str]) -> Iterator[Condition]:
    """What holds now; `sensors` are the names of the channels that are sensors'."""
    if facts.failure:
        yield Condition("estimate", "estimator", facts.failure)
    lost = {name for name, (status, _) in facts.drivers.items() if not status.connected}
    for name in sorted(lost):
        error = facts.drivers[name][0].last_error
        yield Condition("wire", name, f"driver {name} is not connected" + (f": {error}" if error else ""))
    if facts.frame is not None:
        yield from _of_channels(facts.frame, facts.faults, sensors)
    yield from _of_findings(facts.findings, set(sensors.values()))
    if departure is not None:
        evidence = {"rms_K": departure.rms_K, "allowed_K": departure.allowed_K, "since_s": departure.since_s}
        yield Condition(
            "model_inconsistent", departure.sensor, departure_sentence(departure), evidence=evidence
        )
    if facts.record is not None and facts.record.reason:
        yield Condition("disk", "recording", facts.record.reason)
    if abs(facts.clock_offset_s) > _CLOCK_STEP_S:
        yield Condition("clock", "computer", f"the computer's clock stepped by {facts.clock_offset_s:+.1f} s")


def _of_channels(
    frame: FrameBlock, faults: Mapping[str, str], sensors: Mapping[str, str]
) -> Iterator[Condition]:
    """Channels that give no value, but those of a wire that is gone: the wire's alarm tells of them."""
    for j, channel in enumerate(frame.channels):
        quality, fault = Quality(frame.quality[-1, j]), faults.get(channel)
        if quality == Quality.GOOD or fault == _DISCONNECTED:
            continue
        what, name = fault or quality.label, sensors.get(channel, channel)
        kind = "sensor_stuck" if what == _STUCK else "sensor_fault"
        yield Condition(kind, name, f"channel {channel} is {quality.label} ({what})", name=what)


def _of_findings(findings: Sequence[Finding], sensors: set[str]) -> Iterator[Condition]:
    """Of what the self-test finds, what is worth a way to the machine.

    It judges what an estimate is good for, and a hundredth of a kelvin lowers that: means and correlations
    of innovations are reasons of the quality, and no alarms.
    """
    for finding in findings:
        figures = {"value": finding.value, "expected": finding.expected, "since_s": finding.since_s}
        evidence = {key: value if math.isfinite(value) else None for key, value in figures.items()}
        restless = finding.fault is Fault.NOISY and finding.value >= _RESTLESS
        if finding.subject in sensors and (restless or finding.fault is Fault.REFUSED):
            name = finding.fault.name.lower()
            yield Condition("sensor_disagrees", finding.subject, sentence(finding), name, evidence)
        elif finding.fault in (Fault.OFF_LAW, Fault.ALL_OFF_LAW):
            yield Condition("heat_off_law", finding.subject or "all", sentence(finding), evidence=evidence)
