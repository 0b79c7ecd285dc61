"""What logs must hold for a search to tell the library's effects apart, and in words what they lack."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from observer.config import Config
from observer.discovery.phases import Course
from observer.fit.runs import Run
from observer.frames import FloatArray

TELLING_S = 1800.0
"""How long the longest log has to be for slow effects to be told."""
WARM_SIGMA = 20.0
"""The least rise of some sensor, in units of its noise."""
SPEEDS_APART = 0.1
"""Speeds closer than this part of the larger count as one."""
LASTS_MEANS = 6
"""A speed or a rest counts if it lasts three minutes."""


def lacking(config: Config, runs: Sequence[Run], courses: Sequence[Course]) -> tuple[str, ...]:
    """Return what the logs lack, a clause for each; empty if nothing is missing."""
    out = []
    longest_s = max(run.duration_s for run in runs)
    if longest_s < TELLING_S:
        out.append(f"the longest log lasts {longest_s / 60:.0f} min, and {TELLING_S / 60:.0f} min are needed")
    rise = max(float(np.nanmax(np.abs(r.measured_degC - r.start_degC), initial=0.0)) for r in runs)
    least_K = WARM_SIGMA * max(s.noise_K for s in config.sensor)
    if rise < least_K:
        out.append(f"no sensor moves by more than {rise:.2f} K, and {least_K:.1f} K are needed")
    turning = any(s.speed_channel is not None for s in config.source)
    speeds = speeds_rpm(courses)
    if turning and len(speeds) == 0:
        out.append("the screw never turns")
    if turning and len(speeds) == 1:
        out.append(f"the screw turns at {speeds[0]:.0f} rpm only, so what goes with speed cannot be told")
    if not any(np.count_nonzero(~c.working) >= LASTS_MEANS for c in courses):
        out.append("the machine never rests, so what acts at rest as well cannot be told")
    return tuple(out)


def speeds_rpm(courses: Sequence[Course]) -> list[float]:
    """The speeds at which the screw turned for three minutes or more, those apart by a tenth."""
    every: FloatArray = np.sort(np.concatenate([c.speed_rpm[c.working] for c in courses]))
    out: list[float] = []
    while len(every):
        near = every <= every[0] * (1 + SPEEDS_APART)
        if every[0] > 0 and np.count_nonzero(near) >= LASTS_MEANS:
            out.append(float(np.median(every[near])))
            every = every[~near]
        else:
            every = every[1:]
    return out
