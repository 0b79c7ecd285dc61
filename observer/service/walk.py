"""The walk over rows of readings and ticks, compiled: what is remembered of each channel, and the frames.

A value counts where it carries no fault, is a number, lies within its limits and comes from a channel that is
not stuck. Everything it needs of the past stands in `Memory`, so a walk over parts gives the same bits.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from observer.frames import BoolArray, FloatArray, FrameBlock, NutPath, Quality, QualityArray
from observer.kernels import record, walk_on
from observer.kernels.layout import packed
from observer.kernels.stuck import _LAST, _SEEN

IntArray = NDArray[np.int64]


class Rows(NamedTuple):
    """n rows in the order of time: what each reading said of which channel, and which rows are ticks.

    `time_s`, `late_s`, `step` (n,): a reading was true `late_s` before its row; `values`, `present`,
    `faulted` (n, c).
    """

    time_s: FloatArray
    late_s: FloatArray
    step: BoolArray
    values: FloatArray
    present: BoolArray
    faulted: BoolArray

    def part(self, start: int, end: int) -> Rows:
        """The rows from `start` up to `end`."""
        return Rows._make(array[start:end] for array in self)


class Memory(NamedTuple):
    """Where the walk over the rows stands; arrays, updated in place.

    (c,): last usable value, when that was true, usual gap between values, newest quality, whether one arrived
    since the last tick, whether stuck, the last breach of a limit and by what value; `noise` (c, 7) as in
    `stuck`; `passed` (P, 2) time and position of each path's last sample; `last_tick_s` (1,).
    """

    value: FloatArray
    seen_s: FloatArray
    gap_s: FloatArray
    newest: QualityArray
    arrived: BoolArray
    stuck: BoolArray
    breach: QualityArray
    refused: FloatArray
    noise: FloatArray
    passed: FloatArray
    last_tick_s: FloatArray


def nothing_yet(plan: Expected, last_tick_s: float = math.nan) -> Memory:
    """The memory before the first row; `last_tick_s` is the last tick before a warm start."""
    c = len(plan.noise_K)
    noise = np.zeros((c, _SEEN + 1))
    noise[:, _LAST] = np.nan

    def unknown() -> FloatArray:
        return np.full(c, np.nan)

    return Memory(
        value=unknown(),
        seen_s=unknown(),
        gap_s=unknown(),
        newest=np.full(c, Quality.MISSING, np.int8),
        arrived=np.zeros(c, np.bool_),
        stuck=np.zeros(c, np.bool_),
        breach=np.zeros(c, np.int8),
        refused=unknown(),
        noise=noise,
        passed=np.full((len(plan.position), 2), np.nan),
        last_tick_s=np.array([last_tick_s]),
    )


class Expected(NamedTuple):
    """What is expected of c channels and P paths, as the compiled walk takes it.

    `expected_s`, `noise_K` (c,) and `period_s` are those of `AlignPlan`, the next those of `Limits`;
    `position`, `speed` (P,) the columns of a path and of what drives it, times `lead_m` (P,).
    """

    expected_s: FloatArray
    noise_K: FloatArray
    period_s: float
    low: FloatArray
    high: FloatArray
    rate_per_s: FloatArray
    above_K: FloatArray
    below_K: FloatArray
    slack: FloatArray
    ambient: int
    ambient_degC: float
    position: IntArray
    speed: IntArray
    lead_m: FloatArray


class Frames(NamedTuple):
    """The frames of K ticks as the kernel fills them, (K,) and (K, c) as in `FrameBlock`; of P paths the
    `samples` (P, 3, n), of which tick k has those from `offset` (P, K+1) [k] to [k + 1]; scratch `end` (P,),
    `counts` (c,).
    """

    time_s: FloatArray
    dt_s: FloatArray
    values: FloatArray
    fresh: BoolArray
    quality: QualityArray
    age_s: FloatArray
    samples: FloatArray
    offset: IntArray
    end: IntArray
    counts: BoolArray


def _empty_frames(ticks: int, c: int, paths: int, rows: int) -> Frames:
    return Frames(
        np.empty(ticks), np.empty(ticks), np.empty((ticks, c)), np.empty((ticks, c), np.bool_),
        np.empty((ticks, c), np.int8), np.empty((ticks, c)), np.empty((paths, 3, rows)),
        np.zeros((paths, ticks + 1), np.int64), np.zeros(paths, np.int64), np.zeros(c, np.bool_),
    )  # fmt: skip


class Waiting:
    """Rows as they come, up to a tick, and the frame that they make: arrays that are used again."""

    def __init__(self, c: int, paths: int, most: int = 16) -> None:
        """Have room for as many rows at first."""
        self._sizes, self.count = (c, paths), 0
        self.rows = Rows(
            np.empty(most), np.empty(most), np.zeros(most, np.bool_), np.empty((most, c)),
            np.zeros((most, c), np.bool_), np.empty((most, c), np.bool_),
        )  # fmt: skip
        self.frames = _empty_frames(1, c, paths, most)
        self.rows_record, self.frames_record = record(self.rows), record(self.frames)

    def add(self, time_s: float, late_s: float = 0.0) -> int:
        """Begin a row; returns its number."""
        row = self.count
        if row == len(self.rows.time_s):
            before = self.rows
            self.__init__(*self._sizes, 2 * row)  # type: ignore[misc]
            for own, given in zip(self.rows, before, strict=True):
                own[:row] = given
        self.rows.time_s[row], self.rows.late_s[row] = time_s, late_s
        self.count = row + 1
        return row

    def clear(self) -> None:
        """Have no rows; of what is not present nothing is read."""
        self.rows.step[self.count - 1] = False
        self.rows.present[: self.count] = False
        self.count = 0


class Walk:
    """A walk over rows, in parts; what it remembers is updated."""

    def __init__(self, channels: tuple[str, ...], plan: Expected, last_tick_s: float = math.nan) -> None:
        """Begin before the first row; `last_tick_s` is the last tick before a warm start."""
        plan = packed(plan)
        self._channels, self._paths = channels, [channels[column] for column in plan.position]
        self.memory = nothing_yet(plan, last_tick_s)
        self._plan_record, self._memory_record = record(plan), record(self.memory)
        self.waiting = Waiting(len(channels), len(self._paths))

    def on(self, rows: Rows) -> FrameBlock:
        """Go on over these rows; return the frames at the ticks among them."""
        ticks, n = int(np.count_nonzero(rows.step)), len(rows.time_s)
        frames = _empty_frames(ticks, len(self._channels), len(self._paths), n)
        walk_on(record(packed(rows)), n, self._plan_record, self._memory_record, record(frames))
        return self._block(frames[:6], frames.samples, frames.offset)

    def tick(self) -> FrameBlock:
        """Go on over the rows that wait, the last of which is a tick; return its frame."""
        waiting = self.waiting
        walk_on(
            waiting.rows_record, waiting.count, self._plan_record, self._memory_record, waiting.frames_record
        )
        waiting.clear()
        own = waiting.frames
        columns = [array.copy() for array in own[:6]]
        return self._block(columns, own.samples, own.offset.copy())

    def _block(self, columns: Sequence[Any], samples: FloatArray, offset: IntArray) -> FrameBlock:
        path = {}
        for p, name in enumerate(self._paths):
            at_s, at_m, driven_m_s = samples[p, :, : offset[p, -1]].copy()
            path[name] = NutPath(at_s, at_m, offset[p], driven_m_s)
        time_s, dt_s, values, fresh, quality, age_s = columns
        return FrameBlock(self._channels, time_s, dt_s, values, fresh, quality, age_s, path)
