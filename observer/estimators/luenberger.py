"""The Luenberger observer with augmented heats."""

from __future__ import annotations

from observer.estimators.design.bandwidth import bandwidth, design
from observer.estimators.design.gains import Refusal
from observer.estimators.fixed_gain import FixedGainEstimator
from observer.frames import BoolArray, FloatArray
from observer.model.discretise import StepMatrices
from observer.model.plant import Plant
from observer.tables.estimator import EstimatorSettings


class LuenbergerEstimator(FixedGainEstimator):
    """x⁺ = x_pred + K (y - C x_pred), K placed by the bandwidth rule or Kim's; σ propagated with that K."""

    optimal = False
    refused = (
        "estimator: no Luenberger gain for {sensors} exists: {reason}; add or move sensors (`observer "
        'place`), lower bandwidth_1_s, or use kind = "kalman"'
    )

    def __init__(self, plant: Plant, settings: EstimatorSettings) -> None:
        """Find the bandwidth, and the gain for all sensors; raises `UserError` where there is none."""
        self._rule = settings.pole_rule
        self._bandwidth_1_s = bandwidth(plant, settings)
        super().__init__(plant, settings)

    def gain(self, step: StepMatrices, present: BoolArray) -> FloatArray | Refusal:
        """The gain that places the poles."""
        gain = design(self._plant, step, present, self._rule, self._bandwidth_1_s)
        return gain if isinstance(gain, Refusal) else gain.K
