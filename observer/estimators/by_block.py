"""Common base of all estimators: cuts a block into chunks of few step lengths and runs each chunk."""

from __future__ import annotations

import threading
from abc import ABC, abstractmethod
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from observer.config.estimator import EstimatorSettings
from observer.estimators import packing
from observer.estimators.protocol import EstimatorState
from observer.estimators.steps import Chunk, StepCache, chunks
from observer.frames import EstimateBlock, FloatArray, Inputs, Layout
from observer.kernels import record
from observer.model.plant import Plant

if TYPE_CHECKING:  # only the Kalman filter has one
    from observer.estimators.bank import Bank


class Scratch:
    """The memory that kernels change during a run, of one thread.

    Attributes:
        running: The arrays of the state.
        work: Scratch of a step.
        running_record: `running` as a record.
        work_record: `work` as a record.
        bank: The bank of filters; None without `[integrity]`.
    """

    def __init__(
        self, arrays: packing.PlantArrays, initial: EstimatorState, bank: Bank | None = None
    ) -> None:
        """Allocate the memory.

        Args:
            arrays: The plant, which gives the sizes.
            initial: The state at the start.
            bank: The bank of filters, or None.
        """
        self.running, self.work = packing.thaw(initial), packing.scratch(arrays)
        self.work_record, self.running_record = record(self.work), record(self.running)
        self.bank = bank

    def take(self, state: EstimatorState) -> None:
        """Set the state, that of the bank included."""
        packing.thaw_into(self.running, state)
        if self.bank is not None:
            self.bank.take(state.bank)

    def state(self, time_s: float) -> EstimatorState:
        """Return a copy of the state, valid at `time_s`."""
        state = packing.freeze(self.running, time_s)
        return state if self.bank is None else replace(state, bank=self.bank.octets)

    def step_bank(self, results: packing.Results, k: int, time_s: float) -> None:
        """Step the bank after step k of the estimate; without a bank nothing happens.

        Args:
            results: Results of the estimate.
            k: The step, an index into `results`.
            time_s: Time of the step, s.
        """
        if self.bank is not None:
            self.bank.step(self.running, self.running_record, results, k, time_s)


class BlockEstimator(ABC):
    """An `Estimator` without the step itself, which subclasses define in `take`.

    A run cuts a block into chunks that share a table of step lengths. Each thread has its own scratch memory,
    so one object can run in several threads.

    Attributes:
        plant: The model.
        gate_sigma: Distance in σ beyond which a reading is rejected.
        plant_record: The plant as a record for kernels.
    """

    def __init__(self, plant: Plant, settings: EstimatorSettings) -> None:
        """Bring the plant into the kernels' form, once."""
        self.plant = self._plant = plant
        self.gate_sigma = float(settings.gate_sigma)
        self._arrays = packing.pack_plant(plant)
        self.plant_record = record(self._arrays)
        self._steps = StepCache(plant)
        self._own = threading.local()

    def batch(self, chunk: Chunk, inputs: Any) -> Any:
        """Return a chunk's steps as a record for kernels.

        Args:
            chunk: The steps.
            inputs: Their inputs, already a record.
        """
        return record(packing.Batch(self.plant_record, chunk.table, inputs, chunk.step, self.gate_sigma))

    @property
    def layout(self) -> Layout:
        """The columns of the estimates."""
        return self._plant.layout

    def initial(self) -> EstimatorState:
        """Return the state before the first measurement; the first usable one starts the estimate."""
        return packing.initial_state(self._plant)

    def at(
        self, state: EstimatorState, x_hat: FloatArray, P: FloatArray, linearisation_point: FloatArray
    ) -> EstimatorState:
        """Return a state with field, heats and learnt parameters replaced.

        Args:
            state: The state that gives everything else: counters, screening and time.
            x_hat: The new states, (n,).
            P: Their covariance, (n, n).
            linearisation_point: As in `EstimatorState.around`.
        """
        return replace(state, x_hat=x_hat, P=P, around=linearisation_point)

    def run(self, state: EstimatorState, inputs: Inputs) -> tuple[EstimatorState, EstimateBlock]:
        """Take K steps; a run of K is, to the last bit, K runs of one.

        Args:
            state: The state before the steps, which stays unchanged.
            inputs: The K steps. Step lengths are rounded to microseconds.

        Returns:
            The state after the last step, and the K estimates. Without steps, the state as it was and an
            empty block.

        Raises:
            ValueError: If a step is negative or not finite.
        """
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
        """Allocate the memory that kernels change; `run` calls it once in each thread."""
        return Scratch(self._arrays, self.initial())

    def single(self, inputs: Inputs, length_s: float) -> Chunk:
        """Return one step as a chunk, for the live loop.

        Args:
            inputs: The step, packed for kernels; the chunk keeps a reference to it.
            length_s: Length of the step in whole microseconds, s.
        """
        return self._steps.single(inputs, length_s)

    @abstractmethod
    def take(self, chunk: Chunk, inputs: Any, scratch: Any, out: packing.Results, results: Any) -> None:
        """Take a chunk's steps: update the state and fill in the results; other scratch data is stale.

        Args:
            chunk: The steps with their table.
            inputs: The chunk's inputs as a record.
            scratch: Memory with the state, changed in place.
            out: Arrays of the results, one row per step.
            results: `out` as a record.
        """
