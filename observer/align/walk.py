"""The compiled walk over rows of readings and ticks: the memory of each channel, and the frames.

A value is used if it has no fault, is a number, is within its limits, and comes from a channel that is not
stuck. The walk needs nothing of the past but its `Memory`, so a walk in parts gives the same bits.
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
    """n rows in order of time: the channels of each reading, and which rows are ticks.

    Attributes:
        time_s: (n,)
        late_s: (n,) delay of a reading: its values date from `late_s` before `time_s`
        step: (n,) whether the row is a tick
        values, present, faulted: (n, c)
    """

    time_s: FloatArray
    late_s: FloatArray
    step: BoolArray
    values: FloatArray
    present: BoolArray
    faulted: BoolArray

    def part(self, start: int, end: int) -> Rows:
        """Return the rows from `start` up to `end`."""
        return Rows._make(array[start:end] for array in self)


class Memory(NamedTuple):
    """The state of c channels and P paths after the rows so far: arrays, updated in place.

    Attributes:
        value: (c,) last usable value
        seen_s: (c,) its time
        gap_s: (c,) usual interval between values
        newest: (c,) quality of the newest value
        arrived: (c,) whether a value has come since the last tick
        stuck: (c,) whether the sensor is stuck
        breach: (c,) last violated limit
        refused: (c,) the value that violated it
        noise: (c,) state of the test for a stuck sensor
        passed: (P, 2) time and position of each path's last sample
        last_tick_s: (1,)
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
        """Return a deep copy."""
        return Memory._make(array.copy() for array in self)


def nothing_yet(plan: Expected, last_tick_s: float = math.nan) -> Memory:
    """Return the memory before the first row.

    Args:
        plan: The plan for c channels and P paths.
        last_tick_s: The last tick before a warm start; NaN after a cold one.
    """
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
    """The plan for c channels and P paths in the form that the compiled walk takes.

    Attributes:
        expected_s … period_s: those of `AlignPlan`
        low … ambient_degC: those of `Limits`
        position: (P,) column of the nut's position
        speed: (P,) column of the speed that drives it, −1 for none
        lead_m: (P,)
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
    """The frames of K ticks as the kernel fills them: (K,) and (K, c) as in `FrameBlock`.

    Attributes:
        samples: (P, 4, n) of P paths; tick k has those from offset[:, k] to offset[:, k + 1]
        offset: (P, K+1)
        end, counts: (P,), (c,) scratch
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
    """The memory layout of a frame of one tick, with the names of its channels and paths."""

    def __init__(self, dtype: np.dtype[Any], channels: tuple[str, ...], paths: tuple[str, ...]) -> None:
        """Store the layout and the names that all frames of a walk share."""
        super().__init__(dtype)
        self.channels, self.paths = channels, paths

    def column(self, data: bytes, name: str) -> Any:
        """Return a column of `FrameBlock`, decoded from the bytes of a frame."""
        if name == "channels":
            return self.channels
        if name != "path":
            return super().column(data, name)
        return _paths(self.paths, *self.columns(data, ("samples", "offset")))


def _paths(names: tuple[str, ...], samples: FloatArray, offset: IntArray) -> dict[str, NutPath]:
    """Return the nuts' paths by channel from the kernel's samples (P, 4, n) and offsets (P, K+1)."""
    path = {}
    for p, name in enumerate(names):
        at_s, at_m, driven_m_s, speed_age_s = samples[p, :, : offset[p, -1]]
        path[name] = NutPath(at_s, at_m, offset[p], driven_m_s, speed_age_s)
    return path


class LiveWalk(NamedTuple):
    """The arguments of the kernel at a reading and at a tick: `waiting` counts rows; `octets` are the
    frame's.
    """

    names: tuple[str, ...]
    rows: Rows
    waiting: int
    plan: Expected
    memory: Memory
    frames: Frames
    octets: NDArray[np.uint8]


class Walk:
    """A walk over rows, in parts; each part updates `memory`."""

    def __init__(
        self,
        channels: tuple[str, ...],
        plan: Expected,
        last_tick_s: float = math.nan,
        memory: Memory | None = None,
    ) -> None:
        """Begin before the first row, or continue from the `memory` of another walk.

        Args:
            channels: The c channels.
            plan: What is expected of them.
            last_tick_s: The last tick before a warm start; NaN after a cold one.
            memory: The state after the rows before, which is copied; None begins anew.
        """
        self._plan = plan = packed(plan)
        self._channels, self._paths = channels, tuple(channels[column] for column in plan.position)
        self.memory = nothing_yet(plan, last_tick_s) if memory is None else memory.copy()
        self._plan_record, self._memory_record = record(plan), record(self.memory)
        self._have_room(16)

    def _have_room(self, most: int) -> None:
        """Allocate arrays for at most `most` rows waiting for a tick."""
        c = len(self._channels)
        self._rows = Rows(
            np.empty(most), np.empty(most), np.zeros(most, np.bool_), np.empty((most, c)),
            np.zeros((most, c), np.bool_), np.empty((most, c), np.bool_),
        )  # fmt: skip
        frames = _empty_frames(1, c, len(self._paths), most)
        scratch: dict[str, Any] = {"end": frames.end, "counts": frames.counts}
        names = [name for name in Frames._fields if name not in scratch]
        bundle = Bundle.of({name: getattr(frames, name) for name in names})
        columns: dict[str, Any] = {name: bundle[name] for name in names}
        self._of = OfFrame(bundle.fields.dtype, self._channels, self._paths)
        self._live = record(
            LiveWalk(
                self._channels,
                self._rows,
                0,
                self._plan,
                self.memory,
                Frames(**columns, **scratch),
                bundle.octets,
            )
        )

    def _widen(self) -> None:
        """Double the number of rows that can wait for a tick."""
        before, count = self._rows, self._live.waiting
        self._have_room(2 * count)
        for wide, narrow in zip(self._rows, before, strict=True):
            wide[:count] = narrow
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
        """Queue a reading for the next tick.

        Args:
            time_s: The time of its row.
            late_s: Its delay in s.
            values: Numbers by channel; unknown channels are skipped.
            faulted: The channels with a fault.

        Returns:
            Whether all its values are floats of known channels.
        """
        status: int = put_reading(self._live, time_s, late_s, values)
        if status < 0:
            self._widen()
            return self.take(time_s, late_s, values, faulted)
        for name in faulted:
            self._rows.faulted[self._live.waiting - 1, self._channels.index(name)] = True
        return status == len(values)

    def tick(self, time_s: float) -> FrameBlock:
        """Continue over the waiting rows and a tick after them; return its frame."""
        data = tick_on(self._live, time_s)
        if data is None:
            self._widen()
            return self.tick(time_s)
        return FrameBlock.of(self._of, data)
