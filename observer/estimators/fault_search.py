"""Finds the sensor at fault by comparing each reading with filters that do not use that sensor.

The misfit of a sensor is its reading minus the expectation of all others, in standard deviations. A sensor
with a misfit beyond four is a suspect. A faulty reading misleads the filters that use it. The sensor at fault
is therefore the one whose removal makes all others agree, clearly better than any other removal. If no sensor
qualifies, or a second one departs, the fault is ambiguous. A sensor that does not answer the heats
(`answers`) is in doubt. A trend common to all innovations over minutes means that all readings drift. Source:
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
"""Standard deviations from the expectation of the others beyond which a reading is a suspect."""
_TRACE = 120  # steps of the bank in the trace, ten minutes
_COMMON_DRIFT = (24, 120), 6.0  # numbers of steps, and the limit of the common innovation in σ
# Standard deviations by which one fault must explain more than any other: of a suspect, of another sensor.
_CLEARER, _CLEAREST = 0.5, 2.5
_AMBIGUOUS_S = 600.0
_ENOUGH = 3  # sensors, of which one can be identified as wrong


class BankObservation(NamedTuple):
    """Results of a step of the bank for s sensors.

    Attributes:
        age_s: Time for which all inputs have been known, s.
        used: True for sensors that the estimate uses, (s,).
        departed: True for sensors excluded by this search, (s,).
        thermal: True for thermocouples, (s,).
        misfit: Distance of a reading from the expectation of all others, in σ, (s,).
        misfit_of_pair: The same of the second sensor of a pair without both, (s, s). NaN where the bank has
            no such filter.
        innovation_K: Innovations of the filter with all sensors, K, (s,), NaN without a reading.
        covariance_K2: Their covariance, K², (s, s).
    """

    age_s: float
    used: BoolArray
    departed: BoolArray
    thermal: BoolArray
    misfit: FloatArray
    misfit_of_pair: FloatArray
    innovation_K: FloatArray
    covariance_K2: FloatArray


class Trace(NamedTuple):
    """The common part of recent innovations, and the state of the search; changed in place.

    Attributes:
        shared: Ring of the common part over ten minutes, in σ, (120,).
        steps: Number of steps recorded, (1,). It returns to 0 while inputs are unsettled.
        waited_s: Time for which the fault has been ambiguous, s, (1,).
    """

    shared: FloatArray
    steps: NDArray[np.int64]
    waited_s: FloatArray

    @classmethod
    def empty(cls) -> Self:
        """Return the trace before the first step."""
        return cls(np.zeros(_TRACE), np.zeros(1, np.int64), np.zeros(1))


class SearchResult(NamedTuple):
    """The decision of a search.

    Attributes:
        doubted: Whether the estimate must not be called good at this step.
        sensor: Number of the sensor to exclude, or -1.
        latch: Code of `kernels.codes` for a lasting fault that no exclusion resolves, or 0. It is `DRIFTING`
            or `AMBIGUOUS`.
    """

    doubted: bool
    sensor: int
    latch: int


def search(observation: BankObservation, trace: Trace, answers: SensorAnswers, span_s: float) -> SearchResult:
    """Record an observation of the bank, and decide whether a sensor is at fault.

    The search needs inputs that have been known for `YOUNG_S`. A common drift is decided first. A sensor is
    excluded only if its removal explains the misfits clearly better than any other removal, and if no sensor
    is excluded already. A fault that stays ambiguous for ten minutes is latched.

    Args:
        observation: The last step of the bank.
        trace: Memory of the search, changed in place.
        answers: The test whether readings answer the heats.
        span_s: Length of the step, s.

    Returns:
        The decision.
    """
    _note(observation, trace)
    if observation.age_s < YOUNG_S:
        trace.waited_s[0] = 0.0
        return SearchResult(False, -1, 0)
    if _has_common_drift(trace):
        return SearchResult(True, -1, DRIFTING)
    suspects = np.flatnonzero(observation.used & (np.abs(observation.misfit) > MISFIT)).tolist()
    sensor = answers.sensor_at_fault(observation.used)
    silent = answers.silent[observation.used].sum()
    if not suspects and sensor < 0:
        trace.waited_s[0] = 0.0
        return SearchResult(bool(silent), -1, 0)
    if sensor < 0 and silent <= 1.0:
        sensor = _explaining(suspects, observation)
    if sensor >= 0:
        trace.waited_s[0] = 0.0
        return (
            SearchResult(True, -1, AMBIGUOUS) if observation.departed.any() else SearchResult(True, sensor, 0)
        )
    trace.waited_s[0] += span_s
    lost = trace.waited_s[0] > _AMBIGUOUS_S and observation.used.sum() >= _ENOUGH
    return SearchResult(True, -1, AMBIGUOUS if lost else 0)


def _note(observation: BankObservation, trace: Trace) -> None:
    """Record the common part of all thermocouples' innovations, in standard deviations."""
    if observation.age_s < SETTLED_S:
        trace.steps[0] = 0
        return
    at = int(trace.steps[0]) % _TRACE
    trace.steps[0] += 1
    trace.shared[at] = 0.0
    used = np.isfinite(observation.innovation_K)
    if (used & observation.thermal).sum() > 1:
        weight = np.linalg.inv(observation.covariance_K2[np.ix_(used, used)])
        direction = observation.thermal[used].astype(float)
        trace.shared[at] = float(
            direction @ weight @ observation.innovation_K[used] / np.sqrt(direction @ weight @ direction)
        )


def _has_common_drift(trace: Trace) -> bool:
    """Return whether the common part of all innovations is larger than chance allows."""
    lengths, most = _COMMON_DRIFT
    count = int(trace.steps[0])
    last = trace.shared[(count - 1 - np.arange(_TRACE)) % _TRACE]
    return any(count >= n and abs(last[:n].sum()) > most * np.sqrt(n) for n in lengths)


def _explaining(suspects: list[int], observation: BankObservation) -> int:
    """Return the sensor whose removal makes the others agree, clearly better than any other, or -1.

    A suspect needs a smaller lead over the others.
    """
    used = np.flatnonzero(observation.used).tolist()
    left = {i: _left_apart(i, used, observation) for i in used}
    best = min(left, key=lambda i: left[i])
    rest = min((apart for i, apart in left.items() if i != best), default=np.inf)
    clear = rest >= left[best] + (_CLEARER if best in suspects else _CLEAREST)
    return best if clear and left[best] <= MISFIT else -1


def _left_apart(i: int, used: list[int], observation: BankObservation) -> float:
    """Return the largest misfit of the remaining readings without sensor i, in standard deviations."""
    others = [j for j in used if j != i and np.isfinite(observation.misfit_of_pair[i, j])]
    return (
        float(np.abs(observation.misfit_of_pair[i, others]).max())
        if len(others) >= _ENOUGH - 1
        else float("inf")
    )
