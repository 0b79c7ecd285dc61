"""The walk over rows of readings and ticks, compiled: what is remembered of each channel, and the frames.

A value counts where it carries no fault, is a number, lies within its limits and comes from a channel that is
not stuck. Everything it needs of the past stands in `Memory`, so a walk over parts gives the same bits.
"""

# numba compiles these functions: their types are those of the arrays they get.
# mypy: disable-error-code="no-untyped-def, misc"

from __future__ import annotations

import math
from dataclasses import dataclass, fields
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from observer.compiled import cached_call, rarely
from observer.frames import BoolArray, FloatArray, FrameBlock, NutPath, Quality, QualityArray
from observer.service.evening import even_out
from observer.service.stuck import is_stuck, no_memory

_GOOD, _MISSING = int(Quality.GOOD), int(Quality.MISSING)
_STALE, _REJECTED = int(Quality.STALE), int(Quality.REJECTED)
_OUTAGE = 3.0  # a gap this many times the usual one says nothing about how often a channel comes
IntArray = NDArray[np.int64]


@dataclass(frozen=True, slots=True)
class Rows:
    """n rows in the order of time: what each reading said of which channel, and which rows are ticks.

    `time_s`, `late_s`, `step` (n,): a reading was true `late_s` before its row; `values`, `present`,
    `faulted` (n, c).
    """

    time_s: FloatArray
    late_s: FloatArray
    step: BoolArray
    values: FloatArray
    present: BoolArray
    faulted: BoolArray

    def part(self, start: int, end: int) -> Rows:
        """The rows from `start` up to `end`."""
        cut = slice(start, end)
        return Rows(*(getattr(self, f.name)[cut] for f in fields(self)))


class Memory(NamedTuple):
    """Where the walk over the rows stands; arrays, updated in place.

    (c,): last usable value, when that was true, usual gap between values, newest quality, whether one arrived
    since the last tick, whether stuck, the last breach of a limit and by what value; `noise` (c, 7) as in
    `stuck`; `passed` (P, 2) time and position of each path's last sample; `last_tick_s` (1,).
    """

    value: FloatArray
    seen_s: FloatArray
    gap_s: FloatArray
    newest: QualityArray
    arrived: BoolArray
    stuck: BoolArray
    breach: QualityArray
    refused: FloatArray
    noise: FloatArray
    passed: FloatArray
    last_tick_s: FloatArray


def nothing_yet(plan: Expected, last_tick_s: float = math.nan) -> Memory:
    """The memory before the first row; `last_tick_s` is the last tick before a warm start."""
    c = len(plan.noise_K)

    def unknown() -> FloatArray:
        return np.full(c, np.nan)

    return Memory(
        value=unknown(),
        seen_s=unknown(),
        gap_s=unknown(),
        newest=np.full(c, _MISSING, np.int8),
        arrived=np.zeros(c, np.bool_),
        stuck=np.zeros(c, np.bool_),
        breach=np.zeros(c, np.int8),
        refused=unknown(),
        noise=no_memory(c),
        passed=np.full((len(plan.position), 2), np.nan),
        last_tick_s=np.array([last_tick_s]),
    )


class Expected(NamedTuple):
    """What is expected of c channels and P paths, as the compiled walk takes it.

    `expected_s`, `noise_K` (c,) and `period_s` are those of `AlignPlan`, the next those of `Limits`;
    `position`, `speed` (P,) the columns of a path and of what drives it, times `lead_m` (P,).
    """

    expected_s: FloatArray
    noise_K: FloatArray
    period_s: float
    low: FloatArray
    high: FloatArray
    rate_per_s: FloatArray
    above_K: FloatArray
    below_K: FloatArray
    slack: FloatArray
    ambient: int
    ambient_degC: float
    position: IntArray
    speed: IntArray
    lead_m: FloatArray


def walk(channels: tuple[str, ...], plan: Expected, memory: Memory, rows: Rows) -> FrameBlock:
    """The frames at the ticks among the rows; `memory` is updated."""
    ticks, c, paths = int(np.count_nonzero(rows.step)), len(channels), len(plan.position)
    values, age_s = np.empty((ticks, c)), np.empty((ticks, c))
    fresh, quality = np.empty((ticks, c), np.bool_), np.empty((ticks, c), np.int8)
    time_s, dt_s = np.empty(ticks), np.empty(ticks)
    samples, offset = np.empty((paths, 3, len(rows.time_s))), np.zeros((paths, ticks + 1), np.int64)
    _walk_rows(
        rows.time_s, rows.late_s, rows.step, rows.values, rows.present, rows.faulted, plan, memory,
        time_s, dt_s, values, fresh, quality, age_s, samples, offset,
    )  # fmt: skip
    path = {}
    for p, column in enumerate(plan.position):
        at_s, at_m, driven_m_s = samples[p, :, : offset[p, -1]].copy()
        path[channels[column]] = NutPath(at_s, at_m, offset[p], driven_m_s)
    return FrameBlock(channels, time_s, dt_s, values, fresh, quality, age_s, path)


@rarely
def _breach(plan, memory, j, cell, since_s):
    """How a usable cell of channel j is beyond its limits, as in `Breach`; 0 if it is not."""
    if cell < plan.low[j]:
        return 1
    if cell > plan.high[j]:
        return 2
    if since_s >= 0.0 and abs(cell - memory.value[j]) > plan.rate_per_s[j] * since_s + plan.slack[j]:
        return 3
    ambient_degC = plan.ambient_degC if plan.ambient < 0 else memory.value[plan.ambient]
    if cell - ambient_degC > plan.above_K[j]:
        return 4
    if ambient_degC - cell > plan.below_K[j]:
        return 5
    return 0


@rarely
def _take_cell(plan, memory, j, cell, faulted, true_s):
    """Take what a row says of channel j; return whether it is a value that counts."""
    if faulted:
        memory.newest[j] = _REJECTED
        memory.breach[j] = 0
        return False
    if not math.isfinite(cell):
        memory.newest[j] = _MISSING
        memory.breach[j] = 0
        return False
    gap_s = true_s - memory.seen_s[j]  # NaN before the second sample
    breach = _breach(plan, memory, j, cell, gap_s)
    if breach > 0:
        memory.newest[j], memory.breach[j], memory.refused[j] = _REJECTED, breach, cell
        return False
    if gap_s < 0.0:  # it was overtaken by a later one
        return True
    if is_stuck(memory.noise[j], cell, plan.noise_K[j]):
        memory.newest[j], memory.stuck[j], memory.breach[j] = _REJECTED, True, 0
        return False
    if math.isnan(memory.gap_s[j]):
        memory.gap_s[j] = gap_s
    elif gap_s <= _OUTAGE * memory.gap_s[j]:
        memory.gap_s[j] += (gap_s - memory.gap_s[j]) / 16.0
    memory.newest[j], memory.stuck[j], memory.breach[j], memory.arrived[j] = _GOOD, False, 0, True
    memory.value[j], memory.seen_s[j] = cell, true_s
    return True


@rarely
def _limit_s(plan, memory, j):
    """The age from which a value of channel j is stale."""
    usual_s = memory.gap_s[j] if math.isnan(plan.expected_s[j]) else plan.expected_s[j]
    return 2.0 * (plan.period_s if math.isnan(usual_s) else max(plan.period_s, usual_s))


@rarely
def _driven_m_s(plan, memory, p, true_s):
    """Speed times lead of path p at a time, NaN where the speed is not known then."""
    j = plan.speed[p]
    if j < 0 or memory.newest[j] != _GOOD or not abs(true_s - memory.seen_s[j]) <= _limit_s(plan, memory, j):
        return math.nan
    return abs(memory.value[j]) * plan.lead_m[p] / 60.0


@cached_call
def _walk_rows(
    time_s, late_s, step, cells, present, faulted, plan, memory,
    tick_s, dt_s, values, fresh, quality, age_s, samples, offset,
):  # fmt: skip
    """Walk over rows in the order of time, updating what is remembered and filling the frames."""
    k, last_tick_s, paths = 0, memory.last_tick_s, len(plan.position)
    end = offset[:, 0].copy()
    counts = np.zeros(len(plan.noise_K), np.bool_)
    for row in range(len(time_s)):
        true_s = time_s[row] - late_s[row]
        for j in range(len(counts)):
            counts[j] = present[row, j] and _take_cell(
                plan, memory, j, cells[row, j], faulted[row, j], true_s
            )
        for p in range(paths):
            if counts[plan.position[p]]:
                samples[p, 0, end[p]], samples[p, 1, end[p]] = true_s, cells[row, plan.position[p]]
                samples[p, 2, end[p]] = _driven_m_s(plan, memory, p, true_s)
                end[p] += 1
        if not step[row]:
            continue
        tick_s[k] = time_s[row]
        dt_s[k] = 0.0 if math.isnan(last_tick_s[0]) else time_s[row] - last_tick_s[0]
        last_tick_s[0] = time_s[row]
        for p in range(paths):
            j = plan.position[p]
            usual_s = memory.gap_s[j] if math.isnan(plan.expected_s[j]) else plan.expected_s[j]
            end[p] = even_out(samples[p], offset[p, k], end[p], memory.passed[p], usual_s)
            offset[p, k + 1] = end[p]
        for j in range(len(counts)):
            age = math.inf if math.isnan(memory.seen_s[j]) else time_s[row] - memory.seen_s[j]
            late = memory.newest[j] == _GOOD and age > _limit_s(plan, memory, j)
            quality[k, j] = _STALE if late else memory.newest[j]
            fresh[k, j] = memory.arrived[j] and quality[k, j] == _GOOD
            values[k, j], age_s[k, j], memory.arrived[j] = memory.value[j], age, False
        k += 1
