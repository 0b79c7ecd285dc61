"""What estimates under a fault come to: how soon they were flagged, and how many were not."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True, slots=True)
class Fault:
    """One injected fault: its name, the sensors it touches (none where it is an input), and when it was."""

    name: str
    sensors: frozenset[str]
    begin_s: float
    end_s: float
    allowed_s: float
    """From its begin on; after it, every estimate is to be flagged."""


def is_flagged(estimate: dict[str, Any], sensors: frozenset[str]) -> bool:
    """Whether an estimate neither is good nor has used a sensor that is at fault."""
    return estimate["quality"] != "good" and not _used(estimate) & sensors


def is_used(estimate: dict[str, Any], sensors: frozenset[str]) -> bool:
    """Whether an estimate has used all of these sensors."""
    return sensors <= _used(estimate)


def _used(estimate: dict[str, Any]) -> set[str]:
    return {n for n, q in zip(estimate["sensors"], estimate["sensor_quality"], strict=True) if q == "good"}


def unflagged(estimates: Sequence[dict[str, Any]], fault: Fault) -> int:
    """How many estimates after the allowed time do not show the fault."""
    begin_s = fault.begin_s + fault.allowed_s
    under = [e for e in estimates if begin_s < e["time_s"] <= fault.end_s]
    if not under:
        raise ValueError(f"no estimates under the fault {fault.name}")
    return sum(not is_flagged(e, fault.sensors) for e in under)


def believed_for_s(estimates: Sequence[dict[str, Any]], fault: Fault) -> float:
    """How long after its begin the last estimate under the fault did not show it; 0 where all do."""
    times = [
        e["time_s"]
        for e in estimates
        if fault.begin_s < e["time_s"] <= fault.end_s and not is_flagged(e, fault.sensors)
    ]
    return max(times, default=fault.begin_s) - fault.begin_s
