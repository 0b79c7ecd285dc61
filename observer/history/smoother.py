"""The fixed-interval smoother: every heat from all measurements of a log, before and after it; compiled."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from observer.estimators.compiled import packing
from observer.estimators.compiled.packing import IntArray, Running
from observer.estimators.compiled.steps import StepCache, StepTable, chunks
from observer.frames import FloatArray, Inputs
from observer.history.history import HeatHistory
from observer.history.smoother_kernel import Adjoint, Smoothed, Tape, run_backward, run_forward
from observer.model.plant import Plant
from observer.tables.estimator import EstimatorSettings

# Long enough that the filter's states kept between segments do not count, short enough for the cache.
_STEPS_IN_SEGMENT = 1024
_Segment = tuple[Inputs, IntArray, StepTable]


def smooth_heats(plant: Plant, settings: EstimatorSettings, blocks: Sequence[Inputs]) -> HeatHistory:
    """Return the heats given all measurements of consecutive blocks, with their standard deviations.

    The Kalman filter runs forward; the adjoint r and its covariance N run back,
    r⁻ = (I - K C)ᵀ r + Cᵀ S⁻¹ ν, x_s = x̂ + P r, P_s = P - P N P. Nothing is inverted but the innovations'
    variances: the predicted covariance, which the smoother of Rauch, Tung and Striebel inverts, is singular
    to rounding here, where fast modes follow the heats. The filter's state is kept at the start of each
    segment only, and the segment is run once more when the way back comes to it.

    Sensors that the gate refused on the way forward are left out on the way back too. Sources: Bierman
    (1973), de Jong (1989); Durbin and Koopman (2012), section 6.4, for one sensor at a time.
    """
    plant = plant.sensors_only()
    passes = _Passes(plant, settings)
    for block in blocks:
        passes.forward(block)
    parts = [passes.backward(block) for block in reversed(blocks)][::-1]
    heat, sigma, residual = (np.concatenate(column) for column in zip(*parts, strict=True))
    return HeatHistory(np.concatenate([block.time_s for block in blocks]), heat, sigma, residual)


class _Passes:
    """The way forward over all blocks, and the way back over them in the opposite order."""

    def __init__(self, plant: Plant, settings: EstimatorSettings) -> None:
        self._arrays = packing.pack_plant(plant)
        self._steps = StepCache(plant)
        self._work = packing.scratch(self._arrays)
        self._gate_sigma = float(settings.gate_sigma)
        self._state = packing.thaw(packing.initial_state(plant))
        self._kept: list[Running] = []
        n, width = self._state.P.shape
        s, m_e = len(self._arrays.R_K2), len(self._arrays.source)
        self._adjoint = Adjoint(np.zeros(width), np.zeros((n, width)), np.zeros(width))
        K = _STEPS_IN_SEGMENT
        self._tape = Tape(
            kind=np.zeros(K, dtype=np.int8),
            gain=np.zeros((K, s, width)),
            weight=np.zeros((K, s)),
            innovation=np.zeros((K, s)),
            heat=np.zeros((K, m_e)),
            cross=np.zeros((K, m_e, width)),
            coupled=np.zeros((K, 2, n - m_e)),
        )
        self._tape_is_of_last = False

    def forward(self, block: Inputs) -> None:
        """Filter a block, keeping the state at the start of each of its segments."""
        for segment in self._segments(block):
            self._kept.append(_copy(self._state))
            self._filter(segment, self._state)
            self._tape_is_of_last = True

    def backward(self, block: Inputs) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Smooth a block: heats and σ (K, m_e), residuals (K, s)."""
        parts = []
        for segment in reversed(list(self._segments(block))):
            state = self._kept.pop()
            if not self._tape_is_of_last:
                self._filter(segment, state)
            self._tape_is_of_last = False
            parts.append(self._smooth(segment))
        heat, sigma, residual = (np.concatenate(column) for column in zip(*parts[::-1], strict=True))
        return heat, sigma, residual

    def _segments(self, block: Inputs) -> Iterator[_Segment]:
        seen = block.sensors_only(len(self._arrays.R_K2))
        for _, _, table, u, step in chunks(self._steps, seen):
            for begin in range(0, len(step), _STEPS_IN_SEGMENT):
                end = begin + _STEPS_IN_SEGMENT
                yield u.part(begin, end), step[begin:end], table

    def _filter(self, segment: _Segment, state: Running) -> None:
        u, step, table = segment
        run_forward(self._arrays, table, u, step, state, self._gate_sigma, self._work, self._tape)

    def _smooth(self, segment: _Segment) -> Smoothed:
        u, step, table = segment
        K, s, m_e = len(step), len(self._arrays.R_K2), len(self._arrays.source)
        out = Smoothed(np.full((K, m_e), np.nan), np.full((K, m_e), np.nan), np.full((K, s), np.nan))
        run_backward(self._arrays, table, u, step, self._tape, self._adjoint, self._work, out)
        return out


def _copy(state: Running) -> Running:
    return Running._make(array.copy() for array in state)
