"""What all estimators share: a block is cut into chunks of few step lengths, and each is run through."""

from __future__ import annotations

import threading
from abc import ABC, abstractmethod

from observer.estimators.compiled import packing
from observer.estimators.compiled.steps import Chunk, StepCache, chunks
from observer.estimators.protocol import EstimatorState
from observer.frames import EstimateBlock, Inputs, Layout
from observer.model.plant import Plant
from observer.tables.estimator import EstimatorSettings


class BlockEstimator(ABC):
    """An `Estimator`, but for what it does with a chunk of steps."""

    def __init__(self, plant: Plant, settings: EstimatorSettings) -> None:
        """Bring the plant into the kernels' form, once; they are compiled by the first run."""
        self._plant = plant
        self._gate_sigma = float(settings.gate_sigma)
        self._arrays = packing.pack_plant(plant)
        self._steps = StepCache(plant)
        self._own = threading.local()  # scratch, which no two threads may share

    @property
    def layout(self) -> Layout:
        """What the columns of the estimates are."""
        return self._plant.layout

    def initial(self) -> EstimatorState:
        """Return the state before the first measurement."""
        return packing.initial_state(self._plant)

    def run(self, state: EstimatorState, inputs: Inputs) -> tuple[EstimatorState, EstimateBlock]:
        """Take K steps; a run of K is, to the last bit, K runs of one."""
        running = packing.thaw(state)
        results = packing.empty_results(self._plant, len(inputs))
        if not hasattr(self._own, "work"):
            self._own.work = packing.scratch(self._arrays)
        for chunk in chunks(self._steps, inputs):
            self._take(chunk, running, packing.cut(results, chunk.part), self._own.work)
        time_s = float(inputs.time_s[-1]) if len(inputs) else state.time_s
        return packing.freeze(running, time_s), packing.to_block(self._plant, inputs.time_s, results)

    @abstractmethod
    def _take(self, chunk: Chunk, running: packing.Running, out: packing.Results, work: packing.Work) -> None:
        """Take a chunk's steps: change the state, fill in the results; what is in the scratch is stale."""
