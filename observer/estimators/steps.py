"""Step matrices by length, and the cutting of a block into stretches that share a table of them."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np

from observer.estimators.packing import IntArray, padded_width, states_of
from observer.frames import BoolArray, FloatArray, Inputs
from observer.kernels import number_steps, record
from observer.kernels.layout import pad_rows
from observer.model.discretise import StepMatrices, fixed_noise, quantise, step_matrices
from observer.model.plant import Plant

_STEPS_IN_TABLE = 64
_STEPS_REMEMBERED = 512
_ALL, _FIRST = slice(0, 1), np.zeros(1, dtype=np.int64)


class StepTable(NamedTuple):
    """Step matrices of D different lengths, stacked, rows padded; other names as in `StepMatrices`.

    Attributes:
        decay: Decay factors of the plant's states, the heats and the parameters, (D, width).
        noise: Covariance of the process noise, (D, n, width). It excludes the effect of moving heats' walks
            on the plant's states, which depends on the nut's place.
    """

    decay: FloatArray
    hold: FloatArray
    ramp: FloatArray
    heat_decay: FloatArray
    couple: FloatArray
    noise: FloatArray
    walk_xx: FloatArray
    walk_dx: FloatArray


class StepCache:
    """Cache of step matrices by length, at most 512 lengths; the matrices depend on plant and length only."""

    def __init__(self, plant: Plant) -> None:
        self._plant = plant
        self._moving = [s.index for s in plant.moving]
        self._still = np.array(
            [int(j) not in self._moving for j in np.flatnonzero(plant.estimated)], dtype=np.bool_
        )
        self._steps_by_length: dict[float, tuple[StepMatrices, FloatArray]] = {}
        self._last: tuple[list[float], Any] | None = None

    def with_own_table(self) -> StepCache:
        """Return a cache that shares the steps but has its own last table.

        Two users with different lengths, such as estimate and bank, then do not replace each other's table.
        """
        cache = StepCache(self._plant)
        cache._steps_by_length = self._steps_by_length
        return cache

    def matrices(self, dt_s: float) -> StepMatrices:
        """Compute the step of this length, s, without the cache.

        Raises:
            ValueError: If the length is negative or not finite.
        """
        return step_matrices(self._plant, dt_s)

    def get(self, dt_s: float) -> tuple[StepMatrices, FloatArray]:
        """Return the step of this length, s, and its noise (n, n) without moving heats."""
        if dt_s not in self._steps_by_length:
            if len(self._steps_by_length) >= _STEPS_REMEMBERED:
                self._steps_by_length.clear()
            step = self.matrices(dt_s)
            self._steps_by_length[dt_s] = (step, _noise(self._plant, step, self._still))
        return self._steps_by_length[dt_s]

    def table(self, lengths_s: list[float]) -> Any:
        """Return the steps of these lengths, s, stacked as a record of `StepTable`.

        The last table is cached, because the live service repeats one length.
        """
        if self._last is None or self._last[0] != lengths_s:
            self._last = (lengths_s, record(self._stacked(lengths_s)))
        return self._last[1]

    def single(self, inputs: Inputs, length_s: float) -> Chunk:
        """Return one step, already packed for kernels, as a chunk."""
        lengths_s = [length_s]
        return Chunk(_ALL, lengths_s, self.table(lengths_s), inputs, _FIRST)

    def _stacked(self, lengths_s: list[float]) -> StepTable:
        steps = [self.get(dt_s) for dt_s in lengths_s]

        def stack(name: str) -> FloatArray:
            return np.stack([getattr(step, name) for step, _ in steps])

        width = padded_width(states_of(self._plant))
        fade = np.array([_fade(self._plant, dt_s) for dt_s in lengths_s])
        walk_xx = stack("walk_xx")
        return StepTable(
            pad_rows(np.hstack([stack("decay"), stack("heat_decay"), fade]), width),
            stack("hold"),
            stack("ramp"),
            stack("heat_decay"),
            stack("couple"),
            pad_rows(np.stack([noise for _, noise in steps]), width),
            0.5 * (walk_xx + walk_xx.swapaxes(2, 3)),
            stack("walk_dx"),
        )


def _noise(plant: Plant, step: StepMatrices, still: BoolArray) -> FloatArray:
    """Return the covariance (n, n) that a step adds to states, heats and parameters.

    It excludes the effect of moving heats and is symmetric to the last bit.
    """
    cross = np.where(still[:, None], plant.B[:, plant.estimated].T * step.walk_dx, 0.0)
    Q = np.block([[fixed_noise(plant, step, still), cross.T], [cross, np.diag(step.walk_dd)]])
    if plant.learning is not None:
        wandered = plant.learning.arrays.sigma**2 * (1.0 - _fade(plant, step.dt_s) ** 2)
        unlearnt = len(Q)
        Q = np.pad(Q, (0, len(wandered)))
        Q[unlearnt:, unlearnt:] = np.diag(wandered)
    return np.asarray(0.5 * (Q + Q.T))


def _fade(plant: Plant, dt_s: float) -> FloatArray:
    """Return the decay factor of each parameter over a step, (L,)."""
    wander_s = np.inf if plant.learning is None else plant.learning.wander_s
    return np.full(plant.learnt, np.exp(-dt_s / wander_s))


class Chunk(NamedTuple):
    """Steps that share a table of at most 64 step lengths.

    Attributes:
        part: Their place in the block.
        lengths_s: Lengths in the table, s.
        table: Record of `StepTable`.
        inputs: Their inputs, packed.
        step: Row of each step's length in the table, (K,).
    """

    part: slice
    lengths_s: list[float]
    table: Any
    inputs: Inputs
    step: IntArray


def chunks(cache: StepCache, inputs: Inputs) -> Iterator[Chunk]:
    """Yield the chunks of a block in order.

    Args:
        cache: Step matrices of the plant.
        inputs: The block. Lengths are rounded to microseconds, so that equal steps share a matrix.
    """
    inputs = inputs.packed()
    if len(inputs) == 1:
        yield cache.single(inputs, float(quantise(inputs.dt_s[0])))
        return
    start, step, lengths = 0, np.empty(len(inputs), dtype=np.int64), np.empty(_STEPS_IN_TABLE)
    while start < len(inputs):
        stop, count = number_steps(inputs.dt_s, start, step, lengths)
        lengths_s = lengths[:count].tolist()
        part = slice(start, stop)
        yield Chunk(part, lengths_s, cache.table(lengths_s), inputs.part(start, stop), step[part])
        start = stop
