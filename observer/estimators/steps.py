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
    """Step matrices of D different step lengths, stacked and padded.

    `decay` (D, width) is that of the plant's states, the heats and what is learnt, `noise` (D, n, width) all
    of the noise but what the walks of moving heats leave in the plant's states.
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
    """Remembers step matrices by length; they are a pure function of it, so remembering changes no bit."""

    def __init__(self, plant: Plant) -> None:
        self._plant = plant
        self._moving = [s.index for s in plant.moving]
        self._still = np.array(
            [int(j) not in self._moving for j in np.flatnonzero(plant.estimated)], dtype=np.bool_
        )
        self._known: dict[float, tuple[StepMatrices, FloatArray]] = {}
        self._last: tuple[list[float], Any] | None = None

    def beside(self) -> StepCache:
        """Return one that remembers the same steps, and a last table of its own."""
        own = StepCache(self._plant)
        own._known = self._known
        return own

    def matrices(self, dt_s: float) -> StepMatrices:
        """Return the step of that length, worked out."""
        return step_matrices(self._plant, dt_s)

    def get(self, dt_s: float) -> tuple[StepMatrices, FloatArray]:
        """Return the step of that length and the noise of what does not move."""
        if dt_s not in self._known:
            if len(self._known) >= _STEPS_REMEMBERED:
                self._known.clear()
            step = self.matrices(dt_s)
            self._known[dt_s] = (step, _noise(self._plant, step, self._still))
        return self._known[dt_s]

    def table(self, lengths_s: list[float]) -> Any:
        """Stack the steps of these lengths, a `StepTable` for kernels.

        The live service asks for the same again and again.
        """
        if self._last is None or self._last[0] != lengths_s:
            self._last = (lengths_s, record(self._stacked(lengths_s)))
        return self._last[1]

    def single(self, inputs: Inputs, length_s: float) -> Chunk:
        """Return a single step, packed, as a chunk: there is nothing to number."""
        lengths_s = [length_s]
        return Chunk(_ALL, lengths_s, self.table(lengths_s), inputs, _FIRST)

    def _stacked(self, lengths_s: list[float]) -> StepTable:
        found = [self.get(dt_s) for dt_s in lengths_s]

        def stack(name: str) -> FloatArray:
            return np.stack([getattr(step, name) for step, _ in found])

        width = padded_width(states_of(self._plant))
        fade = np.array([_fade(self._plant, dt_s) for dt_s in lengths_s])
        walk_xx = stack("walk_xx")
        return StepTable(
            pad_rows(np.hstack([stack("decay"), stack("heat_decay"), fade]), width),
            stack("hold"),
            stack("ramp"),
            stack("heat_decay"),
            stack("couple"),
            pad_rows(np.stack([noise for _, noise in found]), width),
            0.5 * (walk_xx + walk_xx.swapaxes(2, 3)),
            stack("walk_dx"),
        )


def _noise(plant: Plant, step: StepMatrices, still: BoolArray) -> FloatArray:
    """Covariance (n, n) that a step adds to states, heats and what is learnt, but through the heats that
    move, symmetric to the last bit.
    """
    cross = np.where(still[:, None], plant.B[:, plant.estimated].T * step.walk_dx, 0.0)
    Q = np.block([[fixed_noise(plant, step, still), cross.T], [cross, np.diag(step.walk_dd)]])
    if plant.learning is not None:
        wandered = plant.learning.arrays.sigma**2 * (1.0 - _fade(plant, step.dt_s) ** 2)
        known = len(Q)
        Q = np.pad(Q, (0, len(wandered)))
        Q[known:, known:] = np.diag(wandered)
    return np.asarray(0.5 * (Q + Q.T))


def _fade(plant: Plant, dt_s: float) -> FloatArray:
    """What a step leaves of each state that is learnt, (L,)."""
    wander_s = np.inf if plant.learning is None else plant.learning.wander_s
    return np.full(plant.learnt, np.exp(-dt_s / wander_s))


class Chunk(NamedTuple):
    """Steps that share a table of few step lengths: which of the block, their lengths, and their inputs."""

    part: slice
    lengths_s: list[float]
    table: Any
    inputs: Inputs
    step: IntArray


def chunks(cache: StepCache, inputs: Inputs) -> Iterator[Chunk]:
    """Cut a block into chunks; `step` (K,) is where each step's length is in its table."""
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
