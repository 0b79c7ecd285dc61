"""The compiled walk over rows of readings and ticks: the memory of each channel, and the frames.

A value counts where it carries no fault, is a number, lies within its limits and comes from a channel that is
not stuck. All that it needs of the past is in `Memory`, so a walk in parts gives the same bits.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from observer.frames import BoolArray, FloatArray, FrameBlock, NutPath, Quality, QualityArray
from observer.kernels import put_reading, record, tick_on, walk_rows
from observer.kernels.layout import Bundle, Fields, Records, packed, state_type

IntArray = NDArray[np.int64]


class Rows(NamedTuple):
    """n rows in order of time: the channels that each reading has, and which rows are ticks.

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
    """What the walk remembers of the rows so far; arrays, updated in place.

    (c,): last usable value, when that was true, usual gap between values, newest quality, whether one arrived
    since the last tick, whether stuck, the last breach of a limit and by what value; `noise` (c,) as in
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
    noise: Records
    passed: FloatArray
    last_tick_s: FloatArray

    def copy(self) -> Memory:
        """A copy of it."""
        return Memory._make(array.copy() for array in self)


def nothing_yet(plan: Expected, last_tick_s: float = math.nan) -> Memory:
    """The memory before the first row; `last_tick_s` is the last tick before a warm start."""
    c = len(plan.noise_K)
    noise = np.zeros(c, state_type("ChannelNoise"))
    noise["last"] = np.nan

    def unknown() -> FloatArray:
        return np.full(c, np.nan)

    return Memory(
        value=unknown(),
        seen_s=unknown(),
        gap_s=unknown(),
        # an occasional channel is not missing before its first value
        newest=np.where(np.isinf(plan.expected_s), Quality.GOOD, Quality.MISSING).astype(np.int8),
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

    `expected_s`, `heartbeat_s`, `noise_K` (c,) and `period_s` are those of `AlignPlan`, the next of `Limits`;
    `position`, `speed` (P,) the columns of a path and of what drives it, times `lead_m` (P,).
    """

    expected_s: FloatArray
    heartbeat_s: FloatArray
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
    `samples` (P, 4, n), of which tick k has those from `offset` (P, K+1) [k] to [k + 1]; scratch `end` (P,),
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
        np.zeros(ticks), np.zeros(ticks), np.zeros((ticks, c)), np.zeros((ticks, c), np.bool_),
        np.zeros((ticks, c), np.int8), np.zeros((ticks, c)), np.zeros((paths, 4, rows)),
        np.zeros((paths, ticks + 1), np.int64), np.zeros(paths, np.int64), np.zeros(c, np.bool_),
    )  # fmt: skip


class OfFrame(Fields):
    """How a frame of one tick lies in memory, and of which channels and paths it is."""

    def __init__(self, dtype: np.dtype[Any], channels: tuple[str, ...], paths: tuple[str, ...]) -> None:
        """Take what all frames of a walk are of."""
        super().__init__(dtype)
        self.channels, self.paths = channels, paths

    def column(self, data: bytes, name: str) -> Any:
        """Return a column of `FrameBlock`."""
        if name == "channels":
            return self.channels
        if name != "path":
            return super().column(data, name)
        return _paths(self.paths, *self.columns(data, ("samples", "offset")))


def _paths(names: tuple[str, ...], samples: FloatArray, offset: IntArray) -> dict[str, NutPath]:
    path = {}
    for p, name in enumerate(names):
        at_s, at_m, driven_m_s, speed_age_s = samples[p, :, : offset[p, -1]]
        path[name] = NutPath(at_s, at_m, offset[p], driven_m_s, speed_age_s)
    return path


class LiveWalk(NamedTuple):
    """What the kernel takes at a reading and at a tick: `waiting` counts rows; `octets` are the frame's."""

    names: tuple[str, ...]
    rows: Rows
    waiting: int
    plan: Expected
    memory: Memory
    frames: Frames
    octets: NDArray[np.uint8]


class Walk:
    """A walk over rows, in parts; what it remembers is updated."""

    def __init__(
        self,
        channels: tuple[str, ...],
        plan: Expected,
        last_tick_s: float = math.nan,
        memory: Memory | None = None,
    ) -> None:
        """Begin before the first row, or continue from the `memory` of another walk; `last_tick_s` is the
        last tick before a warm start.
        """
        self._plan = plan = packed(plan)
        self._channels, self._paths = channels, tuple(channels[column] for column in plan.position)
        self.memory = nothing_yet(plan, last_tick_s) if memory is None else memory.copy()
        self._plan_record, self._memory_record = record(plan), record(self.memory)
        self._have_room(16)

    def _have_room(self, most: int) -> None:
        """Allocate room for so many rows waiting for a tick."""
        c = len(self._channels)
        self._rows = Rows(
            np.empty(most), np.empty(most), np.zeros(most, np.bool_), np.empty((most, c)),
            np.zeros((most, c), np.bool_), np.empty((most, c), np.bool_),
        )  # fmt: skip
        frames = _empty_frames(1, c, len(self._paths), most)
        scratch: dict[str, Any] = {"end": frames.end, "counts": frames.counts}
        names = [name for name in Frames._fields if name not in scratch]
        bundle = Bundle.of({name: getattr(frames, name) for name in names})
        own: dict[str, Any] = {name: bundle[name] for name in names}
        self._of = OfFrame(bundle.fields.dtype, self._channels, self._paths)
        self._live = record(
            LiveWalk(
                self._channels,
                self._rows,
                0,
                self._plan,
                self.memory,
                Frames(**own, **scratch),
                bundle.octets,
            )
        )

    def _widen(self) -> None:
        """Double the room for rows."""
        before, count = self._rows, self._live.waiting
        self._have_room(2 * count)
        for own, given in zip(self._rows, before, strict=True):
            own[:count] = given
        self._live.waiting = count

    def on(self, rows: Rows) -> FrameBlock:
        """Continue over these rows; return the frames at the ticks among them."""
        ticks, n = int(np.count_nonzero(rows.step)), len(rows.time_s)
        frames = _empty_frames(ticks, len(self._channels), len(self._paths), n)
        walk_rows(record(packed(rows)), n, self._plan_record, self._memory_record, record(frames))
        path = _paths(self._paths, frames.samples, frames.offset)
        return FrameBlock(self._channels, *frames[:6], path)

    def take(
        self, time_s: float, late_s: float, values: Mapping[str, float], faulted: Collection[str]
    ) -> bool:
        """Queue a reading for the next tick; return whether all its values are floats of known channels."""
        taken: int = put_reading(self._live, time_s, late_s, values)
        if taken < 0:
            self._widen()
            return self.take(time_s, late_s, values, faulted)
        for name in faulted:
            self._rows.faulted[self._live.waiting - 1, self._channels.index(name)] = True
        return taken == len(values)

    def tick(self, time_s: float) -> FrameBlock:
        """Continue over the waiting rows and a tick after them; return its frame."""
        data = tick_on(self._live, time_s)
        if data is None:
            self._widen()
            return self.tick(time_s)
        return FrameBlock.of(self._of, data)
