"""The life of an alarm, as ISA-18.2 (2016) has it: raised, acknowledged, returned, gone.

Pure: conditions and moments go in, frozen alarms come out.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any, Literal

from observer.alarms.kinds import KINDS

_STRANGE = re.compile(r"[^A-Za-z0-9_.-]")

State = Literal["pending", "unacknowledged", "acknowledged", "returned"]


@dataclass(frozen=True, slots=True)
class Condition:
    """Something that holds now: of which kind, about what, why in words, and the figures it rests on.

    `name` tells conditions of one kind and target apart.
    """

    kind: str
    target: str
    reason: str
    name: str | None = None
    evidence: Mapping[str, Any] | None = None

    @property
    def id(self) -> str:
        """What the alarm is called by: the same again whenever the same comes back."""
        return _STRANGE.sub("_", ".".join(filter(None, (self.kind, self.target, self.name))))


@dataclass(frozen=True, slots=True)
class Alarm:
    """An alarm: in which state, its condition since when, when that was seen last, and as what."""

    state: State
    since_s: float
    seen_s: float
    condition: Condition = field(repr=False)

    @property
    def is_raised(self) -> bool:
        """Whether it is shown: a condition that has not lasted yet is none."""
        return self.state != "pending"


Alarms = Mapping[str, Alarm]


def advance(alarms: Alarms, conditions: Iterable[Condition], time_s: float) -> dict[str, Alarm]:
    """Return the alarms at a moment, of those before and of what holds now."""
    holding = {condition.id: condition for condition in conditions}
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


def _with(alarm: Alarm | None, condition: Condition, time_s: float) -> Alarm:
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
