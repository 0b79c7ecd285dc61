"""Samples of a position as they were sent, from when they arrived: sorted, once each, and evenly apart.

A frame that waits on its way comes late, never early; several that waited together come at once. Where a
source gives its own times there is nothing to mend; where only the arrival is known, frames cannot have been
sent closer together than their message's period.
"""

from __future__ import annotations

from observer.kernels.libm import isnan

_TOGETHER = 0.25
"""Part of a period within which a value that repeats is the same frame twice."""


def even_out(samples, begin, end, passed, period_s):
    """Put the samples `begin` to `end` of a step in order of their times, these apart; return the new end.

    `samples` (3, n) are times, positions and what goes with them; `passed` (2,), the time and position of the
    last sample before, becomes that of the last one here. From the newest back, which was held up least, each
    sample is at the latest a period before the next, less where more have come since the last step than
    periods fit in. NaN as `period_s` leaves the times as they are.
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
    """Sort by time, stably, leave out what is older than the last step or there twice; return the end."""
    for i in range(begin + 1, end):
        place = i
        while place > begin and samples[0, place - 1] > samples[0, place]:
            for r in range(3):
                samples[r, place - 1], samples[r, place] = samples[r, place], samples[r, place - 1]
            place -= 1
    before_s, before_m, kept = passed[0], passed[1], begin
    for i in range(begin, end):
        since_s = samples[0, i] - before_s
        if since_s <= 0.0 or (since_s < _TOGETHER * period_s and samples[1, i] == before_m):
            continue
        for r in range(3):
            samples[r, kept] = samples[r, i]
        before_s, before_m = samples[0, kept], samples[1, kept]
        kept += 1
    return kept
