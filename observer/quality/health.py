"""The health of the service: one state, the reasons for it, and the counts behind them."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

from observer.estimators.selftest import Fault
from observer.frames import EstimateQuality, Quality
from observer.quality.conditions import Facts, conditions
from observer.quality.kinds import KIND_OF_FAULT, Condition, ConditionKind
from observer.record.recorder import RecordStatus

HEALTH_PERIOD_S = 5.0
_DIGITS, _DIGITS_OF_DISPLACEMENT = 4, 9


@dataclass(frozen=True, slots=True)
class Health:
    """A health report.

    Attributes:
        time_s: The time of the report.
        state: `starting`, `good`, `degraded`, `stale` or `invalid`.
        quality: That of the estimates, `invalid` before the first.
        conditions: The reasons for both.
        channels: `quality`, `age_s` of the last usable value (None before the first) and `fault` of each. A
            fresh channel that the estimate does not use has the quality `excluded`. Its `excess` has a
            `value`, a standard deviation `sigma` (None while unknown) and a `unit`.
        counts: Counts of drivers, cycles, publishing and recording, by name.
        sensors: How many sensors are configured.
        degraded_sensors: The sensors that the last estimate does not use.
        error_known_to_um: Half of the 95 % interval of the thermal error at the nut; None if it is not known.
    """

    time_s: float
    state: str
    quality: str
    conditions: tuple[Condition, ...]
    channels: Mapping[str, Mapping[str, Any]]
    counts: Mapping[str, Any]
    sensors: int
    degraded_sensors: tuple[str, ...]
    error_known_to_um: float | None

    @property
    def reasons(self) -> tuple[str, ...]:
        """The sentences, each once."""
        return tuple(dict.fromkeys(condition.sentence for condition in self.conditions))

    @property
    def essence(self) -> tuple[Any, ...]:
        """The part of a report whose change is sent at once: all but ages, counts and figures."""
        identities = tuple(condition.identity for condition in self.conditions)
        channels = tuple((name, channel["quality"]) for name, channel in self.channels.items())
        return self.state, self.quality, identities, channels, self.degraded_sensors

    def document(self) -> dict[str, Any]:
        """Return the published form of the report, the document of the key `health`."""
        head = {"time_s": self.time_s, "state": self.state, "quality": self.quality, "reasons": self.reasons}
        sensors = {
            "sensors_used": self.sensors - len(self.degraded_sensors),
            "sensors": self.sensors,
            "degraded_sensors": self.degraded_sensors,
            "error_known_to_um": self.error_known_to_um,
        }
        documents = [condition.document for condition in self.conditions]
        return {**head, **sensors, "conditions": documents, "channels": self.channels, **self.counts}


def assess(facts: Facts) -> Health:
    """Return the health report of the facts.

    The state is that of the estimates, but degraded instead of good where a problem concerns them. Problems
    of the compensation, of one heat alone, or of sensors that are not used do not change it.
    """
    problems = conditions(facts)
    record = facts.record or RecordStatus()
    counts = {
        "drivers": {
            name: {
                "connected": status.connected,
                "state": status.state,
                "samples": samples,
                "drops": status.drops,
                "errors": status.errors,
                "reconnects": status.reconnects,
                "error_frames": status.error_frames,
                "error_passive": status.error_passive,
                "bus_off": status.bus_off,
            }
            for name, (status, samples) in facts.drivers.items()
        },
        "cycles": facts.cycles,
        "overruns": facts.overruns,
        "published": facts.publish.published,
        "publish_drops": facts.publish.dropped,
        "publish_reconnects": facts.publish.reconnects,
        "unsent": facts.publish.unsent,
        "recorded": record.rows_written,
        "record_drops": record.rows_dropped,
        "recording": str(record.path) if record.path else None,
        "clock_offset_s": round(facts.clock_offset_s, 3),
        "gap": facts.gap,
    }
    state = _state(facts, problems)
    known_to_um = None if facts.error_known_to_um is None else round(facts.error_known_to_um, 3)
    return Health(
        facts.time_s, state, _quality(facts).label, problems, _channels(facts), counts, len(facts.sensors),
        facts.degraded_sensors, known_to_um,
    )  # fmt: skip


def _quality(facts: Facts) -> EstimateQuality:
    """The estimates' own quality, whatever other problems there are."""
    if facts.failure or facts.estimate is None:
        return EstimateQuality.INVALID
    return facts.estimate


def _state(facts: Facts, problems: Iterable[Condition]) -> str:
    """The state of the service: good as long as all problems are beside the estimates."""
    if facts.failure:
        return EstimateQuality.INVALID.label
    if facts.estimate is None or (facts.estimate == EstimateQuality.INVALID and not facts.had_estimate):
        return "starting"
    is_unaffected = all(_is_beside_the_estimates(condition, facts) for condition in problems)
    if facts.estimate == EstimateQuality.GOOD and not is_unaffected:
        return EstimateQuality.DEGRADED.label
    return facts.estimate.label


def _is_beside_the_estimates(condition: Condition, facts: Facts) -> bool:
    """Whether a condition is about the compensation or a heat alone, or about sensors that are not used."""
    if condition.kind.value.is_beside_the_error:
        return True
    if condition.kind is ConditionKind.CHANNEL:
        return facts.sensors.get(condition.about) in facts.degraded_sensors
    names = {condition.about, condition.other} - {""}
    excludes_sensors = condition.kind.value.excess_unit == "K"
    return excludes_sensors and names <= set(facts.degraded_sensors)


def _channels(facts: Facts) -> dict[str, dict[str, Any]]:
    if facts.frame is None:
        return {}
    frame, excess = facts.frame, _excess(facts)
    channels, qualities = {}, frame.shown_quality[-1].tolist()
    for j, name in enumerate(frame.channels):
        quality, age_s = Quality(qualities[j]), float(frame.age_s[-1, j])
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
    """The excess of excluded channels."""
    channels = {sensor: channel for channel, sensor in facts.sensors.items()}
    excesses = {}
    for finding in facts.findings:
        if (unit := KIND_OF_FAULT[finding.fault].value.excess_unit) is not None:
            name = finding.subject if finding.fault is Fault.LEAPT else channels.get(finding.subject, "")
            # a displacement's excess is in m, as a position's
            is_displacement = finding.unit == "um"
            size, digits = (1e-6, _DIGITS_OF_DISPLACEMENT) if is_displacement else (1.0, _DIGITS)
            value = round(size * finding.value, digits) if math.isfinite(finding.value) else None
            has_sigma = finding.expected > 0.0 and finding.fault is not Fault.LEAPT
            sigma = round(size * finding.expected, digits) if has_sigma else None
            excesses[name] = {
                "excess": {"value": value, "sigma": sigma, "unit": "m" if is_displacement else unit}
            }
    return excesses
