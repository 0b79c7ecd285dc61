"""Where the screw settles under a program, when it is there, and what a warm-up program would save."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from observer.forecast.ahead import HOUR_S, Ahead, Runner
from observer.forecast.program import Bins, Program
from observer.frames import BoolArray, FloatArray

STEP_S = 30.0
MOST_S = 24.0 * HOUR_S
_PART = 20
_STILL_K = 1e-3  # per part of ten minutes
_WORTH_S = 60.0
_MORE = 1.02  # a program whose hardest part heats no more than this above its mean has no warm-up


@dataclass(frozen=True, slots=True)
class Settling:
    """Where the mean of the program leads, `field_degC`, `error_um` (g,), and after how long every point of
    the travel is there within the limit, None where it is not within a day or no error is known.
    """

    field_degC: FloatArray
    error_um: FloatArray
    after_s: float | None


def _steps(one: Bins, count: int = _PART) -> Bins:
    return one.at(np.zeros(count, np.int64))._replace(dt_s=np.full(count, STEP_S))


def _without_sigma(begin: Runner) -> Runner:
    """Only the means count here."""
    return replace(begin, state=replace(begin.state, P=np.zeros_like(begin.state.P)))


def settling(begin: Runner, program: Program, travel: BoolArray, within_um: float) -> Settling:
    """Follow the mean program until nothing changes; `travel` (g,) are the places of the grid that count."""
    one, at, time_s, parts = program.mean, _without_sigma(begin), 0.0, list[Ahead]()
    while time_s < MOST_S:
        at, part = at.run(_steps(one), time_s)
        time_s = float(part.time_s[-1])
        parts.append(part)
        if np.abs(part.field_degC[-1] - part.field_degC[0]).max() < _STILL_K:
            break
    field_degC, error_um = parts[-1].field_degC[-1], parts[-1].error_um[-1]
    path = np.concatenate([p.error_um for p in parts])
    times_s = np.concatenate([p.time_s for p in parts])
    return Settling(field_degC, error_um, _there(times_s, path, error_um, travel, within_um))


def _there(
    time_s: FloatArray, path_um: FloatArray, at_um: FloatArray, travel: BoolArray, within_um: float
) -> float | None:
    """The first moment from which on every point is within the limit; 0 where it always is."""
    if not at_um.size:
        return None
    off = np.flatnonzero((np.abs(path_um - at_um)[:, travel] > within_um).any(axis=1))
    if not len(off):
        return 0.0
    return None if off[-1] + 1 >= len(time_s) else float(time_s[off[-1] + 1])


def warm_up_saves_s(
    begin: Runner, program: Program, settled: Settling, travel: BoolArray, within_um: float
) -> float | None:
    """How much sooner it settles where the hardest part of the program runs at once until the mean heat
    content is that of the settled screw; None where that saves nothing.
    """
    hardest, mean = program.hardest, program.mean
    if not settled.after_s or hardest.total_W[0] <= _MORE * mean.total_W[0]:
        return None
    at, time_s, there_K = _without_sigma(begin), 0.0, float(settled.field_degC.mean())
    while time_s < settled.after_s:
        at, part = at.run(_steps(hardest, 2), time_s)
        time_s = float(part.time_s[-1])
        if part.field_degC[-1].mean() >= there_K:
            break
    else:
        return None
    path, times, time_of_work_s = [], [], time_s
    end_s = time_s + settled.after_s
    while time_s < end_s:
        at, part = at.run(_steps(mean), time_s)
        time_s = float(part.time_s[-1])
        path.append(part.error_um)
        times.append(part.time_s)
    found = _there(np.concatenate(times), np.concatenate(path), settled.error_um, travel, within_um)
    if found is None:
        return None
    saves_s = settled.after_s - max(found, time_of_work_s)
    return saves_s if saves_s >= _WORTH_S else None
