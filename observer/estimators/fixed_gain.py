"""Observers with designed gains: which gain for which sensors and step, and the run through the kernel.

The engine "constant" takes the steady Kalman gain, the Luenberger observer one that places poles.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable
from dataclasses import replace
from typing import Any, ClassVar

import numpy as np

from observer.errors import UserError
from observer.estimators import packing
from observer.estimators.by_block import BlockEstimator, Scratch
from observer.estimators.design.gains import LuenbergerGain, Refusal, everything, sensor_rows
from observer.estimators.design.steady import bandwidth, gain_for, steady_covariance
from observer.estimators.fixed_gain_records import FixedGainWork, GainTable, StepBins, considered, steady_step
from observer.estimators.packing import PlantArrays, Results
from observer.estimators.protocol import EstimatorState
from observer.estimators.steps import Chunk
from observer.frames import BoolArray, FloatArray, contiguous
from observer.kernels import record, run_fixed_gain
from observer.kernels.codes import DONE
from observer.kernels.fixed_gain import KEY
from observer.model.discretise import StepMatrices, quantise, step_matrices
from observer.model.plant import Plant
from observer.tables.estimator import EstimatorSettings

# Gains are designed for steps of period · 2^{l/4}: a step is then at most 9 % off the one its gain was
# designed for.
_BINS_PER_OCTAVE = 4
_PERIOD_BIN = 8
_LAST_BIN = 127

# A covariance counts as settled where no variance is further than this part of it from its steady value: 1 %
# of σ, a law's jump of 0.05 % of σ². One that hardly matters may be as far off as makes a quarter of that in
# what is reported, for several of them are off at once.
_SETTLED = 0.02
_SHARE = 0.25 * _SETTLED

Design = Callable[[StepMatrices, BoolArray], FloatArray | Refusal]


class GainBank:
    """Gains by sensors and step length, designed when first needed; a pure function of both, so order does
    not matter.

    Where `design(step, present)` refuses, as those sensors determine nothing, the observer predicts only, and
    its σ grow.
    """

    def __init__(self, plant: Plant, period_s: float, design: Design) -> None:
        self._plant = plant
        self._period_s = float(quantise(np.array(period_s)))
        self._design = design
        self._rows: dict[int, tuple[FloatArray, ...]] = {}
        self._table: Any = None
        self.add((_PERIOD_BIN << plant.rows.sensors) + (1 << plant.rows.sensors) - 1)

    @property
    def gains(self) -> GainTable:
        """All gains so far."""
        columns = [np.stack(column) for column in zip(*self._rows.values(), strict=True)]
        K, steady, *others = columns
        return GainTable(np.array(list(self._rows), dtype=np.int64), K, steady.astype(np.bool_), *others)

    @property
    def table(self) -> Any:
        """The same as the kernel takes it."""
        if self._table is None:
            self._table = record(self.gains)
        return self._table

    def bins(self, lengths_s: list[float]) -> StepBins:
        """Return the bin of each step length; the first frame's step of 0 counts as a period."""
        dt_s = np.array(lengths_s)
        octaves = np.log2(np.where(dt_s > 0, dt_s, self._period_s) / self._period_s)
        step_bin = np.clip(np.rint(octaves * _BINS_PER_OCTAVE) + _PERIOD_BIN, 0, _LAST_BIN).astype(np.int64)
        exact = np.array(
            [dt == self._length_s(int(r)) for dt, r in zip(lengths_s, step_bin, strict=True)], dtype=np.bool_
        )
        return StepBins(step_bin, exact)

    def add(self, key: int) -> None:
        """Design the gain of a key: bin · 2^s + sensors as bits."""
        s = self._plant.rows.sensors
        present = np.array([bool(key >> i & 1) for i in range(s)])
        step = step_matrices(self._plant, self._length_s(key >> s))
        self._rows[key] = self._gain(step, self._design(step, present))
        self._table = None

    def _length_s(self, step_bin: int) -> float:
        octaves = (step_bin - _PERIOD_BIN) / _BINS_PER_OCTAVE
        return float(quantise(np.array(self._period_s * 2.0**octaves)))

    def _gain(self, step: StepMatrices, K: FloatArray | Refusal) -> tuple[FloatArray, ...]:
        plant, C = self._plant, sensor_rows(self._plant)
        s, n = C.shape
        heats, wide = n - len(plant.decay_1_s), len(plant.rows.C) - s
        K, there = (np.zeros((n, s)), False) if isinstance(K, Refusal) else (K, True)
        steady = steady_covariance(plant, step, K) if there else None
        if steady is None:
            nothing = (np.zeros(size) for size in ((n, n), n, s, heats, wide))
            return K, np.array(False), *nothing
        P = contiguous(0.5 * (steady.P + steady.P.T))
        heat_sigma = np.sqrt(np.diag(P)[-heats:])
        rows = plant.rows.C[s:]
        field_sigma = np.sqrt(
            np.maximum(np.einsum("ra,ab,rb->r", rows, P[: rows.shape[1], : rows.shape[1]], rows), 0.0)
        )
        S = np.einsum("ij,jk,ik->i", C, steady.P_pred, C) + plant.noise_R_K2
        reported = np.concatenate([S, field_sigma**2])
        return K, np.array(True), P, slack(P, plant.rows.C, reported), S, heat_sigma, field_sigma


def slack(P: FloatArray, rows: FloatArray, variance: FloatArray) -> FloatArray:
    """How far each variance of P (n, n) may be from its steady value and count as settled, (n,), where
    `variance` (R,) are reported of `rows` (R, n_x).
    """
    squares, own = rows**2, _SETTLED * np.diag(P)
    reported = np.divide(variance[:, None], squares, out=np.full(rows.shape, np.inf), where=squares > 0.0)
    least, n_x = _SHARE * np.min(reported, axis=0), rows.shape[1]
    own[:n_x] = np.maximum(own[:n_x], np.where(np.isfinite(least), least, 0.0))
    return own


class FixedGainEstimator(BlockEstimator):
    """An observer with a designed gain for every set of sensors and length of step.

    The gain knows field and heats alone; what the plant knows only roughly is considered in every σ.

    `optimal`: it corrects by the Kalman gain until the covariance has settled. `refused` is what is said
    where there is no gain for all sensors.
    """

    optimal: ClassVar[bool]
    refused: ClassVar[str]

    def __init__(self, plant: Plant, settings: EstimatorSettings) -> None:
        """Design the gain for all sensors at the period. Raises `UserError` where there is none."""
        self._roughly, self._settings = packing.pack_plant(plant), settings
        plant = replace(plant, learning=None)
        super().__init__(plant, settings)
        whole = self.gain(step_matrices(plant, settings.period_s), everything(plant))
        if isinstance(whole, Refusal):
            raise UserError(self.refused.format(sensors=", ".join(whole.sensors), reason=whole.reason))
        self._bank = GainBank(plant, settings.period_s, self.gain)

    def initial(self) -> EstimatorState:
        """Return the state before the first measurement, with room for what is considered."""
        state, L = super().initial(), len(self._roughly.learn.kind)
        n, s = len(state.x_hat), len(state.suspect)
        return replace(state, around=np.zeros(n + 2 * s + n * L if L else 0))

    @abstractmethod
    def gain(self, step: StepMatrices, present: BoolArray) -> FloatArray | Refusal:
        """The gain K (n, s) for a step and the sensors `present` (s,)."""

    def scratch(self) -> Scratch:
        """Return what kernels change on the way, with what is considered."""
        reported = len(self.plant.rows.C) - self.plant.rows.sensors
        return FixedGainScratch(self._arrays, self._roughly, self.initial(), reported, optimal=self.optimal)

    def take(self, chunk: Chunk, inputs: Any, scratch: FixedGainScratch, _out: Results, results: Any) -> None:
        """Run the kernel, designing the gains it asks for on the way."""
        own, at = scratch.own, scratch.at
        own.bins, batch = record(self._bank.bins(chunk.lengths_s)), self.batch(chunk, inputs)
        at[:] = 0
        while True:
            own.gains = self._bank.table
            run_fixed_gain(batch, scratch.running_record, results, own)
            if at[KEY] == DONE:
                return
            self._bank.add(int(at[KEY]))


class FixedGainScratch(Scratch):
    """The same with the steady step's columns, and what is considered, on the memory of the state."""

    def __init__(
        self,
        arrays: PlantArrays,
        roughly: PlantArrays,
        initial: EstimatorState,
        reported: int,
        *,
        optimal: bool,
    ) -> None:
        """Allocate it; `roughly` is the plant with what is only roughly known of it."""
        super().__init__(arrays, initial)
        n, s, L = len(self.running.x), len(self.running.suspect), len(roughly.learn.kind)
        first = n + 2 * s if L else 0
        around, S = self.running.around[:first], self.running.around[first:].reshape(n, L)
        self.at = np.zeros(3, np.int64)
        steady, roughly_considered = steady_step(arrays, reported), considered(roughly, around, S)
        self.own = record(FixedGainWork(optimal, self.at, steady, roughly_considered, self.work_record))


class ConstantGainEstimator(FixedGainEstimator):
    """Kalman filter with the steady gain of every set of sensors; for long logs at an even period.

    Laws whose uncertain jumps matter, and moving nuts whose columns change much, are better served by
    `KalmanEstimator`: the gain here knows only the mean of the columns and no jumps (σ does know the jumps).
    """

    optimal = True
    refused = (
        "estimator: no constant gain exists for sensors {sensors}: {reason}; add or move sensors (`observer "
        'place`), give each source random_walk_W_sqrt_s > 0, or use engine = "compiled"'
    )

    def gain(self, step: StepMatrices, present: BoolArray) -> FloatArray | Refusal:
        """The steady Kalman gain, or a more cautious one."""
        gain = gain_for(self._plant, step, present, self._settings)
        return gain.K if isinstance(gain, LuenbergerGain) else gain


class LuenbergerEstimator(FixedGainEstimator):
    """x⁺ = x_pred + K (y - C x_pred), K placed by the bandwidth rule or Kim's; σ propagated with that K."""

    optimal = False
    refused = (
        "estimator: no Luenberger gain for {sensors} exists: {reason}; add or move sensors (`observer "
        'place`), lower bandwidth_1_s, or use kind = "kalman"'
    )

    def __init__(self, plant: Plant, settings: EstimatorSettings) -> None:
        """Find the bandwidth, and the gain for all sensors; raises `UserError` where there is none."""
        self._bandwidth_1_s = bandwidth(plant, settings)
        super().__init__(plant, settings)

    def gain(self, step: StepMatrices, present: BoolArray) -> FloatArray | Refusal:
        """The gain that places the poles."""
        gain = gain_for(self._plant, step, present, self._settings, self._bandwidth_1_s)
        return gain.K if isinstance(gain, LuenbergerGain) else gain
