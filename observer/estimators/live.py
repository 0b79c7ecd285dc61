"""An estimator and its self-test for one step after the other, on memory that lives as long as they do."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from observer.estimators import packing
from observer.estimators.by_block import BlockEstimator
from observer.estimators.kalman import KalmanEstimator
from observer.estimators.packing import Results
from observer.estimators.protocol import EstimatorState
from observer.estimators.selftest import MOTION_STEP, SelfTest, SelfTestState, Tested
from observer.frames import EstimateBlock, FloatArray, Inputs
from observer.kernels import record
from observer.kernels.layout import Bundle


class LiveEstimator:
    """Takes one step after the other by the same kernels as `BlockEstimator.run`, on memory allocated once.

    Attributes:
        results: Results of the last step, overwritten by the next.
        fields: Names, types and places of the estimate's columns in the bytes of a step.
        record: The estimator as `kernels.step_frame` takes it.
    """

    def __init__(self, estimator: BlockEstimator, inputs: Inputs, inputs_record: Any) -> None:
        """Allocate the memory.

        Args:
            estimator: The estimator whose kernels take the steps.
            inputs: One step; the caller writes each step's inputs into its arrays.
            inputs_record: `inputs` as a record.
        """
        self._estimator, self._inputs, self._inputs_record = estimator, inputs, inputs_record
        self._scratch, plant = estimator.scratch(), estimator.plant
        allocated = packing.empty_results(plant, 1)
        self._block = Bundle.of(_columns(packing.to_block(plant, inputs.time_s, allocated)))
        self.fields = self._block.fields
        shared_arrays = {ours: self._block[name] for ours, name in _SAME.items()}
        self._learned = self._block["learned"], self._block["learned_sigma"]
        self._folds = allocated.field.shape[1] > self._block["field_degC"].size + self._block["error_um"].size
        if not self._folds:
            shared_arrays["field"] = self._block.over("field_degC", allocated.field.shape)
            shared_arrays["field_sigma"] = self._block.over("field_sigma_K", allocated.field.shape)
            shared_arrays["field_bound"] = self._block.over("field_bound_K", allocated.field.shape)
        self.results = allocated._replace(**shared_arrays)
        results = self._results_record = record(self.results)
        kalman = isinstance(estimator, KalmanEstimator)
        self.record = record(
            EstimatorTick(
                packing.Batch(
                    estimator.plant_record, None, inputs_record, np.zeros(1, np.int64), estimator.gate_sigma
                ),
                math.nan, self._table_of, self._scratch.running_record, results, self._scratch.work_record,
                None if kalman else self._take, self._name if self._folds or plant.learnt else None,
                self._block["time_s"], self._block.octets, *self._bounded(),
            )
        )  # fmt: skip

    def _table_of(self, length_s: float) -> Any:
        """Return the table of steps of this length."""
        self._chunk = self._estimator.single(self._inputs, length_s)
        return self._chunk.table

    def _bounded(self) -> tuple[Any, Any, Callable[[], None] | None]:
        """Return the bank's gathered inputs, its bounds and its step; None without a bank."""
        bank = self._scratch.bank
        if bank is None:
            return None, None, None
        return bank.gathered_record, bank.bounds_record, self._step_bank

    def _step_bank(self) -> None:
        """Step the bank, which is due."""
        self._scratch.step_bank(self.results, 0, float(self._inputs.time_s[0]))

    def _take(self) -> None:
        """Take the step for an estimator that has no compiled step."""
        self._estimator.take(
            self._chunk, self._inputs_record, self._scratch, self.results, self._results_record
        )

    def _name(self) -> None:
        """Fill in the columns that are computed from results with names and units."""
        plant = self._estimator.plant
        self._learned[0][...], self._learned[1][...] = packing.learned_of(plant, self.results)
        if self._folds:
            named = packing.to_block(plant, self._inputs.time_s, self.results)
            for name in _FOLDED:
                self._block[name][...] = getattr(named, name)

    @property
    def state(self) -> EstimatorState:
        """The current state, a copy, valid at the time of the last step."""
        return self._scratch.state(float(self._block["time_s"][0]))

    def take(self, state: EstimatorState) -> None:
        """Set the state and its time, as after a restart from a checkpoint."""
        self._scratch.take(state)
        self._block["time_s"][0] = state.time_s


class EstimatorTick(NamedTuple):
    """The data of one step for `kernels.step_frame`.

    Attributes:
        batch: Plant, inputs and table of the step.
        length_s: Length for which the table was made, s, NaN before the first step.
        table_of: Returns the table for another length, s.
        running: Record of the state.
        results: Record of the results.
        work: Record of the scratch memory.
        other: Takes the step of an estimator that is not the Kalman filter, else None.
        finish: Fills in columns that are not copies of results, else None.
        time_s: Time of the step, s, (1,).
        octets: The published columns as bytes.
        gathered: Record of the bank's inputs, or None.
        bounds: Record of the bank's bounds, or None.
        step_bank: Steps the bank when it is due, or None.
    """

    batch: packing.Batch
    length_s: float
    table_of: Callable[[float], Any]
    running: Any
    results: Any
    work: Any
    other: Callable[[], None] | None
    finish: Callable[[], None] | None
    time_s: FloatArray
    octets: Any
    gathered: Any
    bounds: Any
    step_bank: Callable[[], None] | None


_SAME = {
    "heat": "heat_W", "heat_sigma": "heat_sigma_W", "law": "law_W", "innovation": "innovation_K",
    "innovation_sigma": "innovation_sigma_K", "sensor_quality": "sensor_quality", "quality": "quality",
    "heat_bound": "heat_bound_W", "part_quality": "part_quality",
}  # fmt: skip
"""Results that a block has as they are, by their names there."""
_FOLDED = (
    "field_degC", "error_um", "field_sigma_K", "error_sigma_um", "field_bound_K", "error_bound_um",
    "force_N", "force_sigma_N", "force_bound_N",
)  # fmt: skip
_ORDER = (
    "heat_W", "heat_sigma_W", "law_W", *_FOLDED, "heat_bound_W",
    "innovation_K", "innovation_sigma_K", "time_s", "learned", "learned_sigma", "sensor_quality", "quality",
    "part_quality",
)  # fmt: skip
"""The columns of a block as they lie in memory: kernels write field and error as one array."""


def _columns(block: EstimateBlock) -> dict[str, Any]:
    return {name: getattr(block, name) for name in _ORDER}


class TestTick(NamedTuple):
    """The data of one self-test for `kernels.step_frame`.

    Attributes:
        paths: Records of the samples of each nut's position.
        travel_m: Lowest and highest position of each nut, m, (M, 2).
        state: Memory of the tests, changed in place.
        inputs: Record of the step's inputs.
        tested: The step's estimates and the motion of the nuts.
        trust: Record of `Trust`.
        scores: Scratch, (3,).
    """

    paths: tuple[Any, ...]
    travel_m: FloatArray
    state: SelfTestState
    inputs: Any
    tested: Tested
    trust: Any
    scores: FloatArray


class LiveSelfTest:
    """Tests steps by the same kernels as `SelfTest`; `record` is what `kernels.step_frame` takes."""

    def __init__(
        self, test: SelfTest, paths: dict[str, Any], inputs: Inputs, inputs_record: Any, results: Results
    ) -> None:
        """Allocate it for the steps of a memory.

        Args:
            test: The self-test of the plant.
            paths: Records of the positions' samples, by channel.
            inputs: The step that the loop overwrites.
            inputs_record: `inputs` as a record.
            results: Results that the estimator overwrites.
        """
        self._state = test.initial()
        tested = Tested(
            inputs.time_s, inputs.dt_s, inputs.quality, results.sensor_quality, results.innovation,
            results.innovation_sigma, results.heat, results.heat_sigma, results.law,
            np.empty((1, len(test.travel_m)), MOTION_STEP),
        )  # fmt: skip
        self.record = record(
            TestTick(
                tuple(paths[channel] for channel in test.travel_m),
                np.array(list(test.travel_m.values()), float).reshape(-1, 2),
                self._state, inputs_record, tested, test.trust_record, np.empty(3),
            )
        )  # fmt: skip

    @property
    def state(self) -> SelfTestState:
        """The current state, a copy; its type is that of `SelfTest.run`."""
        return SelfTestState._make(array.copy() for array in self._state)

    def take(self, state: SelfTestState) -> None:
        """Set the state."""
        for array, value in zip(self._state, state, strict=True):
            array[...] = value
