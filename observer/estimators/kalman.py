"""The Kalman filter with the heats as random walks or first-order Markov processes; compiled engine."""

from __future__ import annotations

from typing import Any

from observer.estimators.by_block import BlockEstimator, Scratch
from observer.estimators.packing import Results
from observer.estimators.steps import Chunk
from observer.kernels import run_kalman


class KalmanEstimator(BlockEstimator):
    """Time-varying Kalman filter of the augmented state [x | δ]; the heat of a source is its law + δ.

    x⁺ = Ad x + known inputs, P⁺ = Ad P Adᵀ + Qd, then one correction by all sensors that are present and pass
    the gate. Source: Kalman (1960).
    """

    def take(self, chunk: Chunk, inputs: Any, scratch: Scratch, _out: Results, results: Any) -> None:
        """Take a chunk's steps by the compiled filter."""
        run_kalman(
            self.plant_record, chunk.table, inputs, chunk.step, scratch.running_record, self.gate_sigma,
            results, scratch.work_record,
        )  # fmt: skip
