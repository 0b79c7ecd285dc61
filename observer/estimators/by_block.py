"""Common base of all estimators: cuts a block into chunks of few step lengths and runs each chunk."""

from __future__ import annotations

import threading
from abc import ABC, abstractmethod
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from observer.estimators import packing
from observer.estimators.protocol import EstimatorState
from observer.estimators.steps import Chunk, StepCache, chunks
from observer.frames import EstimateBlock, FloatArray, Inputs, Layout
from observer.kernels import record
from observer.kernels.layout import Bundle
from observer.model.plant import Plant
from observer.tables.estimator import EstimatorSettings

if TYPE_CHECKING:  # only the Kalman filter has one
    from observer.estimators.bank import Bank


class Scratch:
    """The memory that kernels change during a run, as records, with the `bank` of filters if there is one."""

    def __init__(
        self, arrays: packing.PlantArrays, initial: EstimatorState, bank: Bank | None = None
    ) -> None:
        """Allocate it for a plant."""
        self.bundle = Bundle.of(packing.thaw(initial)._asdict())
        self.running = packing.Running._make(self.bundle[name] for name in packing.Running._fields)
        self.work = packing.scratch(arrays)
        self.work_record, self.running_record = record(self.work), record(self.running)
        self.bank = bank

    def take(self, state: EstimatorState) -> None:
        """Set the state."""
        packing.thaw_into(self.running, state)
        if self.bank is not None:
            self.bank.take(state.bank)

    def state(self, time_s: float) -> EstimatorState:
        """Return the state at a time."""
        state = packing.freeze(self.running, time_s)
        return state if self.bank is None else replace(state, bank=self.bank.octets)

    def step_bank(self, results: packing.Results, k: int, time_s: float) -> None:
        """Step the bank after step k of the estimate."""
        if self.bank is not None:
            self.bank.step(self.running, self.running_record, results, k, time_s)

    def keep(self) -> Any:
        """Return the state to be put back."""
        return self.bundle.octets.tobytes(), None if self.bank is None else self.bank.keep()

    def put_back(self, saved: Any) -> None:
        """Restore a state that `keep` returned."""
        self.bundle.put_back(saved[0])
        if self.bank is not None:
            self.bank.put_back(saved[1])


class BlockEstimator(ABC):
    """An `Estimator` without the step itself, which subclasses define in `take`."""

    def __init__(self, plant: Plant, settings: EstimatorSettings) -> None:
        """Bring the plant into the kernels' form, once."""
        self.plant = self._plant = plant
        self.gate_sigma = float(settings.gate_sigma)
        self._arrays = packing.pack_plant(plant)
        self.plant_record = record(self._arrays)
        self._steps = StepCache(plant)
        self._own = threading.local()

    def batch(self, chunk: Chunk, inputs: Any) -> Any:
        """Return a chunk's steps as kernels take them; `inputs` are the chunk's."""
        return record(packing.Batch(self.plant_record, chunk.table, inputs, chunk.step, self.gate_sigma))

    @property
    def layout(self) -> Layout:
        """The columns of the estimates."""
        return self._plant.layout

    def initial(self) -> EstimatorState:
        """Return the state before the first measurement."""
        return packing.initial_state(self._plant)

    def at(
        self, state: EstimatorState, x_hat: FloatArray, P: FloatArray, linearisation_point: FloatArray
    ) -> EstimatorState:
        """Return a state with field, heats and learnt parameters replaced."""
        return replace(state, x_hat=x_hat, P=P, around=linearisation_point)

    def run(self, state: EstimatorState, inputs: Inputs) -> tuple[EstimatorState, EstimateBlock]:
        """Take K steps; a run of K is, to the last bit, K runs of one."""
        if not hasattr(self._own, "scratch"):
            self._own.scratch = self.scratch()
        scratch: Scratch = self._own.scratch
        scratch.take(state)
        results = packing.empty_results(self._plant, len(inputs))
        for chunk in chunks(self._steps, inputs):
            out = packing.cut(results, chunk.part)
            self.take(chunk, record(chunk.inputs), scratch, out, record(out))
        time_s = float(inputs.time_s[-1]) if len(inputs) else state.time_s
        return scratch.state(time_s), packing.to_block(self._plant, inputs.time_s, results)

    def scratch(self) -> Scratch:
        """Allocate the memory that kernels change; each thread has its own."""
        return Scratch(self._arrays, self.initial())

    def single(self, inputs: Inputs, length_s: float) -> Chunk:
        """Return a single step of some length, packed, as a chunk."""
        return self._steps.single(inputs, length_s)

    @abstractmethod
    def take(self, chunk: Chunk, inputs: Any, scratch: Any, out: packing.Results, results: Any) -> None:
        """Take a chunk's steps: update the state and fill in the results; other scratch data is stale.

        `inputs` are the chunk's, and `results` are `out`, as kernels take them.
        """
