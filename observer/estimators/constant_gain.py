"""The Kalman filter with the constant gain of its steady state: the engine "constant"."""

from __future__ import annotations

from observer.estimators.design.gains import Refusal
from observer.estimators.design.riccati import steady_kalman
from observer.estimators.fixed_gain import FixedGainEstimator
from observer.frames import BoolArray, FloatArray
from observer.model.discretise import StepMatrices


class ConstantGainEstimator(FixedGainEstimator):
    """Kalman filter with the steady gain of every set of sensors; for long logs at an even period.

    Laws whose uncertain jumps matter, and moving nuts whose columns change much, are better served by
    `KalmanEstimator`: the gain here knows only the mean of the columns and no jumps (σ does know the jumps).
    """

    optimal = True
    refused = (
        "estimator: no constant gain exists for sensors {sensors}: {reason}; add or move sensors (`observer "
        'place`), give each source random_walk_W_sqrt_s > 0, or use engine = "compiled"'
    )

    def gain(self, step: StepMatrices, present: BoolArray) -> FloatArray | Refusal:
        """The steady Kalman gain."""
        return steady_kalman(self._plant, step, present)
