"""What all estimators share: a block is cut into chunks of few step lengths, and each is run through."""

from __future__ import annotations

import threading
from abc import ABC, abstractmethod
from typing import Any

from observer.estimators import packing
from observer.estimators.protocol import EstimatorState
from observer.estimators.steps import Chunk, StepCache, chunks
from observer.frames import EstimateBlock, Inputs, Layout
from observer.kernels import record
from observer.model.plant import Plant
from observer.tables.estimator import EstimatorSettings


class Scratch:
    """What kernels change on the way, as records that live as long as the estimator; one for each thread.

    `inputs` and `results` are those of a single step, which the live service takes again and again.
    """

    inputs: Inputs | None = None
    inputs_record: Any

    def __init__(self, plant: Plant, arrays: packing.PlantArrays) -> None:
        """Allocate it for a plant."""
        self.work = packing.scratch(arrays)
        self.running = packing.thaw(packing.initial_state(plant))
        self.results = packing.empty_results(plant, 1)
        self.work_record, self.running_record = record(self.work), record(self.running)
        self.results_record = record(self.results)

    def take(self, state: EstimatorState) -> None:
        """Copy a state into the arrays that change."""
        packing.thaw_into(self.running, state)

    def put(self, inputs: Inputs) -> Inputs:
        """Copy the inputs of a single step to where the kernels read them."""
        if self.inputs is None:
            self.inputs = Inputs._make(array.copy() for array in inputs.packed())
            self.inputs_record = record(self.inputs)
        own: Any
        for own, given in zip(self.inputs, inputs, strict=True):
            own[...] = given
        return self.inputs


class BlockEstimator(ABC):
    """An `Estimator`, but for what it does with a chunk of steps."""

    def __init__(self, plant: Plant, settings: EstimatorSettings) -> None:
        """Bring the plant into the kernels' form, once."""
        self._plant = plant
        self._gate_sigma = float(settings.gate_sigma)
        self._arrays = packing.pack_plant(plant)
        self._plant_record = record(self._arrays)
        self._steps = StepCache(plant)
        self._own = threading.local()

    @property
    def layout(self) -> Layout:
        """What the columns of the estimates are."""
        return self._plant.layout

    def initial(self) -> EstimatorState:
        """Return the state before the first measurement."""
        return packing.initial_state(self._plant)

    def run(self, state: EstimatorState, inputs: Inputs) -> tuple[EstimatorState, EstimateBlock]:
        """Take K steps; a run of K is, to the last bit, K runs of one."""
        if not hasattr(self._own, "scratch"):
            self._own.scratch = self._scratch()
        scratch: Scratch = self._own.scratch
        scratch.take(state)
        if len(inputs) == 1:
            chunk = self._steps.single(scratch.put(inputs))
            self._take(chunk, scratch.inputs_record, scratch, scratch.results, scratch.results_record)
            results = packing.Results._make([array.copy() for array in scratch.results])
        else:
            results = packing.empty_results(self._plant, len(inputs))
            for chunk in chunks(self._steps, inputs):
                out = packing.cut(results, chunk.part)
                self._take(chunk, record(chunk.inputs), scratch, out, record(out))
        time_s = float(inputs.time_s[-1]) if len(inputs) else state.time_s
        return packing.freeze(scratch.running, time_s), packing.to_block(self._plant, inputs.time_s, results)

    def _scratch(self) -> Scratch:
        return Scratch(self._plant, self._arrays)

    @abstractmethod
    def _take(self, chunk: Chunk, inputs: Any, scratch: Any, out: packing.Results, results: Any) -> None:
        """Take a chunk's steps: change the state, fill in the results; what else is in the scratch is stale.

        `inputs` are the chunk's, and `results` are `out`, as kernels take them.
        """
