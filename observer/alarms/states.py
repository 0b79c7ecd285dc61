"""Alarms: their kinds, and their life by ISA-18.2 (2016): raised, acknowledged, returned, gone.

Severities are those of EPICS; *invalid* means that a value cannot be used at all. Pure: conditions and times
go in, frozen alarms come out.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any, Literal, NamedTuple

Severity = Literal["minor", "major", "invalid"]


class AlarmKind(NamedTuple):
    """A kind of alarm.

    It is raised once its condition has held for `on_s` and returns to normal once it has not held for
    `off_s`; one that is `latched` stays until it is acknowledged. `remedy` says what to do.
    """

    severity: Severity
    on_s: float
    off_s: float
    latched: bool
    remedy: str


KINDS: dict[str, AlarmKind] = {
    "sensor_fault": AlarmKind(
        "major", 5.0, 10.0, False,
        "check the sensor's plug, its cable and the module's status; the estimate continues without it",
    ),
    "sensor_stuck": AlarmKind(
        "major", 0.0, 60.0, True,
        "the value no longer changes: check whether the sensor has come loose or the module hangs",
    ),
    "sensor_disagrees": AlarmKind(
        "minor", 600.0, 600.0, True,
        "compare the sensor with another thermometer while the machine is cold; put its offset_K into the "
        "configuration, or replace it",
    ),
    "heat_high": AlarmKind(
        "major", 0.0, 3600.0, True,
        "more heat than learnt for this speed and temperature: check lubrication, preload and bearing "
        "before the next shift; the trend shows how much time is left",
    ),
    "heat_low": AlarmKind(
        "minor", 0.0, 3600.0, True,
        "less heat than learnt for this speed and temperature, as when preload or belt tension is lost: "
        "measure the backlash, check the preload of nut and bearings",
    ),
    "heat_off_law": AlarmKind(
        "minor", 600.0, 86_400.0, False,
        "check unit and position of the channels that this heat's law reads; `observer calibrate` "
        "refits the law",
    ),
    "model_inconsistent": AlarmKind(
        "minor", 0.0, 600.0, True,
        "run `observer discover --recent 8h`, which names the missing effect",
    ),
    "wire": AlarmKind(
        "major", 5.0, 10.0, False,
        "check power, cable and address of the device; the service retries automatically",
    ),
    "disk": AlarmKind(
        "major", 10.0, 60.0, False, "free space or fix the folder that recordings are written to"
    ),
    "compensation": AlarmKind(
        "major", 0.0, 0.0, True,
        "remove the cause that the alarm names, check that `observer health` shows good estimates, then arm "
        "again with `observer arm`",
    ),
    "clock": AlarmKind(
        "minor", 0.0, 60.0, True,
        "check the computer's time service; compare times before and after with care",
    ),
    "estimate": AlarmKind(
        "invalid", 0.0, 10.0, True,
        "the estimator failed: keep the recording and the log, restart the service",
    ),
}  # fmt: skip

_STRANGE = re.compile(r"[^A-Za-z0-9_.-]")

State = Literal["pending", "unacknowledged", "acknowledged", "returned"]


@dataclass(frozen=True, slots=True)
class AlarmCause:
    """What raises an alarm: its kind and target, the reason in words, and the figures behind it.

    `name` distinguishes causes of one kind and target.
    """

    kind: str
    target: str
    reason: str
    name: str | None = None
    evidence: Mapping[str, Any] | None = None

    @property
    def id(self) -> str:
        """The alarm's id: the same whenever the same condition returns."""
        return _STRANGE.sub("_", ".".join(filter(None, (self.kind, self.target, self.name))))


@dataclass(frozen=True, slots=True)
class Alarm:
    """An alarm: its state, and its condition with the times it began and was last seen."""

    state: State
    since_s: float
    seen_s: float
    condition: AlarmCause = field(repr=False)

    @property
    def is_raised(self) -> bool:
        """Whether it is shown: a condition that has not lasted long enough is not."""
        return self.state != "pending"


Alarms = Mapping[str, Alarm]


def advance(alarms: Alarms, causes: Iterable[AlarmCause], time_s: float) -> dict[str, Alarm]:
    """Return the alarms at a moment, of those before and of what holds now."""
    holding = {cause.id: cause for cause in causes}
    kept = {
        name: after
        for name, alarm in alarms.items()
        if name not in holding and (after := _without(alarm, time_s)) is not None
    }
    return kept | {name: _with(alarms.get(name), condition, time_s) for name, condition in holding.items()}


def acknowledged(alarms: Alarms, name: str | None = None) -> dict[str, Alarm]:
    """Return the alarms after somebody has seen the one of this name, or all; what had returned is gone."""
    seen = {n for n, alarm in alarms.items() if name in (None, n) and alarm.is_raised}
    return {
        n: replace(alarm, state="acknowledged") if n in seen else alarm
        for n, alarm in alarms.items()
        if not (n in seen and alarm.state == "returned")
    }


def _with(alarm: Alarm | None, condition: AlarmCause, time_s: float) -> Alarm:
    """The alarm while its condition holds."""
    if alarm is None:
        alarm = Alarm("pending", time_s, time_s, condition)
    state, since_s = alarm.state, alarm.since_s
    if state == "returned":
        state, since_s = "unacknowledged", time_s
    if state == "pending" and time_s - since_s >= KINDS[condition.kind].on_s:
        state = "unacknowledged"
    return Alarm(state, since_s, time_s, condition)


def _without(alarm: Alarm, time_s: float) -> Alarm | None:
    """The alarm while its condition does not hold; None once it is gone."""
    kind = KINDS[alarm.condition.kind]
    if not alarm.is_raised:
        return None
    if alarm.state == "returned" or time_s - alarm.seen_s < kind.off_s:
        return alarm
    if kind.latched and alarm.state == "unacknowledged":
        return replace(alarm, state="returned")
    return None


def moved(alarm: Alarm, by_s: float) -> Alarm:
    """The alarm with all its times moved by `by_s`, for a service that takes over a new time."""
    evidence = alarm.condition.evidence
    if evidence is not None and evidence.get("since_s") is not None:
        evidence = {**evidence, "since_s": evidence["since_s"] + by_s}
    condition = replace(alarm.condition, evidence=evidence)
    return Alarm(alarm.state, alarm.since_s + by_s, alarm.seen_s + by_s, condition)


def alarm_of(plain: Mapping[str, Any]) -> Alarm:
    """An alarm from plain data; raises `ValueError`, `KeyError` or `TypeError` where it is not one."""
    condition = AlarmCause(**plain["condition"])
    if condition.kind not in KINDS:
        raise ValueError(f"kind {condition.kind}")
    return Alarm(plain["state"], float(plain["since_s"]), float(plain["seen_s"]), condition)


SMOOTH_H = 4.0
"""Time constant of the present offset, in hours of good estimates."""
CLEAR = 0.6
"""The fraction of the limit below which a sensor no longer counts as moved."""
_SURE = 1 / 3
"""An offset whose σ exceeds this fraction of the limit is not judged."""


class KnownOffset(NamedTuple):
    """What is known of a sensor's offset after `hours`: its usual value and its present one."""

    hours: float = 0.0
    usual_K: float = 0.0
    now_K: float = 0.0
    moved: bool = False


def taken(
    known: KnownOffset, offset_K: float, sigma_K: float, hours: float, learn_h: float, limit_K: float
) -> KnownOffset:
    """Return what is known after `hours` more of an estimated offset; an uncertain one is ignored."""
    if not sigma_K < _SURE * limit_K:
        return known
    total_h = known.hours + hours
    usual_K = known.usual_K
    if known.hours < learn_h:
        usual_K += hours / total_h * (offset_K - usual_K)
    now_K = known.now_K + hours / min(total_h, SMOOTH_H) * (offset_K - known.now_K)
    limit_K *= CLEAR if known.moved else 1.0
    return KnownOffset(total_h, usual_K, now_K, total_h > learn_h and abs(now_K - usual_K) > limit_K)


def offset_of(plain: Mapping[str, Any]) -> KnownOffset:
    """An offset from plain data; raises `ValueError`, `KeyError` or `TypeError` where it is not one."""
    hours, usual_K, now_K = (float(plain[key]) for key in ("hours", "usual_K", "now_K"))
    if not math.isfinite(hours + usual_K + now_K):
        raise ValueError("an offset is not a number")
    return KnownOffset(hours, usual_K, now_K, bool(plain["moved"]))
