"""Observers with designed gains: which gain for which sensors and step, and the run through the kernel.

The engine "constant" takes the steady Kalman gain, the Luenberger observer one that places poles.
"""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Callable
from dataclasses import replace
from typing import Any, ClassVar, NamedTuple

import numpy as np

from observer.config.estimator import EstimatorSettings
from observer.errors import UserError
from observer.estimators.by_block import BlockEstimator, Scratch
from observer.estimators.design.gains import LuenbergerGain, Refusal, closed_loop, everything, poles_of
from observer.estimators.design.steady import bandwidth, gain_for
from observer.estimators.packing import IntArray, PlantArrays, Results, states_of
from observer.estimators.protocol import EstimatorState
from observer.estimators.steps import Chunk
from observer.frames import BoolArray, FloatArray
from observer.kernels import record, run_fixed_gain
from observer.kernels.codes import FINISHED
from observer.kernels.fixed_gain import KEY
from observer.model.discretise import StepMatrices, quantise, step_matrices
from observer.model.plant import Plant

# Gains are designed for steps of period · 2^{l/4}: a step is then at most 9 % off the one its gain was
# designed for.
_BINS_PER_OCTAVE = 4
_PERIOD_BIN = 8
_LAST_BIN = 127

# The constant gain takes over from the Kalman gain of the moment after so many time constants of its error.
_TIME_CONSTANTS = 3.0

Design = Callable[[StepMatrices, BoolArray], FloatArray | Refusal]


class GainBank:
    """Gains by sensors and step length, each designed at its first use; their order does not matter.

    A gain (n, s) has rows of zeros for considered parameters. It is zero where no gain exists: the observer
    then predicts only, and its σ grow.

    Args:
        plant: The model, its nuisance parameters considered.
        period_s: Configured step, s. Gains are designed for steps of `period_s` · 2^(l/4). So each step is
            within 9 % of the one that its gain was designed for.
        design: Returns a gain for a step and the present sensors, or a `Refusal`.
    """

    def __init__(self, plant: Plant, period_s: float, design: Design) -> None:
        self._plant = plant
        self._period_s = float(quantise(np.array(period_s)))
        self._design = design
        self._gains: dict[int, FloatArray] = {}
        self._table: Any = None
        self.add((_PERIOD_BIN << plant.rows.sensors) + (1 << plant.rows.sensors) - 1)

    @property
    def gains(self) -> GainTable:
        """All gains so far."""
        return GainTable(np.array(list(self._gains), dtype=np.int64), np.stack(list(self._gains.values())))

    @property
    def table(self) -> Any:
        """All gains so far as a record for the kernel."""
        if self._table is None:
            self._table = record(self.gains)
        return self._table

    def bins(self, lengths_s: list[float]) -> IntArray:
        """Return the bin l + 8 of each step length, 0 to 127, (D,).

        Args:
            lengths_s: Step lengths, s. The first frame's step of 0 counts as a period.
        """
        dt_s = np.array(lengths_s)
        octaves = np.log2(np.where(dt_s > 0, dt_s, self._period_s) / self._period_s)
        bins: IntArray = np.clip(np.rint(octaves * _BINS_PER_OCTAVE) + _PERIOD_BIN, 0, _LAST_BIN).astype(
            np.int64
        )
        return bins

    def add(self, key: int) -> None:
        """Design the gain of a key, and discard the cached table.

        Args:
            key: bin · 2^s + sensors as bits, sensor 0 the lowest.
        """
        s = self._plant.rows.sensors
        present = np.array([bool(key >> i & 1) for i in range(s)])
        octaves = ((key >> s) - _PERIOD_BIN) / _BINS_PER_OCTAVE
        length_s = float(quantise(np.array(self._period_s * 2.0**octaves)))
        K, designed = (
            np.zeros((states_of(self._plant), s)),
            self._design(step_matrices(self._plant, length_s), present),
        )
        if not isinstance(designed, Refusal):
            K[: len(designed)] = designed
        self._gains[key], self._table = K, None


class FixedGainEstimator(BlockEstimator):
    """An observer with a designed gain for every set of sensors and length of step.

    The gain is designed for field and heats alone. Nuisance parameters of the plant are considered (Schmidt
    1966): they keep their values, and every σ contains their covariance.

    Attributes:
        settles: Whether the observer takes the current Kalman gain until the error of the start has faded.
        refused: Text of the error if no gain for all sensors exists, with places for `sensors` and `reason`.
    """

    settles: ClassVar[bool]
    refused: ClassVar[str]

    def __init__(self, plant: Plant, settings: EstimatorSettings) -> None:
        """Design the gain for all sensors at the configured period.

        Raises:
            UserError: If no gain exists for all sensors together.
        """
        self._settings, self._design_plant = settings, replace(plant, learning=None)
        parameters = plant.parameters
        considered = np.arange(len(parameters.kind))
        super().__init__(plant.with_parameters(parameters._replace(considered=considered)), settings)
        step = step_matrices(self._design_plant, settings.period_s)
        gain = self.gain(step, everything(plant))
        if isinstance(gain, Refusal):
            raise UserError(self.refused.format(sensors=", ".join(gain.sensors), reason=gain.reason))
        self._settling_s = _settling_s(self._design_plant, step, gain) if self.settles else 0.0
        self._bank = GainBank(self.plant, settings.period_s, self.gain)

    @abstractmethod
    def gain(self, step: StepMatrices, present: BoolArray) -> FloatArray | Refusal:
        """Return the gain K (n, s), without rows for parameters.

        Args:
            step: Matrices of the step for which the gain is designed.
            present: True for the sensors that have values, (s,). Others have zero columns.

        Returns:
            The gain, or the reason why none exists.
        """

    def scratch(self) -> FixedGainScratch:
        """Return the memory that kernels change."""
        return FixedGainScratch(self._arrays, self.initial(), self._settling_s)

    def take(self, chunk: Chunk, inputs: Any, scratch: FixedGainScratch, _out: Results, results: Any) -> None:
        """Run the kernel, and design the gains that it requests; arguments as in `BlockEstimator.take`.

        The kernel stops at a step without a gain. It continues there once the gain is in the table.
        """
        work, at = scratch.gain_work, scratch.at
        work.bins, batch = self._bank.bins(chunk.lengths_s), self.batch(chunk, inputs)
        at[:] = 0
        while True:
            work.gains = self._bank.table
            run_fixed_gain(batch, scratch.running_record, results, work)
            if at[KEY] == FINISHED:
                return
            self._bank.add(int(at[KEY]))


def _settling_s(plant: Plant, step: StepMatrices, K: FloatArray) -> float:
    """Return the time after which an error has faded that the gain K (n, s) alone corrects, s."""
    slowest_1_s = float(-poles_of(closed_loop(plant, step, K), step.dt_s)[0].real)
    return _TIME_CONSTANTS / slowest_1_s if slowest_1_s > 0.0 else math.inf


class GainTable(NamedTuple):
    """Gains designed so far, for the kernel.

    Attributes:
        key: bin · 2^s + sensors as bits, (G,).
        K: The gains, (G, n, s), with zero columns for absent sensors.
    """

    key: IntArray
    K: FloatArray


class FixedGainWork(NamedTuple):
    """Data of a run with designed gains.

    Attributes:
        settling_s: Time for which the current Kalman gain replaces the designed one after a start, s.
        at: Next step, key of the requested gain, and how that step was begun, (3,). See
            `kernels.fixed_gain.observe`.
        work: Record of the scratch memory.
        bins: Bin of each step length of the chunk's table, (D,), set for each chunk.
        gains: Record of `GainTable`, renewed after each design.
    """

    settling_s: float
    at: IntArray
    work: Any
    bins: IntArray = np.zeros(0, np.int64)
    gains: Any = None


class FixedGainScratch(Scratch):
    """The memory that kernels change, and their request for a gain.

    Attributes:
        at: As in `FixedGainWork`, (3,).
        gain_work: Record of a `FixedGainWork`.
    """

    def __init__(self, arrays: PlantArrays, initial: EstimatorState, settling_s: float) -> None:
        """Allocate it."""
        super().__init__(arrays, initial)
        self.at = np.zeros(3, np.int64)
        self.gain_work = record(FixedGainWork(settling_s, self.at, self.work_record))


class ConstantGainEstimator(FixedGainEstimator):
    """Kalman filter with the steady gain of every set of sensors, as a controller would run it.

    The gain is that of the mean columns of moving nuts, without jumps of laws; σ contains the jumps. Use
    `KalmanEstimator` where uncertain jumps of laws or the motion of nuts matter.
    """

    settles = True
    refused = (
        "estimator: no constant gain exists for sensors {sensors}: {reason}; add or move sensors (`observer "
        'place`), give each source random_walk_W_sqrt_s > 0, or use engine = "compiled"'
    )

    def gain(self, step: StepMatrices, present: BoolArray) -> FloatArray | Refusal:
        """Return the steady Kalman gain, or one designed for noisier sensors if errors would grow while a nut
        stands.
        """
        gain = gain_for(self._design_plant, step, present, self._settings)
        return gain.K if isinstance(gain, LuenbergerGain) else gain


class LuenbergerEstimator(FixedGainEstimator):
    """x⁺ = x_pred + K (y - C x_pred), K placed by the bandwidth rule or Kim's; σ propagated with that K.

    The rule is `[estimator] pole_rule`, the bandwidth `bandwidth_1_s` or the best one found. Nuisance
    parameters are considered.
    """

    settles = False
    refused = (
        "estimator: no Luenberger gain for {sensors} exists: {reason}; add or move sensors (`observer "
        'place`), lower bandwidth_1_s, or use kind = "kalman"'
    )

    def __init__(self, plant: Plant, settings: EstimatorSettings) -> None:
        """Compute the bandwidth and the gain for all sensors.

        Raises:
            UserError: If no bandwidth gives reachable poles, or no gain exists for all sensors.
        """
        self._bandwidth_1_s = bandwidth(plant, settings)
        super().__init__(plant, settings)

    def gain(self, step: StepMatrices, present: BoolArray) -> FloatArray | Refusal:
        """Return the gain that places the poles; a slower one if errors would grow while a nut stands."""
        gain = gain_for(self._design_plant, step, present, self._settings, self._bandwidth_1_s)
        return gain.K if isinstance(gain, LuenbergerGain) else gain
