"""Runs the comparison of ways over samples: false jumps, and how soon real ones are found."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from campaigns.motion.axis import BoolArray, Path, draw_axis, draw_path
from campaigns.motion.polls import Polling, Samples, draw_polling, sample
from observer.estimators.selftest import MOTION_STEP, no_motion_yet
from observer.frames import NutPath
from observer.kernels import compare_ways, record
from observer.kernels.selftest import DISAGREE, FALLS_SHORT

PERIODS_S = (0.02, 0.05, 0.1, 0.2, 0.5)
WATCHED_S, FAULT_S = 900.0, 600.0


class Flags(NamedTuple):
    """After each sample: whether the position has jumped, and whether way and speed disagree."""

    jumped: BoolArray
    disagree: BoolArray


def flags(samples: Samples, path: Path) -> Flags:
    """Return what is found after each sample."""
    n = len(samples.time_s)
    motion = np.empty(n, MOTION_STEP)
    travel_m = np.array([path.axis.low_m, path.axis.high_m])
    polled = NutPath(
        samples.time_s, samples.place_m, np.arange(n + 1, dtype=np.intp), samples.driven_m_s,
        samples.speed_age_s,
    )  # fmt: skip
    compare_ways(record(polled), travel_m, no_motion_yet(), motion, np.zeros(n, np.int8))
    ratio = motion["ratio"]
    return Flags(motion["jump_m"] != 0.0, (ratio > DISAGREE) | (ratio < FALLS_SHORT))


def starts(flag: BoolArray) -> int:
    """Return how often a flag is raised."""
    return int((np.diff(flag.astype(np.int8), prepend=0) == 1).sum())


def healthy(period_s: float, seconds: float, seed: int) -> tuple[int, int, int, Polling]:
    """Return samples, false jumps and false disagreements of a healthy axis, and how it was polled."""
    rng = np.random.default_rng((seed, round(1000 * period_s)))
    path = draw_path(draw_axis(rng), seconds, rng)
    polling = draw_polling(period_s, rng)
    samples = sample(path, polling, seconds, rng)
    found = flags(samples, path)
    return len(samples.time_s), starts(found.jumped), starts(found.disagree), polling


FAULTS = (
    *(
        (f"lost by {size} mm {when}", size / 1000.0)
        for size in (10, 30, 100)
        for when in ("at rest", "moving")
    ),
    ("sign reversed", 0.0),
    ("stuck", 0.0),
)


def faulty_delay_s(name: str, size_m: float, period_s: float, loaded: bool, seed: int) -> float:
    """Return how long after a fault it is found, infinite if not within five minutes."""
    rng = np.random.default_rng((seed, round(1000 * period_s), len(name)))
    path = draw_path(draw_axis(rng), WATCHED_S, rng)
    polling = draw_polling(period_s, rng) if loaded else Polling(period_s)
    samples = sample(path, polling._replace(pauses_1_h=0.0), WATCHED_S, rng)
    _, velocity_m_s = path.at(samples.time_s)
    right = np.abs(velocity_m_s) < 1e-9 if "rest" in name else np.abs(velocity_m_s) > 0.01
    begin = int(np.argmax(right & (samples.time_s >= FAULT_S)))
    place_m = samples.place_m.copy()
    if name == "stuck":
        place_m[begin:] = place_m[begin]
    elif name == "sign reversed":
        place_m[begin:] *= -1.0
    else:
        place_m[begin:] += size_m * rng.choice([-1.0, 1.0])
    found = flags(samples._replace(place_m=place_m), path)
    late = (found.jumped | found.disagree) & (np.arange(len(place_m)) >= begin)
    return float(samples.time_s[np.argmax(late)] - samples.time_s[begin]) if late.any() else np.inf
