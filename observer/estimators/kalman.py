"""The Kalman filter with the heats as random walks or first-order Markov processes; compiled engine."""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from observer.config.estimator import EstimatorSettings, Integrity
from observer.estimators import packing
from observer.estimators.bank import Bank
from observer.estimators.by_block import BlockEstimator, Scratch
from observer.estimators.packing import Results
from observer.estimators.protocol import EstimatorState
from observer.estimators.steps import Chunk
from observer.frames import FloatArray
from observer.kernels import put_bounds, run_kalman, run_until_due
from observer.model.plant import Plant


class KalmanEstimator(BlockEstimator):
    """Time-varying Kalman filter of the augmented state [x | δ]; the heat of a source is its law + δ.

    x⁺ = Ad x + known inputs, P⁺ = Ad P Adᵀ + Qd, then one correction by all sensors that are present and pass
    the gate. Source: Kalman (1960). With `integrity`, readings are screened before the correction
    (`observer.kernels.screening`), and a bank of filters bounds the error (`observer.estimators.bank`).
    """

    def __init__(self, plant: Plant, settings: EstimatorSettings, integrity: Integrity | None = None) -> None:
        """Bring the plant into the kernels' form, once.

        Args:
            plant: The model. Its parameters are learnt or considered.
            settings: The table `[estimator]`, of which the gate is read.
            integrity: The table `[integrity]`; None takes readings without screening and gives no bounds.
        """
        super().__init__(plant, settings)
        self._integrity = integrity

    def initial(self) -> EstimatorState:
        """Return the state before the first measurement, with the bytes of a new bank if there is one."""
        state = packing.initial_state(self._plant, screens=self._integrity is not None)
        return state if self._integrity is None else replace(state, bank=self._begin)

    @cached_property
    def _begin(self) -> NDArray[np.uint8]:
        """The bytes of a bank before the first measurement."""
        return self._bank().octets

    def at(
        self, state: EstimatorState, x_hat: FloatArray, P: FloatArray, linearisation_point: FloatArray
    ) -> EstimatorState:
        """Return a state with field, heats and learnt parameters replaced, in every filter of the bank too.

        Arguments as in `BlockEstimator.at`. The memory of the search for faults starts anew.
        """
        replaced = super().at(state, x_hat, P, linearisation_point)
        if self._integrity is None:
            return replaced
        bank = self._bank()
        bank.begin_at(x_hat, P, linearisation_point)
        return replace(replaced, bank=bank.octets)

    def scratch(self) -> Scratch:
        """Allocate the memory that kernels change, with a bank if `[integrity]` is given."""
        bank = None if self._integrity is None else self._bank()
        scratch = Scratch(self._arrays, self.initial(), bank)
        scratch.running.flags[2] = bank is not None and bool(np.isfinite(bank.bounds.limit).any())
        return scratch

    def _bank(self) -> Bank:
        assert self._integrity is not None
        return Bank(self._plant, self._integrity, self.plant_record, self._steps.with_own_table())

    def take(self, chunk: Chunk, inputs: Any, scratch: Scratch, out: Results, results: Any) -> None:
        """Take a chunk's steps by the compiled filter; arguments as in `BlockEstimator.take`.

        With a bank, the kernel pauses when the bank is due, every `DUE_S`. The new bounds are written into
        that step.
        """
        bank, batch, k = scratch.bank, self.batch(chunk, inputs), 0
        if bank is None:
            run_kalman(batch, scratch.running_record, results, scratch.work_record)
            return
        while k < len(chunk.step):
            k = run_until_due(
                batch, scratch.running_record, results, scratch.work_record, bank.gathered_record,
                bank.bounds_record, k,
            )  # fmt: skip
            if bank.is_due:
                scratch.step_bank(out, k - 1, float(chunk.inputs.time_s[k - 1]))
                put_bounds(self.plant_record, inputs, results, k - 1, bank.bounds_record)
