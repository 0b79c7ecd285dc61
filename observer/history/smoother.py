"""The fixed-interval smoother: every heat from all measurements of a log, before and after it; compiled."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from observer.config.estimator import EstimatorSettings
from observer.estimators import packing
from observer.estimators.packing import IntArray
from observer.estimators.steps import StepCache, chunks
from observer.frames import FloatArray, Inputs
from observer.history.history import HeatHistory
from observer.kernels import record, run_backward, run_changes_backward, run_changes_forward, run_forward
from observer.kernels.layout import padded_width
from observer.model.plant import Plant


class Tape(NamedTuple):
    """The data of K filter steps that the backward pass needs.

    Attributes:
        kind: Kind of each step, (K,).
        gain: Gain of each sensor, in the order of the corrections, (K, s, width).
        weight: 1/S of each correction, (K, s), 0 without one.
        innovation: Innovation given the sensors before it, K, (K, s).
        heat: Heats after the corrections, W, (K, m_e).
        cross: Rows of P of the heats, (K, m_e, width).
        coupled: State before each half of a coupled step, (K, 2, n_x).
    """

    kind: NDArray[np.int8]
    gain: FloatArray
    weight: FloatArray
    innovation: FloatArray
    heat: FloatArray
    cross: FloatArray
    coupled: FloatArray


class Adjoint(NamedTuple):
    """The information of later measurements on the state, changed in place.

    Attributes:
        r: Adjoint of the state, (width,).
        N: Its covariance, (n, width).
        NK: Scratch, (width,).
    """

    r: FloatArray
    N: FloatArray
    NK: FloatArray


class Smoothed(NamedTuple):
    """The output of the backward pass, NaN where a step or a reading was not used.

    Attributes:
        heat: Heats, W, (K, m_e).
        sigma: Their σ, W, (K, m_e).
        residual: Measured minus smoothed readings, K, (K, s).
        free: 1 minus the influence of each reading on its own smoothed value, (K, s).
        jump: Jump of each heat from its law at the start of a step, W, (K, m_e).
        jump_sigma: Its σ, W, (K, m_e).
    """

    heat: FloatArray
    sigma: FloatArray
    residual: FloatArray
    free: FloatArray
    jump: FloatArray
    jump_sigma: FloatArray


# Long enough that the stored filter states need little memory, short enough for the cache.
_STEPS_IN_SEGMENT = 1024
_REGISTER = 4


def smooth_heats(plant: Plant, settings: EstimatorSettings, blocks: Sequence[Inputs]) -> HeatHistory:
    """Return the heats given all measurements of consecutive blocks, with their standard deviations.

    The Kalman filter runs forward; the adjoint r and its covariance N run back:

        r⁻ = (I - K C)ᵀ r + Cᵀ S⁻¹ ν,   x_s = x̂ + P r,   P_s = P - P N P.

    Only the innovations' variances are inverted. The Rauch-Tung-Striebel smoother inverts the predicted
    covariance, which is singular to rounding here, where fast modes follow the heats. The filter's state is
    stored at the start of each segment only, and the segment is filtered again when the backward pass reaches
    it.

    Sensors rejected by the gate in the forward pass are left out of the backward pass too. Sources: Bierman
    (1973), de Jong (1989); Durbin and Koopman (2012), section 6.4, for one sensor at a time.

    Args:
        plant: The model. Uncertain parameters are not part of the state here.
        settings: The table `[estimator]`, of which the gate is read.
        blocks: Consecutive blocks of inputs, K steps in total.
    """
    smoothed = smooth_all(plant, settings, blocks, StepCache(plant))
    time_s = np.concatenate([block.time_s for block in blocks])
    return HeatHistory(time_s, smoothed.heat, smoothed.sigma, smoothed.residual)


def smooth_all(
    plant: Plant, settings: EstimatorSettings, blocks: Sequence[Inputs], steps: StepCache
) -> Smoothed:
    """Return the whole output of the smoother for consecutive blocks.

    Memory for the tape is constant; the filter's state is stored once per 1024 steps.

    Args:
        plant: The model.
        settings: The table `[estimator]`, of which the gate is read.
        blocks: Consecutive blocks of inputs, K steps in total.
        steps: Step matrices, which contain the prior of the heats.
    """
    return Smoothed(*_Passes(plant.sensors_only(), settings, steps).run(blocks))


def smooth_changes(
    plant: Plant, settings: EstimatorSettings, blocks: Sequence[Inputs], changes_K: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the smoother's response to changes of the sensor readings in addition to the log.

    Readings rejected by the gate carry no information. Gains and covariances are those of the log, so one
    pass serves all changes.

    Args:
        plant: The model.
        settings: The table `[estimator]`, of which the gate is read.
        blocks: Consecutive blocks of inputs, K steps in total.
        changes_K: Changes D of the readings, K, (K, s, c).

    Returns:
        Dᵀ Σ⁻¹ [y − ŷ | D], (c, 1 + c), with the covariance Σ of all readings. Changes of the heats, W, (K,
        m_e, c).
    """
    passes = _ChangedPasses(plant.sensors_only(), settings, changes_K)
    [heat] = passes.run(blocks)
    return passes.information, heat


class Changed(NamedTuple):
    """Changes as `kernels.changes` computes them, column 0 being the log itself.

    Attributes:
        moved: Changes of readings, K, (K, s, padded columns).
        heat: Changes of heats, W, (K, m_e, padded columns).
    """

    moved: FloatArray
    heat: FloatArray


class _Segment(NamedTuple):
    """Some of a log's steps: their rows, inputs, and the index of each one's length in the table."""

    rows: slice
    u: Inputs
    step: IntArray
    table: Any


class _Passes:
    """The forward pass over all blocks, and the backward pass over them in reverse order."""

    def __init__(self, plant: Plant, settings: EstimatorSettings, steps: StepCache) -> None:
        self._arrays = packing.pack_plant(plant)
        self._steps = steps
        self._plant_record, self._work = record(self._arrays), record(packing.scratch(self._arrays))
        self._gate_sigma = float(settings.gate_sigma)
        self._state = packing.thaw(packing.initial_state(plant))
        n, width = self._state.P.shape
        s, m_e = len(self._arrays.R_K2), len(self._arrays.source)
        self._adjoint = record(Adjoint(np.zeros(width), np.zeros((n, width)), np.zeros(width)))
        K = _STEPS_IN_SEGMENT
        self._tape = record(
            Tape(
                kind=np.zeros(K, dtype=np.int8),
                gain=np.zeros((K, s, width)),
                weight=np.zeros((K, s)),
                innovation=np.zeros((K, s)),
                heat=np.zeros((K, m_e)),
                cross=np.zeros((K, m_e, width)),
                coupled=np.zeros((K, 2, n - m_e)),
            )
        )

    def run(self, blocks: Sequence[Inputs]) -> list[FloatArray]:
        """Run the forward pass, storing the state at the start of each segment, and the backward pass.

        Return the results of the K rows.
        """
        states, parts = [], list[tuple[FloatArray, ...]]()
        block_starts = np.cumsum([0, *map(len, blocks)]).tolist()
        for block, begin in zip(blocks, block_starts, strict=False):
            for segment in self._segments(block, begin):
                states.append(self._remembered())
                self._filter(segment)
        for block, begin in zip(reversed(blocks), block_starts[-2::-1], strict=True):
            for segment in reversed(list(self._segments(block, begin))):
                state = states.pop()
                if parts:  # the tape still holds the last segment
                    self._recall(state)
                    self._filter(segment)
                parts.append(self._smooth(segment))
        return [np.concatenate(column) for column in zip(*parts[::-1], strict=True)]

    def _segments(self, block: Inputs, row: int) -> Iterator[_Segment]:
        readings = block.sensors_only(len(self._arrays.R_K2))
        for part, _, table, u, step in chunks(self._steps, readings):
            for begin in range(0, len(step), _STEPS_IN_SEGMENT):
                inputs = u.part(begin, begin + _STEPS_IN_SEGMENT)
                first = row + part.start + begin
                rows = slice(first, first + len(inputs))
                yield _Segment(rows, inputs, step[begin : begin + _STEPS_IN_SEGMENT], table)

    def _remembered(self) -> tuple[FloatArray | IntArray, ...]:
        return tuple(array.copy() for array in self._state)

    def _recall(self, state: tuple[FloatArray | IntArray, ...]) -> None:
        for array, saved in zip(self._state, state, strict=True):
            array[...] = saved

    def _filter(self, segment: _Segment) -> None:
        run_forward(self._batch(segment), record(self._state), self._work, self._tape)

    def _batch(self, segment: _Segment) -> Any:
        return record(
            packing.Batch(self._plant_record, segment.table, segment.u, segment.step, self._gate_sigma)
        )

    def _smooth(self, segment: _Segment) -> tuple[FloatArray, ...]:
        """Return the results of a segment's rows, as `Smoothed`."""
        K, s, m_e = len(segment.step), len(self._arrays.R_K2), len(self._arrays.source)
        smoothed = Smoothed(*(np.full((K, width), np.nan) for width in (m_e, m_e, s, s, m_e, m_e)))
        run_backward(self._batch(segment), self._tape, self._adjoint, self._work, record(smoothed))
        return smoothed


class _ChangedPasses(_Passes):
    """The same passes with changes of the readings in addition to the log, which is column 0."""

    def __init__(self, plant: Plant, settings: EstimatorSettings, changes_K: FloatArray) -> None:
        super().__init__(plant, settings, StepCache(plant))
        (_, s, count), K = changes_K.shape, _STEPS_IN_SEGMENT
        self._changes_K, self._own = changes_K, slice(1, 1 + count)
        columns = padded_width(1 + count, _REGISTER)
        self._X, self._adjoints = np.zeros((2, len(self._state.x), columns))
        self._moved, self._heat = np.zeros((K, s, columns)), np.zeros((K, len(self._arrays.source), columns))
        self._changed = record(Changed(self._moved, self._heat))
        self._information = np.zeros((count, columns))

    @property
    def information(self) -> FloatArray:
        """Dᵀ Σ⁻¹ [y − ŷ | D] (c, 1 + c), after the backward pass."""
        return self._information[:, : self._own.stop]

    def _remembered(self) -> tuple[FloatArray | IntArray, ...]:
        return *super()._remembered(), self._X.copy()

    def _recall(self, state: tuple[FloatArray | IntArray, ...]) -> None:
        super()._recall(state[:-1])
        self._X[...] = state[-1]

    def _filter(self, segment: _Segment) -> None:
        super()._filter(segment)
        D = self._changes_K[segment.rows]
        self._moved[:] = 0.0
        self._moved[: len(D), :, self._own] = D
        self._heat[:] = np.nan
        run_changes_forward(self._batch(segment), self._tape, self._work, self._X, self._changed)

    def _smooth(self, segment: _Segment) -> tuple[FloatArray, ...]:
        """Return the changes of the heats (K, m_e, c)."""
        D = self._changes_K[segment.rows]
        run_changes_backward(
            self._batch(segment), self._tape, self._work, self._adjoints, self._changed, D, self._information
        )
        return (self._heat[: len(D), :, self._own].copy(),)
