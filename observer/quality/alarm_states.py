"""The life of an alarm by ISA-18.2 (2016): raised, acknowledged, returned, gone; and moved sensor offsets.

Pure: conditions and times go in, frozen alarms come out.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

from observer.bus.exchange import SEVERITIES, AlarmState
from observer.quality.alarm_classes import ALARM_CLASSES

_NOT_IN_AN_ID = re.compile(r"[^A-Za-z0-9_.-]")


@dataclass(frozen=True, slots=True)
class AlarmCause:
    """The cause of an alarm.

    Attributes:
        kind: The name of its class.
        target: The sensor, source, driver or part that it concerns.
        reason: The condition in words.
        name: Distinguishes causes of one kind and target; None if there is only one.
        evidence: The figures behind it, by name; None without.
    """

    kind: str
    target: str
    reason: str
    name: str | None = None
    evidence: Mapping[str, Any] | None = None

    @property
    def id(self) -> str:
        """The alarm's id: the same whenever the same condition returns.

        It consists of letters, digits and _.-, so that it can be part of a key or a topic.
        """
        return _NOT_IN_AN_ID.sub("_", ".".join(filter(None, (self.kind, self.target, self.name))))


@dataclass(frozen=True, slots=True)
class Alarm:
    """An alarm.

    Attributes:
        state: `pending` before it is raised, then `unacknowledged`, `acknowledged`, or `returned` to normal
            but not acknowledged.
        since_s: When its condition began, in s of the service's clock.
        seen_s: When its condition last held.
        condition: The cause, with the figures of that moment.
    """

    state: AlarmState
    since_s: float
    seen_s: float
    condition: AlarmCause = field(repr=False)

    @property
    def is_raised(self) -> bool:
        """Whether it is shown: a condition that has not lasted long enough is not."""
        return self.state != "pending"

    @property
    def rank(self) -> tuple[bool, int]:
        """The place among raised alarms, the worst first: new before acknowledged, then by severity."""
        severity = ALARM_CLASSES[self.condition.kind].severity
        return self.state == "acknowledged", -SEVERITIES.index(severity)


Alarms = Mapping[str, Alarm]


def advance(alarms: Alarms, causes: Iterable[AlarmCause], time_s: float) -> dict[str, Alarm]:
    """Return the alarms at a time.

    An alarm whose condition returns before it was acknowledged keeps its id and begins anew.

    Args:
        alarms: The earlier alarms by id.
        causes: All present causes.
        time_s: The time in s of the service's clock, later than before.
    """
    holding = {cause.id: cause for cause in causes}
    remaining = {
        name: after
        for name, alarm in alarms.items()
        if name not in holding and (after := _without(alarm, time_s)) is not None
    }
    return remaining | {
        name: _with(alarms.get(name), condition, time_s) for name, condition in holding.items()
    }


def acknowledged(alarms: Alarms, name: str | None = None) -> dict[str, Alarm]:
    """Return the alarms after one, or all, were acknowledged; returned ones are gone then.

    Args:
        alarms: The alarms by id.
        name: The id of the alarm; None for all. Alarms that are not raised stay as they are.
    """
    selected = {n for n, alarm in alarms.items() if name in (None, n) and alarm.is_raised}
    return {
        n: replace(alarm, state="acknowledged") if n in selected else alarm
        for n, alarm in alarms.items()
        if not (n in selected and alarm.state == "returned")
    }


def _with(alarm: Alarm | None, condition: AlarmCause, time_s: float) -> Alarm:
    """The alarm while its condition holds."""
    if alarm is None:
        alarm = Alarm("pending", time_s, time_s, condition)
    state, since_s = alarm.state, alarm.since_s
    if state == "returned":
        state, since_s = "unacknowledged", time_s
    if state == "pending" and time_s - since_s >= ALARM_CLASSES[condition.kind].on_s:
        state = "unacknowledged"
    return Alarm(state, since_s, time_s, condition)


def _without(alarm: Alarm, time_s: float) -> Alarm | None:
    """The alarm while its condition does not hold; None once it is gone."""
    kind = ALARM_CLASSES[alarm.condition.kind]
    if not alarm.is_raised:
        return None
    if alarm.state == "returned" or time_s - alarm.seen_s < kind.off_s:
        return alarm
    if kind.latched and alarm.state == "unacknowledged":
        return replace(alarm, state="returned")
    return None


def moved(alarm: Alarm, by_s: float) -> Alarm:
    """Return the alarm with all its times moved, for a service that takes over a new time.

    Args:
        alarm: The alarm.
        by_s: The step of the computer's clock, in s.
    """
    evidence = alarm.condition.evidence
    if evidence is not None and evidence.get("since_s") is not None:
        evidence = {**evidence, "since_s": evidence["since_s"] + by_s}
    condition = replace(alarm.condition, evidence=evidence)
    return Alarm(alarm.state, alarm.since_s + by_s, alarm.seen_s + by_s, condition)


def alarm_of(plain: Mapping[str, Any]) -> Alarm:
    """Return an alarm from plain data, as a state file holds it.

    Raises:
        ValueError: If its class or a number is unknown.
        KeyError: If an entry is missing.
        TypeError: If an entry has another type, or there is one too many.
    """
    condition = AlarmCause(**plain["condition"])
    if condition.kind not in ALARM_CLASSES:
        raise ValueError(f"kind {condition.kind}")
    return Alarm(plain["state"], float(plain["since_s"]), float(plain["seen_s"]), condition)


SMOOTH_H = 4.0
"""Time constant of the present offset, in hours of good estimates."""
CLEAR = 0.6
"""The fraction of the limit below which a sensor no longer counts as moved."""
_SURE = 1 / 3
"""An offset whose σ exceeds this fraction of the limit is not judged."""


class KnownOffset(NamedTuple):
    """The learnt offset of a sensor.

    Attributes:
        hours: Hours of good estimates so far.
        usual_K: The mean over the first hours, in K.
        now_K: The smoothed present offset, in K.
        moved: Whether both differ by more than the limit.
    """

    hours: float = 0.0
    usual_K: float = 0.0
    now_K: float = 0.0
    moved: bool = False


def taken(
    offset: KnownOffset, offset_K: float, sigma_K: float, hours: float, learn_h: float, limit_K: float
) -> KnownOffset:
    """Return the learnt offset after another time of good estimates; an uncertain estimate is ignored.

    Args:
        offset: The offset before.
        offset_K: The estimate's offset, in K.
        sigma_K: Its standard deviation; above a third of the limit the estimate is ignored.
        hours: The time since the last one, in h.
        learn_h: How long the usual value is learnt, in h; nothing is judged before.
        limit_K: The difference from which the sensor counts as moved; it has a hysteresis.
    """
    if not sigma_K < _SURE * limit_K:
        return offset
    total_h = offset.hours + hours
    usual_K = offset.usual_K
    if offset.hours < learn_h:
        usual_K += hours / total_h * (offset_K - usual_K)
    now_K = offset.now_K + hours / min(total_h, SMOOTH_H) * (offset_K - offset.now_K)
    limit_K *= CLEAR if offset.moved else 1.0
    return KnownOffset(total_h, usual_K, now_K, total_h > learn_h and abs(now_K - usual_K) > limit_K)


def offset_of(plain: Mapping[str, Any]) -> KnownOffset:
    """Return an offset from plain data, as a state file holds it.

    Raises:
        ValueError: If a number is missing or not finite.
        KeyError: If an entry is missing.
        TypeError: If an entry has another type.
    """
    hours, usual_K, now_K = (float(plain[key]) for key in ("hours", "usual_K", "now_K"))
    if not math.isfinite(hours + usual_K + now_K):
        raise ValueError("an offset is not a number")
    return KnownOffset(hours, usual_K, now_K, bool(plain["moved"]))
