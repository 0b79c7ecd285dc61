"""The walk over rows of readings and ticks: the memory of each channel, and the frames.

The records are those of `observer.align.walk`. Samples of a position are put back to when they were sent
(`even_out`), and a thermocouple that used to show noise and now repeats one value is found (`is_stuck`).

A frame that waits on its way arrives late, never early; several that waited together arrive at once. Times
given by the source need no correction. If only the arrival is known, frames are spread, because they were
sent at least a message period apart.
"""

from __future__ import annotations

from observer.kernels.codes import GOOD, MISSING, REJECTED, STALE
from observer.kernels.libc import INFINITY, NAN, cython, isfinite, isnan

_SIMULTANEOUS = 0.25
"""Part of a period within which a value that repeats is the same frame twice."""


def even_out(samples, begin, end, passed, period_s):
    """Sort the samples `begin` to `end` of a step by time and spread their times; return the new end.

    `samples` (4, n) contains times, positions and accompanying values. `passed` (2,) is the time and position
    of the last sample before, and is updated. The newest sample was delayed least. Going back from it, each
    sample is at least a period before the next, or less if more samples arrived than periods have passed.
    With NaN as `period_s` the times do not change.
    """
    end = _in_order(samples, begin, end, passed, period_s)
    if end == begin:
        return end
    last_s = samples[0, end - 1]
    apart_s = 0.0 if isnan(period_s) else period_s
    if not isnan(passed[0]):
        apart_s = min(apart_s, (last_s - passed[0]) / (end - begin))
    for i in range(end - 2, begin - 1, -1):
        samples[0, i] = min(samples[0, i], samples[0, i + 1] - apart_s)
    passed[0], passed[1] = last_s, samples[1, end - 1]
    return end


def _in_order(samples, begin, end, passed, period_s):
    """Sort stably by time, and omit samples older than the last step and duplicates; return the end."""
    for i in range(begin + 1, end):
        place = i
        while place > begin and samples[0, place - 1] > samples[0, place]:
            for r in range(4):
                samples[r, place - 1], samples[r, place] = samples[r, place], samples[r, place - 1]
            place -= 1
    before_s, before_m, retained = passed[0], passed[1], begin
    for i in range(begin, end):
        since_s = samples[0, i] - before_s
        if since_s <= 0.0 or (since_s < _SIMULTANEOUS * period_s and samples[1, i] == before_m):
            continue
        for r in range(4):
            samples[r, retained] = samples[r, i]
        before_s, before_m = samples[0, retained], samples[1, retained]
        retained += 1
    return retained


_MEMORY_SAMPLES = 64.0
_YOUNG_SAMPLES = 16.0  # a mean over fewer would take the first step of a smooth curve for noise
_REPEATS = 60.0  # this many equal samples in a row are not noise any more …
_PATIENCE = 3.0  # … unless the channel is known for long repeats: a coarse converter in steady heat
_LONGEST_KNOWN = 200.0
_NOISE_SEEN = 0.35  # of noise_K; white noise bends by 1.95 noise_K a sample, a smooth ramp by nothing


def is_stuck(noise, value, noise_K):
    """Return whether a channel is stuck, given one more usable value; `noise` is updated.

    Noise is measured by the running mean of |Δ_k - Δ_{k-1}|, the bend of the last three samples. It vanishes
    on a smooth curve without noise, however steep. The mean is over all samples so far, but at least 16 and
    at most 64, so that twenty noisy samples after the start are enough. A channel is stuck from the 60th
    repeat on (more if it has repeated for long before), until it changes. For channels other than
    thermocouples `noise_K` is NaN.
    """
    last = noise.last
    noise.last = value
    if isnan(noise_K) or isnan(last):
        return False
    delta = value - last
    noise.samples += 1.0
    samples = min(max(noise.samples, _YOUNG_SAMPLES), _MEMORY_SAMPLES)
    noise.bend += (abs(delta - noise.delta) - noise.bend) / samples
    noise.delta = delta
    if delta != 0.0:
        noise.longest = min(max(noise.longest, noise.run), _LONGEST_KNOWN)
        noise.run = 0.0
        noise.bend_before = noise.bend
        return False
    noise.run += 1.0
    limit = max(_REPEATS, _PATIENCE * noise.longest)
    return noise.run >= limit and noise.bend_before >= _NOISE_SEEN * noise_K


GRADUAL_K, WARMED = 5.0, 1.5
ABOVE_AMBIENT = 4
_OUTAGE = 3.0  # a gap this many times the usual one says nothing about how often a channel comes


def _beside_a_warm_one(plan, memory, j, cell, ambient_degC):
    """Whether another thermocouple, itself within its limit, is nearer to a cell than to the cell read as °F.

    A screw that is warm at the start of a log is warm elsewhere, too; a single channel in °F is not.
    """
    if cell - ambient_degC > WARMED * plan.above_K[j]:
        return False
    in_degC = (cell - 32.0) / 1.8
    for k in range(len(plan.above_K)):
        if k == j or memory.newest[k] != GOOD or plan.above_K[k] == INFINITY:
            continue
        other_degC = memory.value[k]
        if other_degC - ambient_degC <= plan.above_K[k] and abs(cell - other_degC) < abs(
            in_degC - other_degC
        ):
            return True
    return False


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
    if abs(cell - memory.value[j]) <= GRADUAL_K:  # it warms, and no wrong unit does so little by little
        above_K = WARMED * above_K
    if cell - ambient_degC > above_K and not _beside_a_warm_one(plan, memory, j, cell, ambient_degC):
        return ABOVE_AMBIENT
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
    if is_stuck(cython.address(memory.noise[j]), cell, plan.noise_K[j]):
        memory.newest[j], memory.stuck[j], memory.breach[j] = REJECTED, True, 0
        return False
    if isnan(memory.gap_s[j]):
        memory.gap_s[j] = gap_s
    elif gap_s <= _OUTAGE * memory.gap_s[j]:
        memory.gap_s[j] += (gap_s - memory.gap_s[j]) / 16.0
    memory.newest[j], memory.stuck[j], memory.breach[j], memory.arrived[j] = GOOD, False, 0, True
    memory.value[j], memory.seen_s[j] = cell, true_s
    return True


def _usual_s(plan, memory, j):
    """Return the usual time in seconds between two values of channel j, NaN where it sends only on change."""
    if not isnan(plan.heartbeat_s[j]):
        return NAN
    return memory.gap_s[j] if isnan(plan.expected_s[j]) else plan.expected_s[j]


def _limit_s(plan, memory, j):
    """Return the age in seconds beyond which a value of channel j is stale: its heartbeat, if it has one."""
    if not isnan(plan.heartbeat_s[j]):
        return plan.heartbeat_s[j]
    usual_s = _usual_s(plan, memory, j)
    return 2.0 * (plan.period_s if isnan(usual_s) else max(plan.period_s, usual_s))


def _driven_m_s(plan, memory, p, true_s):
    """Speed times lead of path p at a time, NaN where the speed is not known then."""
    j = plan.speed[p]
    if j < 0 or memory.newest[j] != GOOD or not abs(true_s - memory.seen_s[j]) <= _limit_s(plan, memory, j):
        return NAN
    return abs(memory.value[j]) * plan.lead_m[p] / 60.0


def walk_rows(rows, count, plan, memory, frames):
    """Walk over the first rows, in the order of time, updating what is remembered and filling the frames.

    Scratch: `frames.end` (P,) and `frames.counts` (c,).
    """
    k, paths, time_s, cells = 0, len(plan.position), rows.time_s, rows.values
    samples, offset, end, counts, quality = (
        frames.samples, frames.offset, frames.end, frames.counts, frames.quality,
    )  # fmt: skip
    for p in range(paths):
        end[p] = 0
    for row in range(count):
        true_s = time_s[row] - rows.late_s[row]
        for j in range(len(counts)):
            counts[j] = rows.present[row, j] and _take_cell(
                plan, memory, j, cells[row, j], rows.faulted[row, j], true_s
            )
        for j in range(len(counts)):  # too warm by itself: the row's other channels are known now
            if rows.present[row, j] and not counts[j] and memory.breach[j] == ABOVE_AMBIENT:
                counts[j] = _take_cell(plan, memory, j, cells[row, j], rows.faulted[row, j], true_s)
        for p in range(paths):
            if counts[plan.position[p]]:
                samples[p, 0, end[p]], samples[p, 1, end[p]] = true_s, cells[row, plan.position[p]]
                samples[p, 2, end[p]] = _driven_m_s(plan, memory, p, true_s)
                speed = plan.speed[p]
                samples[p, 3, end[p]] = abs(true_s - memory.seen_s[speed]) if speed >= 0 else NAN
                end[p] += 1
        if not rows.step[row]:
            continue
        frames.time_s[k] = time_s[row]
        frames.dt_s[k] = 0.0 if isnan(memory.last_tick_s[0]) else time_s[row] - memory.last_tick_s[0]
        memory.last_tick_s[0] = time_s[row]
        for p in range(paths):
            usual_s = _usual_s(plan, memory, plan.position[p])
            end[p] = even_out(samples[p], offset[p, k], end[p], memory.passed[p], usual_s)
            offset[p, k + 1] = end[p]
        for j in range(len(counts)):
            age = INFINITY if isnan(memory.seen_s[j]) else time_s[row] - memory.seen_s[j]
            late = memory.newest[j] == GOOD and age > _limit_s(plan, memory, j)
            quality[k, j] = STALE if late else memory.newest[j]
            frames.fresh[k, j] = memory.arrived[j] and quality[k, j] == GOOD
            frames.values[k, j], frames.age_s[k, j], memory.arrived[j] = memory.value[j], age, False
        k += 1
