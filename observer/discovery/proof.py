"""The proof: the error of predictions on held-out data, before and after, and the conclusion from it.

An effect is named only if it removes more of the gap than its own uncertainty could, in K and beyond
tolerances.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from observer.config.machine import Config
from observer.fit.hypothesis import Fit
from observer.frames import BoolArray, FloatArray

WORSE = 1.2
"""A sensor whose whitened error grows by this factor, and beyond `NOTICED`, is predicted worse."""
NOTICED = 0.4
"""Mean squared whitened error beyond that of noise."""


FALLS = 0.2
"""Least part of the gap beyond tolerances that an effect takes away on held-out data.

A proof is a dozen stretches at most whose errors are independent (an hour or less of each sensor, and form
errors that last a quarter of an hour); a root mean square of a dozen values is known to 1/√24, a fifth.
"""


@dataclass(frozen=True, slots=True)
class SensorError:
    """The error of measured minus predicted on the proof, without and with the effects.

    Attributes:
        before_rms_K: Rms without the effects, K.
        after_rms_K: Rms with them, K.
        floor_rms_K: Rms of noise alone, K.
        before: Mean squared whitened error without them, tolerances marginalised.
        after: The same with them.
        beyond_tolerances_K: Rms before and after, less the part that tolerances explain (as fitted), K.
            Without this, even a complete model would show its sensors' offsets.
        form_K: Rms of noise and model form error together, K.
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
        """The growth of the error, raw and beyond tolerances, K."""
        before_K, after_K = self.beyond_tolerances_K
        return self.after_rms_K - self.before_rms_K, after_K - before_K


@dataclass(frozen=True, slots=True)
class Proof:
    """The error over all sensors and by sensor.

    "Before" means with the free parameters calibrated and no effect added.

    Attributes:
        whole: Error over all sensors.
        per_sensor: Error by sensor name.
        as_given_rms_K: Rms with the original configuration, K.
        expected: Mean squared whitened error of noise alone.
        unproved: Effects that remove too little of the gap (see `proves`).
        stretch: σ by which tolerances must be off to replace these.
    """

    whole: SensorError
    per_sensor: dict[str, SensorError]
    as_given_rms_K: float
    expected: float
    unproved: tuple[str, ...] = ()
    stretch: float = 0.0

    @property
    def grown_on(self) -> tuple[str, ...]:
        """The sensors whose own error has grown.

        It must have grown in kelvin, raw and beyond tolerances, by more than noise and form error; and
        whitened, by more than noise. Growth in kelvin alone does not count: tolerances stretch to cover a
        missing effect, at a price, and relax when it is added.
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
    """The error of a fit on the evidence, the proof included.

    Attributes:
        error_K: Measured minus predicted of every row, K, (n,).
        beyond_K: The same less the part that tolerances explain, K, (n,).
        whitened: Whitened error on the proof, tolerances marginalised.
    """

    error_K: FloatArray
    beyond_K: FloatArray
    whitened: FloatArray

    @classmethod
    def of(cls, fit: Fit, named: Config) -> ProofError:
        """Predict all rows, the held-out ones too.

        Args:
            fit: The fit.
            named: Configuration with the effects that are to be proved. Tolerances about the same things are
                limited more narrowly.
        """
        rows, error_K = fit.problem.evidence.proof, fit.problem.error_K(fit.config)
        whitened = fit.marginal(rows)(fit.problem.evidence.whitened(error_K)[rows])
        return cls(error_K, error_K - fit.within_tolerances_K(named), whitened)


def prove(null: Fit, fit: Fit, fewer: Sequence[tuple[str, Fit]] = ()) -> Proof:
    """Open the proof: compare the fit without effects with the chosen one.

    Args:
        null: The fit without effects.
        fit: The fit with the chosen effects.
        fewer: Name of each chosen effect, with the fit of the others alone.
    """
    problem, evidence = fit.problem, fit.problem.evidence
    rows = evidence.proof
    before, after = ProofError.of(null, fit.config), ProofError.of(fit, fit.config)
    deviation_K = evidence.deviation_K

    def error(counted: BoolArray) -> SensorError:
        in_proof = counted[rows]
        return SensorError(
            before_rms_K=rms(before.error_K[counted]),
            after_rms_K=rms(after.error_K[counted]),
            floor_rms_K=rms(evidence.noise_K[counted]),
            before=float(np.mean(before.whitened[in_proof] ** 2)),
            after=float(np.mean(after.whitened[in_proof] ** 2)),
            beyond_tolerances_K=(rms(before.beyond_K[counted]), rms(after.beyond_K[counted])),
            form_K=rms(deviation_K[counted]),
        )

    sensors = {s.name: rows & (evidence.sensor == i) for i, s in enumerate(problem.config.sensor)}
    whole = error(rows)
    left_K, noise_K = whole.beyond_tolerances_K[1], whole.floor_rms_K
    gaps_K = [(name, rms(ProofError.of(others, fit.config).beyond_K[rows])) for name, others in fewer]
    unproved = tuple(name for name, gap_K in gaps_K if not proves(gap_K, left_K, noise_K))
    return Proof(
        whole=whole,
        per_sensor={name: error(of_sensor) for name, of_sensor in sensors.items() if of_sensor.any()},
        as_given_rms_K=rms(problem.error_K(problem.config)[rows]),
        expected=evidence.expected,
        unproved=unproved,
        stretch=max((others.stretch(fit.config) for name, others in fewer if name in unproved), default=0.0),
    )


def proves(without_K: float, with_K: float, noise_K: float) -> bool:
    """Return whether an effect proves itself on held-out data.

    It must remove the fraction `FALLS` of the gap, and the removed part must exceed noise. Squares of
    independent errors add up.

    Args:
        without_K: Rms of the gap without the effect, K or µm.
        with_K: Rms of the gap with it.
        noise_K: Rms of noise alone.
    """
    gone_K2 = without_K**2 - with_K**2
    return with_K <= (1.0 - FALLS) * without_K and gone_K2 > noise_K**2


def rms(values: FloatArray) -> float:
    """Return the root mean square of values."""
    return float(np.sqrt(np.mean(values**2)))
