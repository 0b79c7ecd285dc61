"""The readings of an axis: late, missed, or stopped for a minute; it imports nothing of the product."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from campaigns.motion.axis import FloatArray, Path

PAUSE_S = 60.0


class Polling(NamedTuple):
    """How an axis is polled.

    A poll is late by chance, with probability `busy` by up to some periods; `missed` is the share of polls
    without an answer, `pauses_1_h` how often the process is stopped for a minute. The control refreshes its
    registers each `refresh_s`, the speed `skew_s` after the position. With `speed_period_s` the speed is
    polled by itself. Positions are rounded to `step_m`, speeds to 1 rpm.
    """

    period_s: float
    busy: float = 0.0
    missed: float = 0.0
    pauses_1_h: float = 0.0
    refresh_s: float = 0.0
    skew_s: float = 0.0
    speed_period_s: float = 0.0
    step_m: float = 1e-6


def draw_polling(period_s: float, rng: np.random.Generator) -> Polling:
    """Draw how an axis is polled on a computer that is anything from idle to overloaded."""
    return Polling(
        period_s,
        busy=float(rng.choice([0.0, 0.01, 0.1])),
        missed=float(rng.choice([0.0, 0.001, 0.02])),
        pauses_1_h=float(rng.choice([0.0, 1.0])),
        refresh_s=float(rng.choice([0.0, 0.004, 0.02, 0.05])),
        skew_s=rng.uniform(-0.02, 0.02),
        speed_period_s=period_s * float(rng.choice([0.0, 0.0, 1.0, 2.0])),
        step_m=float(rng.choice([1e-6, 1e-5, 1e-4, 1e-3])),
    )


class Samples(NamedTuple):
    """What came: when a sample was stamped, the position and the speed times lead, and how old that was."""

    time_s: FloatArray
    place_m: FloatArray
    driven_m_s: FloatArray
    speed_age_s: FloatArray


def _polls(
    polling: Polling, period_s: float, seconds: float, rng: np.random.Generator
) -> tuple[FloatArray, ...]:
    """Return when the control answered, and when the answers were stamped."""
    due_s = np.arange(1.0, seconds, period_s) + rng.uniform(0.0, period_s)
    asked_s = due_s + rng.exponential(0.0005, len(due_s))
    late_s = rng.exponential(0.0005, len(due_s))
    busy = rng.random(len(due_s)) < polling.busy
    before = busy & (rng.random(len(due_s)) < 0.5)
    asked_s[before] += rng.uniform(0.0, max(2.0 * period_s, 0.2), before.sum())
    late_s[busy & ~before] += rng.uniform(0.0, max(2.0 * period_s, 0.2), (busy & ~before).sum())
    for stop in rng.integers(0, len(due_s), rng.poisson(polling.pauses_1_h * seconds / 3600.0)):
        (late_s if rng.random() < 0.5 else asked_s)[stop] += PAUSE_S
    stamp_s = asked_s + late_s
    free = np.ones(len(due_s), np.bool_)
    free[1:] = due_s[1:] >= np.maximum.accumulate(stamp_s)[:-1]
    free &= rng.random(len(due_s)) >= polling.missed
    return asked_s[free], stamp_s[free]


def sample(path: Path, polling: Polling, seconds: float, rng: np.random.Generator) -> Samples:
    """Return what a computer reads of a path."""
    asked_s, stamp_s = _polls(polling, polling.period_s, seconds, rng)
    place_m, _ = path.at(_refreshed(asked_s, polling.refresh_s))
    speed_asked_s, speed_stamp_s = asked_s, stamp_s
    if polling.speed_period_s:
        speed_asked_s, speed_stamp_s = _polls(polling, polling.speed_period_s, seconds, rng)
    _, velocity_m_s = path.at(_refreshed(speed_asked_s, polling.refresh_s) + polling.skew_s)
    rpm_m_s = path.axis.lead_m / 60.0
    driven_m_s = rpm_m_s * np.round(np.abs(velocity_m_s) / rpm_m_s)
    newest = np.searchsorted(speed_stamp_s, stamp_s, side="right") - 1
    age_s = np.where(newest >= 0, stamp_s - speed_stamp_s[newest], np.inf)
    known = age_s <= 2.0 * max(polling.period_s, polling.speed_period_s)
    place_m = polling.step_m * np.round(place_m / polling.step_m)
    return Samples(stamp_s, place_m, np.where(known, driven_m_s[newest], np.nan), age_s)


def _refreshed(time_s: FloatArray, refresh_s: float) -> FloatArray:
    return refresh_s * np.floor(time_s / refresh_s) if refresh_s else time_s
