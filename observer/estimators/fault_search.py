"""Which sensor is at fault, by what filters that never had its readings expect of it.

The misfit of a sensor is how far its reading is from what all others expect, in standard deviations. One
beyond four is a suspect. A fault of one reading misleads the filters that use it, so the sensor at fault is
the one without which all others agree, and clearly better than without any other. Where none is, or a second
one departs, it cannot be identified. A sensor that does not answer the heats (`answers`) is in doubt. What
all innovations have in common over minutes is no single sensor's doing: then all readings drift. Source:
after Brown and Chin (1998) and Blanch et al. (2012).
"""

from __future__ import annotations

from typing import NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from observer.estimators.answers import SETTLED_S, SensorAnswers
from observer.frames import BoolArray, FloatArray
from observer.kernels.codes import AMBIGUOUS, DRIFTING
from observer.kernels.screening import YOUNG_S

MISFIT = 4.0
"""Standard deviations of what the others expect, beyond which a reading is at fault."""
_TRACE = 120  # steps of the bank that are looked back on, ten minutes
_TOGETHER = (24, 120), 6.0  # over so many, standard deviations that all innovations have in common
# Standard deviations by which one sensor's fault explains more than any other's, of a suspect and of another.
_CLEARER, _CLEAREST = 0.5, 2.5
_AMBIGUOUS_S = 600.0
_ENOUGH = 3  # sensors, of which one can be identified as wrong


class Seen(NamedTuple):
    """What a step of the bank has seen, of s sensors.

    For `age_s` all inputs have been known; which sensors are `there`, which have `departed`, and which are
    `thermal`, not of a displacement (s,); how far readings are from what all others expect, in standard
    deviations, `misfit` (s,); `misfit_of_pair` (s, s), that of the second of two sensors without both; the
    innovations (s,) of all, and their covariance (s, s).
    """

    age_s: float
    there: BoolArray
    departed: BoolArray
    thermal: BoolArray
    misfit: FloatArray
    misfit_of_pair: FloatArray
    innovation_K: FloatArray
    covariance_K2: FloatArray


class Trace(NamedTuple):
    """What innovations had in common lately, in a ring; how many steps there were; and for how long it has
    not been clear which sensor is at fault.
    """

    shared: FloatArray
    steps: NDArray[np.int64]
    waited_s: FloatArray

    @classmethod
    def empty(cls) -> Self:
        """Return the trace before the first step."""
        return cls(np.zeros(_TRACE), np.zeros(1, np.int64), np.zeros(1))


class SearchResult(NamedTuple):
    """Whether readings are in doubt, the sensor at fault, -1 for none, and what cannot be explained, or 0."""

    doubted: bool
    sensor: int
    latch: int


def search(seen: Seen, trace: Trace, answers: SensorAnswers, span_s: float) -> SearchResult:
    """Note what was seen over the last `span_s`, and say which sensor is at fault."""
    _note(seen, trace)
    if seen.age_s < YOUNG_S:
        trace.waited_s[0] = 0.0
        return SearchResult(False, -1, 0)
    if _together(trace):
        return SearchResult(True, -1, DRIFTING)
    suspects = np.flatnonzero(seen.there & (np.abs(seen.misfit) > MISFIT)).tolist()
    sensor = answers.sensor_at_fault(seen.there)
    silent = answers.silent[seen.there].sum()
    if not suspects and sensor < 0:
        trace.waited_s[0] = 0.0
        return SearchResult(bool(silent), -1, 0)
    if sensor < 0 and silent <= 1.0:
        sensor = _explaining(suspects, seen)
    if sensor >= 0:
        trace.waited_s[0] = 0.0
        return SearchResult(True, -1, AMBIGUOUS) if seen.departed.any() else SearchResult(True, sensor, 0)
    trace.waited_s[0] += span_s
    lost = trace.waited_s[0] > _AMBIGUOUS_S and seen.there.sum() >= _ENOUGH
    return SearchResult(True, -1, AMBIGUOUS if lost else 0)


def _note(seen: Seen, trace: Trace) -> None:
    """Note what all innovations of thermocouples have in common, in standard deviations."""
    if seen.age_s < SETTLED_S:
        trace.steps[0] = 0
        return
    at = int(trace.steps[0]) % _TRACE
    trace.steps[0] += 1
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
