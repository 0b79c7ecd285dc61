"""The proof: how large the gap is, before and after, on data that took no part in fitting or choosing."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from observer.config import Config
from observer.fit.hypothesis import Fit
from observer.frames import BoolArray, FloatArray

WORSE = 1.2
"""A sensor whose whitened error grows by this factor, and beyond `NOTICED`, has got worse."""
NOTICED = 0.4
"""Mean squared whitened error beyond that of noise."""


@dataclass(frozen=True, slots=True)
class SensorGap:
    """Root mean square of measured less predicted on the proof, in K: before, after, and the noise alone.

    `before`, `after`: the mean squared whitened error, tolerances marginalised.
    """

    before_rms_K: float
    after_rms_K: float
    floor_rms_K: float
    before: float
    after: float


@dataclass(frozen=True, slots=True)
class Proof:
    """The gap over all sensors and by sensor.

    Before: with the free parameters calibrated and no effect added. `as_given_rms_K`: with the configuration
    as it was given. `expected`: what noise alone makes of the mean squared whitened error.
    `beyond_tolerances_rms_K`: the gap before and after without what the tolerances make of it, as the data
    that were fitted tell them.
    """

    whole: SensorGap
    per_sensor: dict[str, SensorGap]
    as_given_rms_K: float
    expected: float
    beyond_tolerances_rms_K: tuple[float, float]

    @property
    def grown(self) -> bool:
        """Whether the gap has grown in kelvin, beyond what noise makes of it."""
        before_K, after_K = self.beyond_tolerances_rms_K
        return after_K > before_K + self.whole.floor_rms_K

    @property
    def worse(self) -> tuple[str, ...]:
        """The sensors that are predicted worse than before."""
        return tuple(
            name
            for name, gap in self.per_sensor.items()
            if gap.after > max(WORSE * gap.before, self.expected + NOTICED)
        )


def prove(null: Fit, fit: Fit) -> Proof:
    """Open the proof: compare the fit without effects with the one chosen."""
    problem, evidence = fit.problem, fit.problem.evidence
    rows = evidence.proof
    before, after, given = (_error_K(null, c) for c in (null.config, fit.config, problem.config))
    whitened = [f.marginal(rows)(evidence.whitened(e)[rows]) ** 2 for f, e in ((null, before), (fit, after))]

    def gap(mine: BoolArray) -> SensorGap:
        within = mine[rows]
        return SensorGap(
            _rms(before[mine]),
            _rms(after[mine]),
            _rms(evidence.noise_K[mine]),
            *(float(w[within].mean()) for w in whitened),
        )

    sensors = {s.name: rows & (evidence.sensor == i) for i, s in enumerate(problem.config.sensor)}
    return Proof(
        whole=gap(rows),
        per_sensor={name: gap(mine) for name, mine in sensors.items() if mine.any()},
        as_given_rms_K=_rms(given[rows]),
        expected=evidence.expected,
        beyond_tolerances_rms_K=(
            _rms((before - null.within_tolerances_K)[rows]),
            _rms((after - fit.within_tolerances_K)[rows]),
        ),
    )


def _error_K(fit: Fit, config: Config) -> FloatArray:
    return np.asarray(fit.problem.evidence.measured_degC - fit.problem.predicted(config))


def _rms(values: FloatArray) -> float:
    return float(np.sqrt(np.mean(values**2)))
