"""What the machine was doing in each half minute, and what excitation the logs lack."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from observer.config import Config
from observer.fit.problem import Problem
from observer.fit.runs import Run
from observer.fit.steps import SteppedRun
from observer.frames import FloatArray
from observer.model.cycle import DWELL_S, FAST, PHASES


@dataclass(frozen=True)
class Course:
    """One run in means of half a minute, (b,) each.

    `phase` is an index into `PHASES`; `speed_rpm` of the first source that has a speed; `running_s` the time
    the machine has been working; `working` whether it works; `ambient_degC`; `position_m` of the first nut.
    """

    phase: NDArray[np.int64]
    speed_rpm: FloatArray
    running_s: FloatArray
    working: NDArray[np.bool_]
    ambient_degC: FloatArray
    position_m: FloatArray


def course_of(config: Config, run: SteppedRun) -> Course:
    """Return what the machine was doing in a run."""
    ticks, frames = run.ticks, run.run.frames
    starts = np.flatnonzero(np.diff(ticks.mean, prepend=-1))

    def mean(channel: str | None, default: float) -> FloatArray:
        if channel is None:
            return np.full(len(starts), default)
        values = np.abs(frames.values[:, frames.channels.index(channel)])
        values = np.where(np.isfinite(values), values, 0.0)
        rows = np.append(ticks.first, len(frames))[np.append(starts, len(ticks.first))]
        return np.asarray(np.add.reduceat(values, rows[:-1]) / np.maximum(np.diff(rows), 1))

    speed = mean(next((s.speed_channel for s in config.source if s.speed_channel), None), 0.0)
    power = sum((mean(s.power_channel, 0.0) for s in config.source if s.power_channel), np.zeros(len(speed)))
    working = _on(speed) | _on(power)
    fixed_degC = config.ambient.temperature_degC or 20.0
    nut = next((s.position_channel for s in config.source if s.position_channel), None)
    period_s = np.diff(ticks.time_s, prepend=0.0)
    return Course(
        phase=_phases(working, ticks.time_s, _mean_of_known(ticks.measured_degC)),
        speed_rpm=speed,
        running_s=np.cumsum(np.where(working, period_s, 0.0)),
        working=working,
        ambient_degC=mean(config.ambient.channel, fixed_degC),
        position_m=mean(nut, 0.0),
    )


def _on(values: FloatArray) -> NDArray[np.bool_]:
    """Where a speed or power is not negligible, (b,)."""
    return np.asarray(values > 0.02 * max(values.max(initial=0.0), 1e-9))


def _phases(working: NDArray[np.bool_], time_s: FloatArray, level_degC: FloatArray) -> NDArray[np.int64]:
    """Index into `PHASES` of every mean, (b,)."""
    phase = np.zeros(len(working), dtype=np.int64)
    if not working.any():
        return phase
    rate = np.gradient(_filled(level_degC), time_s) if len(time_s) > 2 else np.zeros(len(time_s))
    smooth = np.convolve(rate, np.ones(5) / 5)[2 : 2 + len(rate)]  # "same" is five long for fewer than five
    fast = smooth > FAST * max(float(smooth.max()), 1e-9)
    begin = int(np.argmax(working))
    phase[begin:] = np.where(fast[begin:], PHASES.index("heat_up"), PHASES.index("steady"))
    edges = np.flatnonzero(np.diff(np.concatenate([[True], working[begin:], [True]]).astype(int))) + begin
    for off, on in zip(edges[::2], edges[1::2], strict=False):
        more = on < len(working)
        short = more and time_s[on - 1] - time_s[off] < DWELL_S
        phase[off:on] = PHASES.index("dwell" if short else "cool_down")
    return phase


def _mean_of_known(values: FloatArray) -> FloatArray:
    """The mean of each row (b, s) over its finite values, NaN without any."""
    count = np.isfinite(values).sum(axis=1)
    return np.where(count > 0, np.nansum(values, axis=1) / np.maximum(count, 1), np.nan)


def _filled(values: FloatArray) -> FloatArray:
    """The values with missing ones interpolated."""
    known = np.isfinite(values)
    if not known.any():
        return np.zeros_like(values)
    index = np.arange(len(values))
    return np.asarray(np.interp(index, index[known], values[known]))


def courses_of(problem: Problem) -> tuple[Course, ...]:
    """Return the course of every run of a problem."""
    return tuple(course_of(problem.config, run) for run in problem.forward.runs)


TELLING_S = 1800.0
"""Least duration of the longest log for slow effects to be identifiable."""
WARM_SIGMA = 20.0
"""Least rise of some sensor, in units of its noise."""
SPEEDS_APART = 0.1
"""Relative difference below which two speeds count as one."""
LASTS_MEANS = 6
"""A speed or a rest counts if it lasts three minutes."""


def missing_excitation(config: Config, runs: Sequence[Run], courses: Sequence[Course]) -> tuple[str, ...]:
    """Return the excitation that the logs lack, a clause for each; empty if nothing is missing."""
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
        out.append(f"the screw turns at {speeds[0]:.0f} rpm only, so effects of speed are not identifiable")
    if not any(np.count_nonzero(~c.working) >= LASTS_MEANS for c in courses):
        out.append("the machine never rests, so effects that act at rest are not identifiable")
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
