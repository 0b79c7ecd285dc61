"""The proof: the prediction error before and after, on data that took no part in fitting or choosing."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from observer.fit.hypothesis import Fit
from observer.frames import BoolArray, FloatArray

WORSE = 1.2
"""A sensor whose whitened error grows by this factor, and beyond `NOTICED`, is predicted worse."""
NOTICED = 0.4
"""Mean squared whitened error beyond that of noise."""


@dataclass(frozen=True, slots=True)
class SensorError:
    """Root mean square of measured minus predicted on the proof, in K: before, after, and of noise alone.

    `before`, `after`: the mean squared whitened error, tolerances marginalised. `beyond_tolerances_K`: the
    root mean square before and after, less what the tolerances explain as estimated from the fitted data;
    without this, a complete model would still show its sensors' offsets. `form_K`: noise and model form error
    together.
    """

    before_rms_K: float
    after_rms_K: float
    floor_rms_K: float
    before: float
    after: float
    beyond_tolerances_K: tuple[float, float]
    form_K: float

    @property
    def growth_K(self) -> tuple[float, float]:
        """By how much the error has grown, raw and beyond tolerances, K."""
        before_K, after_K = self.beyond_tolerances_K
        return self.after_rms_K - self.before_rms_K, after_K - before_K


@dataclass(frozen=True, slots=True)
class Proof:
    """The error over all sensors and by sensor.

    Before: with the free parameters calibrated and no effect added. `as_given_rms_K`: with the configuration
    as it was given. `expected`: the mean squared whitened error of noise alone. `unproved`: those of several
    effects without which, all else refitted, the error is smaller, in K and whitened.
    """

    whole: SensorError
    per_sensor: dict[str, SensorError]
    as_given_rms_K: float
    expected: float
    unproved: tuple[str, ...] = ()

    @property
    def grown(self) -> bool:
        """Whether the error has grown in kelvin, raw and beyond tolerances, by more than noise."""
        return min(self.whole.growth_K) > self.whole.floor_rms_K

    @property
    def grown_on(self) -> tuple[str, ...]:
        """The sensors whose own error has grown: in kelvin, raw and beyond tolerances, by more than noise and
        form error, and whitened, beyond noise.

        Growth in kelvin alone is no proof: tolerances stretch to cover a missing effect, at a price, and
        relax when it is added.
        """
        return tuple(
            name
            for name, error in self.per_sensor.items()
            if min(error.growth_K) > error.form_K and error.after > max(error.before, self.expected)
        )

    @property
    def worse(self) -> tuple[str, ...]:
        """The sensors that are predicted worse than before."""
        return tuple(
            name
            for name, error in self.per_sensor.items()
            if error.after > max(WORSE * error.before, self.expected + NOTICED)
        )


class ProofError(NamedTuple):
    """The error of a fit on every row (n,): in K, in K beyond tolerances, and on the proof's rows whitened,
    tolerances marginalised.
    """

    error_K: FloatArray
    beyond_K: FloatArray
    whitened: FloatArray

    @classmethod
    def of(cls, fit: Fit) -> ProofError:
        """Predict all rows, the held-out ones as well."""
        rows, error_K = fit.problem.evidence.proof, fit.problem.error_K(fit.config)
        whitened = fit.marginal(rows)(fit.problem.evidence.whitened(error_K)[rows])
        return cls(error_K, error_K - fit.within_tolerances_K, whitened)


def prove(null: Fit, fit: Fit, less: Sequence[tuple[str, Fit]] = ()) -> Proof:
    """Open the proof: compare the fit without effects with the one chosen.

    `less`: where several effects were chosen, each with the fit of the others alone.
    """
    problem, evidence = fit.problem, fit.problem.evidence
    rows = evidence.proof
    before, after = ProofError.of(null), ProofError.of(fit)
    deviation_K = evidence.deviation_K

    def error(mine: BoolArray) -> SensorError:
        within = mine[rows]
        return SensorError(
            before_rms_K=rms(before.error_K[mine]),
            after_rms_K=rms(after.error_K[mine]),
            floor_rms_K=rms(evidence.noise_K[mine]),
            before=float(np.mean(before.whitened[within] ** 2)),
            after=float(np.mean(after.whitened[within] ** 2)),
            beyond_tolerances_K=(rms(before.beyond_K[mine]), rms(after.beyond_K[mine])),
            form_K=rms(deviation_K[mine]),
        )

    sensors = {s.name: rows & (evidence.sensor == i) for i, s in enumerate(problem.config.sensor)}
    whole = error(rows)
    return Proof(
        whole=whole,
        per_sensor={name: error(mine) for name, mine in sensors.items() if mine.any()},
        as_given_rms_K=rms(problem.error_K(problem.config)[rows]),
        expected=evidence.expected,
        unproved=tuple(name for name, others in less if _better(ProofError.of(others), rows, whole)),
    )


def _better(others: ProofError, rows: BoolArray, whole: SensorError) -> bool:
    """Whether the fit of fewer effects has a smaller error: in K, raw and beyond tolerances, and whitened."""
    more_K = (
        whole.after_rms_K - rms(others.error_K[rows]),
        whole.beyond_tolerances_K[1] - rms(others.beyond_K[rows]),
    )
    return min(more_K) > whole.form_K and float(np.mean(others.whitened**2)) < whole.after


def rms(values: FloatArray) -> float:
    """The root mean square of values."""
    return float(np.sqrt(np.mean(values**2)))
