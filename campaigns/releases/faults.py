"""The faults that may release a compensation, each of a drawn duration."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from campaigns.releases.axis import HOLD_S, LIMIT_UM, PERIOD_S, SENSORS, CompensatedAxis, StepInput
from observer.frames import EstimateQuality, Quality

EXCLUDED = (Quality.GOOD, Quality.EXCLUDED, Quality.GOOD)
MISSING = (Quality.MISSING,) * len(SENSORS)

Drawn = Callable[[StepInput, float, float], StepInput]
"""Makes of a good step one with the fault, from the seconds since it began and a size between 0 and 1."""


def _position(good: StepInput, since_s: float, size: float) -> StepInput:
    quality = EstimateQuality.STALE if size > 0.5 else EstimateQuality.DEGRADED
    return replace(good, position_age_s=since_s + 0.4, quality=quality)


HELD: dict[str, Drawn] = {
    "no position": _position,
    "sensor excluded": lambda good, _, size: replace(
        good, sensor_quality=EXCLUDED, quality=EstimateQuality.DEGRADED
    ),
    "all sensors missing": lambda good, _, size: replace(
        good, sensor_quality=MISSING, quality=EstimateQuality.STALE
    ),
    "estimate not known": lambda good, _, size: replace(good, quality=EstimateQuality.INVALID),
    "bound over the limit": lambda good, _, size: replace(good, bound_um=LIMIT_UM + 0.1 + 300.0 * size),
    "bound not known": lambda good, _, size: replace(good, bound_um=float("nan")),
    "error over the limit": lambda good, _, size: replace(good, error_um=LIMIT_UM + 0.1 + 300.0 * size),
    "step fails": lambda good, _, size: replace(good, failure="ValueError: drawn"),
}
"""Faults through which the values are held: shorter than the hold time they release nothing."""
AT_ONCE: dict[str, Drawn] = {
    "control does not follow": lambda good, _, size: replace(
        good, control_failure="control: it does not follow: its dead-man has let go"
    ),
    "clock set": lambda good, _, size: replace(good, clock_offset_s=(size - 0.5) * 7200.0 + 1.0),
    "another service": lambda good, _, size: replace(good, rival="another service runs as this axis"),
}
COMMANDS = {"reset": "reset", "zero": "zero"}
RESTARTS = {"service ended": True, "service killed": False}
STALLED = "process stalled"
LATE_CONTROL = "control answers late"
DISARMED = "disarmed by a person"
ALL = (*HELD, *AT_ONCE, *COMMANDS, *RESTARTS, STALLED, LATE_CONTROL, DISARMED)


def run(axis: CompensatedAxis, kind: str, seconds: float, size: float, good: StepInput) -> None:
    """Let an armed axis have a fault; asserts whether it may be armed afterwards."""
    if kind in HELD or kind in AT_ONCE:
        _last(axis, kind, seconds, size, good)
    elif kind in COMMANDS:
        axis.step(good, COMMANDS[kind])
        assert not axis.is_armed
    elif kind in RESTARTS:
        axis.restart(is_orderly=RESTARTS[kind], away_s=seconds)
        assert not axis.is_armed
    elif kind == STALLED:
        axis.step(replace(good, pause_s=seconds))
        assert axis.is_armed == (seconds + PERIOD_S <= 3.0 * PERIOD_S + HOLD_S)
    elif kind == LATE_CONTROL:
        axis.step(good, "disarm")
        outcomes = axis.step(replace(good, is_pending=True), "arm")
        for _ in range(round(seconds / PERIOD_S)):
            axis.step(replace(good, is_pending=True))
            assert not outcomes
        axis.step(good)
        assert [outcome.text for outcome in outcomes] == ["armed"]
    elif kind == DISARMED:
        axis.step(good, "disarm")
        assert not axis.is_armed


def _last(axis: CompensatedAxis, kind: str, seconds: float, size: float, good: StepInput) -> None:
    steps = max(1, round(seconds / PERIOD_S))
    drawn = HELD.get(kind) or AT_ONCE[kind]
    axis.step(good)  # two faults without a good estimate between them are one that lasts longer
    for k in range(steps):
        axis.step(drawn(good, k * PERIOD_S, size))
    held_s = (steps - 1) * PERIOD_S  # from the first step with the fault to the last
    assert axis.is_armed == (kind in HELD and held_s < HOLD_S), (kind, seconds)


def arm(axis: CompensatedAxis, good: StepInput) -> None:
    """Have a person arm what is off."""
    if axis.is_armed:
        return
    axis.step(good, "zero")
    (outcome,) = axis.step(good, "arm")
    assert outcome.done, outcome.text
