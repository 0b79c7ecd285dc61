"""The proof: how large the gap is, before and after, on data that took no part in fitting or choosing."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from observer.config import Config
from observer.discovery.hypothesis import Fit
from observer.frames import BoolArray, FloatArray

WORSE = 1.2
"""A sensor whose gap grows by this factor, and beyond what nobody would notice, has got worse."""
NOTICED = 3.0
"""In units of the floor."""


@dataclass(frozen=True, slots=True)
class SensorGap:
    """Root mean square of measured less predicted on the proof, in K: before, after, and the noise alone."""

    before_rms_K: float
    after_rms_K: float
    floor_rms_K: float


@dataclass(frozen=True, slots=True)
class Proof:
    """The gap over all sensors and by sensor.

    Before: with the free parameters calibrated and no effect added. `as_given_rms_K`: with the configuration
    as it was given. `goodness`: the mean of the squared whitened error of the proof after.
    """

    whole: SensorGap
    per_sensor: dict[str, SensorGap]
    as_given_rms_K: float
    goodness: float

    @property
    def worse(self) -> tuple[str, ...]:
        """The sensors that are predicted worse than before."""
        return tuple(
            name
            for name, gap in self.per_sensor.items()
            if gap.after_rms_K > max(WORSE * gap.before_rms_K, NOTICED * gap.floor_rms_K)
        )


def prove(null: Fit, fit: Fit) -> Proof:
    """Open the proof: compare the fit without effects with the one chosen."""
    problem, evidence = fit.problem, fit.problem.evidence
    rows = evidence.proof
    before, after, given = (_error_K(null, c) for c in (null.config, fit.config, problem.config))
    noise_K = evidence.noise_K
    per_sensor = {
        sensor.name: _gap(rows & (evidence.sensor == s), before, after, noise_K)
        for s, sensor in enumerate(problem.config.sensor)
        if (rows & (evidence.sensor == s)).any()
    }
    whitened = fit.marginal(rows)(evidence.whitened(after)[rows])
    return Proof(
        whole=_gap(rows, before, after, noise_K),
        per_sensor=per_sensor,
        as_given_rms_K=_rms(given[rows]),
        goodness=float(np.mean(whitened**2)),
    )


def _error_K(fit: Fit, config: Config) -> FloatArray:
    return np.asarray(fit.problem.evidence.measured_degC - fit.problem.predicted(config))


def _gap(rows: BoolArray, before: FloatArray, after: FloatArray, noise_K: FloatArray) -> SensorGap:
    return SensorGap(_rms(before[rows]), _rms(after[rows]), _rms(noise_K[rows]))


def _rms(values: FloatArray) -> float:
    return float(np.sqrt(np.mean(values**2)))
