"""Which sensor is at fault, by what filters that never had its readings expect of it.

Of each sensor it is known how far its reading is from what all others expect, in standard deviations: its
misfit. One beyond four is a suspect, and so is a reading that stays where it is while the others say that it
changes. A fault of one reading misleads the filters that use it, so the sensor at fault is the one without
which all others agree, and clearly better than without any other. Where none is, or a second one departs, it
cannot be identified. What all innovations have in common over minutes is no single sensor's doing: then all
readings drift. Source: after Brown and Chin (1998) and Blanch et al. (2012).
"""

from __future__ import annotations

from typing import NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from observer.frames import BoolArray, FloatArray
from observer.kernels.codes import AMBIGUOUS, DRIFTING
from observer.kernels.screening import YOUNG_S

MISFIT = 4.0
"""Standard deviations of what the others expect, beyond which a reading is at fault."""
_TRACE = 120  # steps of the bank that are looked back on, ten minutes
_TOGETHER = (24, 120), 6.0  # over so many, standard deviations that all innovations have in common
# A change that is expected, in K and in standard deviations, and what part of it a held reading shows.
_HELD_K, _HELD_SIGMA, _HELD_SHARE = 0.7, 4.0 * np.sqrt(2.0), 0.2
# Standard deviations by which one sensor's fault explains more than any other's, of a suspect and of another.
_CLEARER, _CLEAREST = 0.5, 2.5
_SETTLED_S = 1200.0  # before, innovations say more of the model than of the readings
_AMBIGUOUS_S = 600.0
_ENOUGH = 3  # sensors, of which one can be identified as wrong


class Seen(NamedTuple):
    """What a step of the bank has seen, of s sensors.

    For `age_s` all inputs have been known; which sensors are `there`, which have `departed`, and which are
    `thermal`, not of a displacement (s,); what they `read_degC` (s,), NaN where nothing is to be had, and by
    how much that is more than what all others expect, `left_K`, in standard deviations `misfit` (s,);
    `misfit_of_pair` (s, s), the misfit of the second of two sensors by what is expected without both; the
    innovations (s,) of all, and their covariance (s, s).
    """

    age_s: float
    there: BoolArray
    departed: BoolArray
    thermal: BoolArray
    read_degC: FloatArray
    left_K: FloatArray
    misfit: FloatArray
    misfit_of_pair: FloatArray
    innovation_K: FloatArray
    covariance_K2: FloatArray


class Trace(NamedTuple):
    """What has been seen lately, in rings: what innovations have in common, what was read and expected; how
    many steps there were; and for how long it has not been clear who is at fault.
    """

    shared: FloatArray
    read_degC: FloatArray
    expected_degC: FloatArray
    steps: NDArray[np.int64]
    waited_s: FloatArray

    @classmethod
    def of(cls, sensors: int) -> Self:
        """Nothing yet."""
        unknown = np.full((_TRACE, sensors), np.nan)
        return cls(np.zeros(_TRACE), unknown, unknown.copy(), np.zeros(1, np.int64), np.zeros(1))


class SearchResult(NamedTuple):
    """Whether readings are in doubt, the sensor at fault, -1 for none, and what cannot be explained, or 0."""

    doubted: bool
    sensor: int
    latch: int


def search(seen: Seen, trace: Trace, span_s: float) -> SearchResult:
    """Note what was seen over the last `span_s`, and say which sensor is at fault."""
    _note(seen, trace)
    if seen.age_s < YOUNG_S:
        trace.waited_s[0] = 0.0
        return SearchResult(False, -1, 0)
    if _together(trace):
        return SearchResult(True, -1, DRIFTING)
    suspects = np.flatnonzero(seen.there & ((np.abs(seen.misfit) > MISFIT) | _held(seen, trace))).tolist()
    if not suspects:
        trace.waited_s[0] = 0.0
        return SearchResult(False, -1, 0)
    found = _explaining(suspects, seen)
    if found >= 0:
        trace.waited_s[0] = 0.0
        return SearchResult(True, -1, AMBIGUOUS) if seen.departed.any() else SearchResult(True, found, 0)
    trace.waited_s[0] += span_s
    lost = trace.waited_s[0] > _AMBIGUOUS_S and seen.there.sum() >= _ENOUGH
    return SearchResult(True, -1, AMBIGUOUS if lost else 0)


def _note(seen: Seen, trace: Trace) -> None:
    """Note what was read and expected, and what all innovations of thermocouples have in common, in standard
    deviations.
    """
    if seen.age_s < _SETTLED_S:
        trace.steps[0] = 0
        return
    at = int(trace.steps[0]) % _TRACE
    trace.steps[0] += 1
    trace.read_degC[at] = seen.read_degC
    trace.expected_degC[at] = seen.read_degC - seen.left_K
    trace.shared[at] = 0.0
    used = np.isfinite(seen.innovation_K)
    if (used & seen.thermal).sum() > 1:
        weight = np.linalg.inv(seen.covariance_K2[np.ix_(used, used)])
        each = seen.thermal[used].astype(float)
        trace.shared[at] = float(each @ weight @ seen.innovation_K[used] / np.sqrt(each @ weight @ each))


def _together(trace: Trace) -> bool:
    """Whether all innovations have more in common than chance makes."""
    lengths, most = _TOGETHER
    count = int(trace.steps[0])
    last = trace.shared[(count - 1 - np.arange(_TRACE)) % _TRACE]
    return any(count >= n and abs(last[:n].sum()) > most * np.sqrt(n) for n in lengths)


def _held(seen: Seen, trace: Trace) -> BoolArray:
    """Which readings stayed where they were while the others say that they changed, (s,)."""
    count = int(trace.steps[0])
    if count < _TRACE:
        return np.zeros(len(seen.there), bool)
    then, now = count % _TRACE, (count - 1) % _TRACE
    expected_K = np.abs(trace.expected_degC[now] - trace.expected_degC[then])
    read_K = np.abs(trace.read_degC[now] - trace.read_degC[then])
    sigma_K = np.full(len(seen.there), np.inf)
    np.divide(seen.left_K, seen.misfit, out=sigma_K, where=seen.misfit != 0.0)
    changes = expected_K > np.maximum(_HELD_K, _HELD_SIGMA * sigma_K)
    return np.asarray(changes & (read_K < _HELD_SHARE * expected_K))


def _explaining(suspects: list[int], seen: Seen) -> int:
    """The sensor without which the others agree, and clearly better than without any other; -1 for none.

    One that is a suspect itself is to be clearer by less.
    """
    there = np.flatnonzero(seen.there).tolist()
    left = {i: _left_apart(i, there, seen) for i in there}
    best = min(left, key=lambda i: left[i])
    rest = min((apart for i, apart in left.items() if i != best), default=np.inf)
    clear = rest >= left[best] + (_CLEARER if best in suspects else _CLEAREST)
    return best if clear and left[best] <= MISFIT else -1


def _left_apart(i: int, there: list[int], seen: Seen) -> float:
    """How far the worst of the readings that are left without sensor i is from what the others expect."""
    others = [j for j in there if j != i and np.isfinite(seen.misfit_of_pair[i, j])]
    return float(np.abs(seen.misfit_of_pair[i, others]).max()) if len(others) >= _ENOUGH - 1 else float("inf")
