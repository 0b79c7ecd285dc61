"""The inputs of K steps from the values of frames: what drives the plant, and what its sensors read."""

from __future__ import annotations

from observer.kernels.codes import GOOD, INPUT_LOST, NUT_LOST
from observer.kernels.libm import isfinite, isnan


def fill_inputs(
    read, time_s, values, fresh, quality, law_before_W, z_before, begin_s, last_s,
    law, known, z_start, z_end, law_W, jump_W, y_degC, usable, sensor_quality, degraded,
):  # fmt: skip
    """Fill in the inputs of K steps, and of `law` what is not known; shapes as in `Inputs`."""
    for k in range(len(time_s)):
        hours = (time_s[k] - begin_s) / 3600.0
        hours_before = ((time_s[k - 1] if k > 0 else last_s) - begin_s) / 3600.0
        if isnan(hours_before):
            hours_before = hours
        ready = _fill_known(read, values, z_before, k, hours, hours_before, known, z_start, z_end)
        _fill_laws(law_before_W, k, law, law_W, jump_W)
        for i in range(len(read.sensors)):
            column = read.sensors[i]
            y_degC[k, i], sensor_quality[k, i] = values[k, column], quality[k, column]
            usable[k, i] = fresh[k, column] and quality[k, column] == GOOD and ready
        degraded[k] = 0
        for i in range(len(read.needed)):
            if quality[k, read.needed[i]] != GOOD:
                degraded[k] = INPUT_LOST
        for i in range(len(read.nuts)):
            if quality[k, read.nuts[i]] != GOOD:
                degraded[k] = NUT_LOST


def _fill_known(read, values, z_before, k, hours, hours_before, known, z_start, z_end):
    """Fill in the known inputs at both ends of step k; return whether all are numbers.

    The error's reference, which comes after it, is the first ambient unless it is given.
    """
    ready = True
    for q in range(known.shape[1]):
        before = known[k - 1, q] if k > 0 else z_before[q]
        known[k, q] = values[k, read.known[q]] if read.known[q] >= 0 else before
        if q == read.reference and isnan(known[k, q]):
            known[k, q] = known[k, read.ambient]
        z_end[k, q] = known[k, q] + read.shift_K[q] + hours * read.rate_K_h[q]
        start = before + read.shift_K[q] + hours_before * read.rate_K_h[q]
        z_start[k, q] = z_end[k, q] if isnan(start) else start
        ready = ready and isfinite(z_end[k, q])
    return ready


def _fill_laws(law_before_W, k, law, law_W, jump_W):
    """Fill in the heats by law over step k; one that was never known is that of standstill."""
    for j in range(law.shape[1]):
        before = law[k - 1, j] if k > 0 else law_before_W[j]
        if isnan(law[k, j]):
            law[k, j] = 0.0 if isnan(before) else before
        if isnan(before):
            before = law[k, j]
        law_W[k, j], jump_W[k, j] = (before + law[k, j]) / 2, law[k, j] - before
