"""The Kalman filter with the heats as random walks or first-order Markov processes; compiled engine."""

from __future__ import annotations

import threading

from observer.estimators.compiled import packing
from observer.estimators.compiled.kalman_kernel import run_kalman
from observer.estimators.compiled.steps import StepCache, chunks
from observer.estimators.protocol import EstimatorState
from observer.frames import EstimateBlock, Inputs, Layout
from observer.model.plant import Plant
from observer.tables.estimator import EstimatorSettings


class KalmanEstimator:
    """Time-varying Kalman filter of the augmented state [x | δ]; the heat of a source is its law + δ.

    x⁺ = Ad x + known inputs, P⁺ = Ad P Adᵀ + Qd, then one correction by all sensors that are present and pass
    the gate. Source: Kalman (1960).
    """

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
        work = self._work()
        for chunk in chunks(self._steps, inputs):
            out = packing.cut(results, chunk.part)
            run_kalman(
                self._arrays, chunk.table, chunk.inputs, chunk.step, running, self._gate_sigma, out, work
            )
        time_s = float(inputs.time_s[-1]) if len(inputs) else state.time_s
        return packing.freeze(running, time_s), packing.to_block(self._plant, inputs.time_s, results)

    def _work(self) -> packing.Work:
        """Scratch of this thread; what is in it does not matter."""
        if not hasattr(self._own, "work"):
            self._own.work = packing.scratch(self._arrays)
        work: packing.Work = self._own.work
        return work
