"""An observer with designed gains: which gain for which sensors and step length, and the run through the
kernel.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from observer.estimators.compiled import packing
from observer.estimators.compiled.cruise_kernel import columns
from observer.estimators.compiled.fixed_gain_kernel import DONE, GainTable, Rungs, run_fixed_gain
from observer.estimators.compiled.steps import Chunk, StepCache, chunks
from observer.estimators.design.gains import sensor_rows
from observer.estimators.design.riccati import steady_covariance
from observer.estimators.protocol import EstimatorState
from observer.frames import BoolArray, EstimateBlock, FloatArray, Inputs, contiguous
from observer.model.discretise import StepMatrices, quantise, step_matrices
from observer.model.plant import Plant

# Gains are designed for steps of period · 2^{l/4}: a step is then at most 9 % off the one its gain was
# designed for.
_RUNGS_PER_OCTAVE = 4
_PERIOD_RUNG = 8
_LAST_RUNG = 127

Design = Callable[[StepMatrices, BoolArray], FloatArray | None]


class GainBank:
    """Gains by sensors and step length, designed when first needed; a pure function of both, so order does
    not matter.

    `design(step, present)` returns K (n, s) or nothing where those sensors determine nothing: the observer
    then predicts only, and its σ grow.
    """

    def __init__(self, plant: Plant, period_s: float, design: Design) -> None:
        self._plant = plant
        self._period_s = float(quantise(np.array(period_s)))
        self._design = design
        self._rows: dict[int, tuple[FloatArray, ...]] = {}
        self._table: GainTable | None = None
        self.add((_PERIOD_RUNG << plant.rows.sensors) + (1 << plant.rows.sensors) - 1)

    @property
    def table(self) -> GainTable:
        """All gains so far, for the kernel."""
        if self._table is None:
            columns = [np.stack(column) for column in zip(*self._rows.values(), strict=True)]
            K, steady, P, S, heat_sigma, field_sigma = columns
            keys = np.array(list(self._rows), dtype=np.int64)
            self._table = GainTable(keys, K, steady.astype(np.bool_), P, S, heat_sigma, field_sigma)
        return self._table

    def rungs(self, lengths_s: list[float]) -> Rungs:
        """Return the rung of each step length; the first frame's step of 0 counts as a period."""
        dt_s = np.array(lengths_s)
        octaves = np.log2(np.where(dt_s > 0, dt_s, self._period_s) / self._period_s)
        rung = np.clip(np.rint(octaves * _RUNGS_PER_OCTAVE) + _PERIOD_RUNG, 0, _LAST_RUNG).astype(np.int64)
        exact = np.array(
            [dt == self._length_s(int(r)) for dt, r in zip(lengths_s, rung, strict=True)], dtype=np.bool_
        )
        return Rungs(rung, exact)

    def add(self, key: int) -> None:
        """Design the gain of a key: rung · 2^s + sensors as bits."""
        s = self._plant.rows.sensors
        present = np.array([bool(key >> i & 1) for i in range(s)])
        step = step_matrices(self._plant, self._length_s(key >> s))
        K = self._design(step, present)
        self._rows[key] = self._gain(step, K)
        self._table = None

    def _length_s(self, rung: int) -> float:
        return float(quantise(np.array(self._period_s * 2.0 ** ((rung - _PERIOD_RUNG) / _RUNGS_PER_OCTAVE))))

    def _gain(self, step: StepMatrices, K: FloatArray | None) -> tuple[FloatArray, ...]:
        plant, C = self._plant, sensor_rows(self._plant)
        s, n = C.shape
        heats, wide = n - len(plant.decay_1_s), len(plant.rows.C) - s
        steady = None if K is None else steady_covariance(plant, step, K)
        if K is None or steady is None:
            blank = (np.zeros((n, n)), np.zeros(s), np.zeros(heats), np.zeros(wide))
            return (np.zeros((n, s)) if K is None else K, np.array(False), *blank)
        P = contiguous(0.5 * (steady.P + steady.P.T))
        heat_sigma = np.sqrt(np.diag(P)[-heats:])
        rows = plant.rows.C[s:]
        field_sigma = np.sqrt(
            np.maximum(np.einsum("ra,ab,rb->r", rows, P[: rows.shape[1], : rows.shape[1]], rows), 0.0)
        )
        S = np.einsum("ij,jk,ik->i", C, steady.P_pred, C) + plant.noise_R_K2
        return K, np.array(True), P, S, heat_sigma, field_sigma


class FixedGainEngine:
    """Runs blocks of inputs through the kernel of fixed gains."""

    def __init__(
        self, plant: Plant, period_s: float, gate_sigma: float, design: Design, *, optimal: bool
    ) -> None:
        """Design the gain for all sensors; `optimal` corrects by the Kalman gain until the
        covariance has settled.
        """
        self._plant = plant
        self._optimal = optimal
        self._gate_sigma = float(gate_sigma)
        self._arrays = packing.pack_plant(plant)
        self._steps = StepCache(plant)
        self._bank = GainBank(plant, period_s, design)

    def run(self, state: EstimatorState, inputs: Inputs) -> tuple[EstimatorState, EstimateBlock]:
        """Take K steps; a run of K is, to the last bit, K runs of one."""
        running = packing.thaw(state)
        results = packing.empty_results(self._plant, len(inputs))
        work = packing.scratch(self._arrays)
        for chunk in chunks(self._steps, inputs):
            self._run(chunk, running, packing.cut(results, chunk.part), work)
        time_s = float(inputs.time_s[-1]) if len(inputs) else state.time_s
        return packing.freeze(running, time_s), packing.to_block(self._plant, inputs.time_s, results)

    def _run(self, chunk: Chunk, running: packing.Running, out: packing.Results, work: packing.Work) -> None:
        """Run the kernel, designing the gains it asks for on the way."""
        rungs = self._bank.rungs(chunk.lengths_s)
        first, resumed, key = 0, 0, 0
        while key != DONE:
            first, key, resumed = run_fixed_gain(
                self._arrays,
                chunk.table,
                rungs,
                chunk.inputs,
                chunk.step,
                running,
                self._gate_sigma,
                self._optimal,
                self._bank.table,
                out,
                first,
                resumed,
                work,
                columns(self._arrays),
            )
            if key != DONE:
                self._bank.add(int(key))
