"""The Luenberger observer with augmented heats."""

from __future__ import annotations

import numpy as np

from observer.errors import UserError
from observer.estimators.compiled import packing
from observer.estimators.design.bandwidth import bandwidth, design, everything
from observer.estimators.design.gains import LuenbergerGain, Refusal
from observer.estimators.fixed_gain import FixedGainEngine
from observer.estimators.protocol import EstimatorState
from observer.frames import BoolArray, EstimateBlock, FloatArray, Inputs, Layout
from observer.model.discretise import StepMatrices, step_matrices
from observer.model.plant import Plant
from observer.tables.estimator import EstimatorSettings


class LuenbergerEstimator:
    """x⁺ = x_pred + K (y - C x_pred) with K placed by the bandwidth rule or by Kim's; σ is propagated with
    that K.
    """

    def __init__(self, plant: Plant, settings: EstimatorSettings) -> None:
        """Design the gain for all sensors at the period; raises `UserError` where there is none to be
        trusted.
        """
        self._plant = plant
        self._rule = settings.pole_rule
        self._bandwidth_1_s = bandwidth(plant, settings) if self._rule == "bandwidth" else np.inf
        self.design_all(settings)
        self._engine = FixedGainEngine(
            plant, settings.period_s, settings.gate_sigma, self._design, optimal=False
        )

    @property
    def layout(self) -> Layout:
        """What the columns of the estimates are."""
        return self._plant.layout

    def initial(self) -> EstimatorState:
        """Return the state before the first measurement."""
        return packing.initial_state(self._plant)

    def run(self, state: EstimatorState, inputs: Inputs) -> tuple[EstimatorState, EstimateBlock]:
        """Take K steps; a run of K is, to the last bit, K runs of one."""
        return self._engine.run(state, inputs)

    def design_all(self, settings: EstimatorSettings) -> LuenbergerGain:
        """Return the gain for all sensors at the period, or raise `UserError`."""
        step = step_matrices(self._plant, settings.period_s)
        gain = design(self._plant, step, everything(self._plant), self._rule, self._bandwidth_1_s)
        if isinstance(gain, Refusal):
            raise UserError(
                f"estimator: no Luenberger gain for {', '.join(gain.sensors)} exists: {gain.reason}; "
                'add or move sensors (`observer place`), lower bandwidth_1_s, or use kind = "kalman"'
            )
        return gain

    def _design(self, step: StepMatrices, present: BoolArray) -> FloatArray | None:
        gain = design(self._plant, step, present, self._rule, self._bandwidth_1_s)
        return None if isinstance(gain, Refusal) else gain.K
