"""The Kalman filter with the heats as random walks or first-order Markov processes; compiled engine."""

from __future__ import annotations

from observer.estimators.by_block import BlockEstimator
from observer.estimators.compiled.kalman_kernel import run_kalman
from observer.estimators.compiled.packing import Results, Running, Work
from observer.estimators.compiled.steps import Chunk


class KalmanEstimator(BlockEstimator):
    """Time-varying Kalman filter of the augmented state [x | δ]; the heat of a source is its law + δ.

    x⁺ = Ad x + known inputs, P⁺ = Ad P Adᵀ + Qd, then one correction by all sensors that are present and pass
    the gate. Source: Kalman (1960).
    """

    def _take(self, chunk: Chunk, running: Running, out: Results, work: Work) -> None:
        run_kalman(self._arrays, chunk.table, chunk.inputs, chunk.step, running, self._gate_sigma, out, work)
