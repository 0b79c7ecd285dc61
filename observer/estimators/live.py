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
    """Takes steps by the same kernels as `BlockEstimator.run`; `results` are those of the last step.

    `record` is what `kernels.step_frame` takes.
    """

    def __init__(self, estimator: BlockEstimator, inputs: Inputs, inputs_record: Any) -> None:
        """Allocate it; `inputs` are where those of each step will be."""
        self._estimator, self._inputs, self._inputs_record = estimator, inputs, inputs_record
        self._scratch, plant = estimator.scratch(), estimator.plant
        made = packing.empty_results(plant, 1)
        self._block = Bundle.of(_columns(packing.to_block(plant, inputs.time_s, made)))
        self.fields = self._block.fields
        own = {ours: self._block[name] for ours, name in _SAME.items()}
        self._learned = self._block["learned"], self._block["learned_sigma"]
        self._folds = made.field.shape[1] > self._block["field_degC"].size + self._block["error_um"].size
        if not self._folds:
            own["field"] = self._block.over("field_degC", made.field.shape)
            own["field_sigma"] = self._block.over("field_sigma_K", made.field.shape)
            own["field_bound"] = self._block.over("field_bound_K", made.field.shape)
        self.results = made._replace(**own)
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
        """The table of steps of this length."""
        self._chunk = self._estimator.single(self._inputs, length_s)
        return self._chunk.table

    def _bounded(self) -> tuple[Any, Any, Callable[[], None] | None]:
        """What is gathered for the bank, the bounds it holds, and its step."""
        bank = self._scratch.bank
        if bank is None:
            return None, None, None
        return bank.gathered_record, bank.held_record, self._step_bank

    def _step_bank(self) -> None:
        """Step the bank, which is due."""
        self._scratch.step_bank(self.results, 0, float(self._inputs.time_s[0]))

    def _take(self) -> None:
        """Take the step whose inputs are there, where the kernel does not know how."""
        self._estimator.take(
            self._chunk, self._inputs_record, self._scratch, self.results, self._results_record
        )

    def _name(self) -> None:
        """Fill in what is made of results with names and units."""
        plant = self._estimator.plant
        self._learned[0][...], self._learned[1][...] = packing.learned_of(plant, self.results)
        if self._folds:
            named = packing.to_block(plant, self._inputs.time_s, self.results)
            for name in _FOLDED:
                self._block[name][...] = getattr(named, name)

    def keep(self) -> tuple[Any, float]:
        """Return where it stands, to be put back."""
        return self._scratch.keep(), self._block["time_s"][0]

    def put_back(self, kept: tuple[Any, float]) -> None:
        """Stand where it stood."""
        self._scratch.put_back(kept[0])
        self._block["time_s"][0] = kept[1]

    @property
    def state(self) -> EstimatorState:
        """Where it stands."""
        return self._scratch.state(float(self._block["time_s"][0]))

    def take(self, state: EstimatorState) -> None:
        """Stand at a state."""
        self._scratch.take(state)
        self._block["time_s"][0] = state.time_s


class EstimatorTick(NamedTuple):
    """What the kernel takes: `other` takes the step if it is not the Kalman filter's, `finish` ends it.

    With a bank, `step_bank` steps it when it is due.
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
    held: Any
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
    """What the kernel takes for the self-test."""

    paths: tuple[Any, ...]
    travel_m: FloatArray
    state: SelfTestState
    inputs: Any
    seen: Tested
    trust: Any
    scores: FloatArray


class LiveSelfTest:
    """Tests steps by the same kernels as `SelfTest`; `record` is what `kernels.step_frame` takes."""

    def __init__(
        self, test: SelfTest, paths: dict[str, Any], inputs: Inputs, inputs_record: Any, results: Results
    ) -> None:
        """Allocate it for the steps of a memory; `paths` are records of the positions' samples."""
        self._bundle = Bundle.of(test.initial()._asdict())
        self._state = SelfTestState._make(self._bundle[name] for name in SelfTestState._fields)
        seen = Tested(
            inputs.time_s, inputs.dt_s, inputs.quality, results.sensor_quality, results.innovation,
            results.innovation_sigma, results.heat, results.heat_sigma, results.law,
            np.empty((1, len(test.travel_m)), MOTION_STEP),
        )  # fmt: skip
        self.record = record(
            TestTick(
                tuple(paths[channel] for channel in test.travel_m),
                np.array(list(test.travel_m.values()), float).reshape(-1, 2),
                self._state, inputs_record, seen, test.trust_record, np.empty(3),
            )
        )  # fmt: skip

    def keep(self) -> bytes:
        """Return where it stands, to be put back."""
        return self._bundle.octets.tobytes()

    def put_back(self, kept: bytes) -> None:
        """Stand where it stood."""
        self._bundle.put_back(kept)

    @property
    def state(self) -> SelfTestState:
        """Where it stands."""
        return SelfTestState._make(array.copy() for array in self._state)

    def take(self, state: SelfTestState) -> None:
        """Stand at a state."""
        for own, given in zip(self._state, state, strict=True):
            own[...] = given
