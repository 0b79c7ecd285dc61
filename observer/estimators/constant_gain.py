"""The Kalman filter with the constant gain of its steady state: the engine "constant"."""

from __future__ import annotations

import numpy as np

from observer.errors import UserError
from observer.estimators.compiled import packing
from observer.estimators.design.gains import Refusal
from observer.estimators.design.riccati import steady_kalman
from observer.estimators.fixed_gain import FixedGainEngine
from observer.estimators.protocol import EstimatorState
from observer.frames import BoolArray, EstimateBlock, FloatArray, Inputs, Layout
from observer.model.discretise import StepMatrices, step_matrices
from observer.model.plant import Plant
from observer.tables.estimator import EstimatorSettings


class ConstantGainEstimator:
    """Kalman filter with the steady gain of every set of sensors; for long logs at an even period.

    Laws whose uncertain jumps matter, and moving nuts whose columns change much, are better served by
    `KalmanEstimator`: the gain here knows only the mean of the columns and no jumps (σ does know the jumps).
    """

    def __init__(self, plant: Plant, settings: EstimatorSettings) -> None:
        """Design the gain for all sensors at the period.

        Raises `UserError` where the Riccati equation has no stabilising solution.
        """
        self._plant = plant
        whole = steady_kalman(
            plant, step_matrices(plant, settings.period_s), np.ones(plant.rows.sensors, dtype=bool)
        )
        if isinstance(whole, Refusal):
            raise UserError(
                f"estimator: no constant gain exists for sensors {', '.join(whole.sensors)}: {whole.reason}"
                "; add or move sensors (`observer place`), give each source random_walk_W_sqrt_s > 0, or use "
                'engine = "compiled"'
            )
        self._engine = FixedGainEngine(
            plant, settings.period_s, settings.gate_sigma, self._design, optimal=True
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

    def _design(self, step: StepMatrices, present: BoolArray) -> FloatArray | None:
        K = steady_kalman(self._plant, step, present)
        return None if isinstance(K, Refusal) else K
