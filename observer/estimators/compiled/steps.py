"""Step matrices by length, and the cutting of a block into stretches that share a table of them."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from observer.estimators.compiled.packing import InputArrays, pack_inputs, pad_rows, padded_width
from observer.frames import FloatArray, Inputs
from observer.model.discretise import StepMatrices, fixed_noise, quantise, step_matrices
from observer.model.plant import Plant

_STEPS_IN_TABLE = 64
_STEPS_IN_CHUNK = 16384
_STEPS_REMEMBERED = 512


class StepTable(NamedTuple):
    """Step matrices of D different step lengths, stacked; `noise_xx` is that of everything that does not
    move.
    """

    decay: FloatArray
    hold: FloatArray
    ramp: FloatArray
    heat_decay: FloatArray
    couple: FloatArray
    noise_xx: FloatArray
    walk_xx: FloatArray
    walk_dx: FloatArray
    walk_dd: FloatArray


class StepCache:
    """Remembers step matrices by length; they are a pure function of it, so remembering changes no bit."""

    def __init__(self, plant: Plant) -> None:
        self._plant = plant
        self._moving = [s.index for s in plant.moving]
        self._still = np.array(
            [int(j) not in self._moving for j in np.flatnonzero(plant.estimated)], dtype=np.bool_
        )
        self._known: dict[float, tuple[StepMatrices, FloatArray]] = {}
        self._last: tuple[list[float], StepTable] | None = None

    def get(self, dt_s: float) -> tuple[StepMatrices, FloatArray]:
        """Return the step of that length and the noise of what does not move."""
        if dt_s not in self._known:
            if len(self._known) >= _STEPS_REMEMBERED:
                self._known.clear()
            step = step_matrices(self._plant, dt_s)
            self._known[dt_s] = (step, fixed_noise(self._plant, step, self._still))
        return self._known[dt_s]

    def table(self, lengths_s: list[float]) -> StepTable:
        """Stack the steps of these lengths; the live service asks for the same again and again."""
        if self._last is None or self._last[0] != lengths_s:
            self._last = (lengths_s, self._stacked(lengths_s))
        return self._last[1]

    def _stacked(self, lengths_s: list[float]) -> StepTable:
        found = [self.get(dt_s) for dt_s in lengths_s]

        def stack(name: str) -> FloatArray:
            return np.stack([getattr(step, name) for step, _ in found])

        width = padded_width(len(self._plant.decay_1_s) + int(self._plant.estimated.sum()))
        return StepTable(
            pad_rows(stack("decay"), width),
            stack("hold"),
            stack("ramp"),
            stack("heat_decay"),
            stack("couple"),
            pad_rows(np.stack([noise for _, noise in found]), width),
            stack("walk_xx"),
            stack("walk_dx"),
            stack("walk_dd"),
        )


def chunks(cache: StepCache, inputs: Inputs) -> Iterator[tuple[slice, list[float], InputArrays, StepTable]]:
    """Cut a block into stretches that share a table of few step lengths."""
    dt_s = quantise(inputs.dt_s)
    if len(dt_s) == 1:  # the live service: nothing to sort
        whole = slice(0, 1)
        lengths_s = [float(dt_s[0])]
        yield (
            whole,
            lengths_s,
            pack_inputs(inputs, whole, np.zeros(1, dtype=np.int64)),
            cache.table(lengths_s),
        )
        return
    start = 0
    while start < len(dt_s):
        stop = _end_of_chunk(dt_s, start)
        lengths, step = np.unique(dt_s[start:stop], return_inverse=True)
        part = slice(start, stop)
        yield part, lengths.tolist(), pack_inputs(inputs, part, step), cache.table(lengths.tolist())
        start = stop


def _end_of_chunk(dt_s: FloatArray, start: int) -> int:
    """Where the stretch from `start` on that has few enough step lengths ends."""
    ahead = dt_s[start : start + _STEPS_IN_CHUNK]
    _, first = np.unique(ahead, return_index=True)
    if len(first) <= _STEPS_IN_TABLE:
        return start + len(ahead)
    return start + int(np.sort(first)[_STEPS_IN_TABLE])
