"""The walk over rows of readings and ticks: what is remembered of each channel, and the frames.

The records are those of `observer.align.walk`.
"""

from __future__ import annotations

from observer.kernels.codes import GOOD, MISSING, REJECTED, STALE
from observer.kernels.evening import even_out
from observer.kernels.libm import INFINITY, NAN, isfinite, isnan
from observer.kernels.stuck import is_stuck

_GRADUAL_K, _WARMED = 5.0, 1.5
_OUTAGE = 3.0  # a gap this many times the usual one says nothing about how often a channel comes


def _breach(plan, memory, j, cell, since_s):
    """How a usable cell of channel j is beyond its limits, as in `Breach`; 0 if it is not."""
    if cell < plan.low[j]:
        return 1
    if cell > plan.high[j]:
        return 2
    if since_s >= 0.0 and abs(cell - memory.value[j]) > plan.rate_per_s[j] * since_s + plan.slack[j]:
        return 3
    ambient_degC = plan.ambient_degC if plan.ambient < 0 else memory.value[plan.ambient]
    above_K = plan.above_K[j]
    if abs(cell - memory.value[j]) <= _GRADUAL_K:  # it warms, and no wrong unit does so little by little
        above_K = _WARMED * above_K
    if cell - ambient_degC > above_K:
        return 4
    if ambient_degC - cell > plan.below_K[j]:
        return 5
    return 0


def _take_cell(plan, memory, j, cell, faulted, true_s):
    """Take what a row says of channel j; return whether it is a value that counts."""
    if faulted:
        memory.newest[j] = REJECTED
        memory.breach[j] = 0
        return False
    if not isfinite(cell):
        memory.newest[j] = MISSING
        memory.breach[j] = 0
        return False
    gap_s = true_s - memory.seen_s[j]  # NaN before the second sample
    breach = _breach(plan, memory, j, cell, gap_s)
    if breach > 0:
        memory.newest[j], memory.breach[j], memory.refused[j] = REJECTED, breach, cell
        return False
    if gap_s < 0.0:  # it was overtaken by a later one
        return True
    if is_stuck(memory.noise[j], cell, plan.noise_K[j]):
        memory.newest[j], memory.stuck[j], memory.breach[j] = REJECTED, True, 0
        return False
    if isnan(memory.gap_s[j]):
        memory.gap_s[j] = gap_s
    elif gap_s <= _OUTAGE * memory.gap_s[j]:
        memory.gap_s[j] += (gap_s - memory.gap_s[j]) / 16.0
    memory.newest[j], memory.stuck[j], memory.breach[j], memory.arrived[j] = GOOD, False, 0, True
    memory.value[j], memory.seen_s[j] = cell, true_s
    return True


def _limit_s(plan, memory, j):
    """The age from which a value of channel j is stale."""
    usual_s = memory.gap_s[j] if isnan(plan.expected_s[j]) else plan.expected_s[j]
    return 2.0 * (plan.period_s if isnan(usual_s) else max(plan.period_s, usual_s))


def _driven_m_s(plan, memory, p, true_s):
    """Speed times lead of path p at a time, NaN where the speed is not known then."""
    j = plan.speed[p]
    if j < 0 or memory.newest[j] != GOOD or not abs(true_s - memory.seen_s[j]) <= _limit_s(plan, memory, j):
        return NAN
    return abs(memory.value[j]) * plan.lead_m[p] / 60.0


def walk_rows(
    time_s, late_s, step, cells, present, faulted, plan, memory,
    tick_s, dt_s, values, fresh, quality, age_s, samples, offset, end, counts,
):  # fmt: skip
    """Walk over rows in the order of time, updating what is remembered and filling the frames.

    Scratch: `end` (P,), 0 at first, and `counts` (c,).
    """
    k, paths = 0, len(plan.position)
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
        dt_s[k] = 0.0 if isnan(memory.last_tick_s[0]) else time_s[row] - memory.last_tick_s[0]
        memory.last_tick_s[0] = time_s[row]
        for p in range(paths):
            j = plan.position[p]
            usual_s = memory.gap_s[j] if isnan(plan.expected_s[j]) else plan.expected_s[j]
            end[p] = even_out(samples[p], offset[p, k], end[p], memory.passed[p], usual_s)
            offset[p, k + 1] = end[p]
        for j in range(len(counts)):
            age = INFINITY if isnan(memory.seen_s[j]) else time_s[row] - memory.seen_s[j]
            late = memory.newest[j] == GOOD and age > _limit_s(plan, memory, j)
            quality[k, j] = STALE if late else memory.newest[j]
            fresh[k, j] = memory.arrived[j] and quality[k, j] == GOOD
            values[k, j], age_s[k, j], memory.arrived[j] = memory.value[j], age, False
        k += 1
