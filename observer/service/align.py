"""From readings to frames: every channel's latest value, age and quality at each tick.

Readings and ticks are rows in the order of time, live as in a recording, and one compiled function walks over
them. The live service hands it the rows since the last tick, a replay thousands at once; the frames are the
same to the last bit. Nothing here knows a clock: times come with the readings and ticks.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field
from urllib.parse import unquote

import numpy as np
from numba import njit
from numpy.typing import NDArray

from observer.config import Config
from observer.frames import BoolArray, FloatArray, FrameBlock, Quality, QualityArray, Reading
from observer.logs import Log
from observer.service.stuck import is_stuck, no_memory

BLOCK = 4096
MISSING_FAULT = "missing"  # how a recording marks a reading without a value and without a fault
_GOOD, _MISSING = int(Quality.GOOD), int(Quality.MISSING)
_STALE, _REJECTED = int(Quality.STALE), int(Quality.REJECTED)
_OUTAGE = 3.0  # a gap this many times the usual one says nothing about how often a channel comes


@dataclass(frozen=True, slots=True)
class AlignPlan:
    """What is expected of the channels.

    `period_s` is the tick's; `expected_s` (c,) each channel's own, NaN where it is learned from what comes;
    `noise_K` (c,) that of thermocouples, NaN elsewhere; `positions` the columns whose path is kept.
    """

    channels: tuple[str, ...]
    positions: tuple[int, ...]
    expected_s: FloatArray
    noise_K: FloatArray
    period_s: float

    @classmethod
    def of(cls, config: Config) -> AlignPlan:
        """The plan of a configuration."""
        channels = config.channels
        periods = expected_periods(config)
        noise_K = {sensor.channel: sensor.noise_K for sensor in config.sensor}
        moving = {source.position_channel for source in config.source}
        return cls(
            channels,
            tuple(i for i, name in enumerate(channels) if name in moving),
            np.array([periods.get(name, math.nan) for name in channels]),
            np.array([noise_K.get(name, math.nan) for name in channels]),
            config.estimator.period_s,
        )


def expected_periods(config: Config) -> dict[str, float]:
    """How often each channel comes, by what the configuration says of its driver; a player's is not known."""
    periods: dict[str, float] = {}
    for settings in config.drivers.values():
        if settings.kind == "player":
            continue
        names = (settings.position_channel,) if settings.kind == "canopen" else settings.channels
        periods.update(dict.fromkeys(names, settings.period_s))
    return periods


@dataclass(frozen=True, slots=True)
class Rows:
    """n rows in the order of time: what each reading said of which channel, and which rows are ticks.

    `time_s`, `step` (n,); `values`, `present`, `faulted` (n, c).
    """

    time_s: FloatArray
    step: BoolArray
    values: FloatArray
    present: BoolArray
    faulted: BoolArray

    def part(self, start: int, end: int) -> Rows:
        """The rows from `start` up to `end`."""
        cut = slice(start, end)
        return Rows(self.time_s[cut], self.step[cut], self.values[cut], self.present[cut], self.faulted[cut])


@dataclass(slots=True)
class _Memory:
    """Where the walk over the rows stands; arrays (c,), updated in place."""

    value: FloatArray
    seen_s: FloatArray
    gap_s: FloatArray
    newest: QualityArray
    arrived: BoolArray
    stuck: BoolArray
    noise: FloatArray
    last_tick_s: FloatArray = field(default_factory=lambda: np.array([np.nan]))


def _no_memory(channels: int, last_tick_s: float = math.nan) -> _Memory:
    return _Memory(
        np.full(channels, np.nan),
        np.full(channels, np.nan),
        np.full(channels, np.nan),
        np.full(channels, _MISSING, np.int8),
        np.zeros(channels, np.bool_),
        np.zeros(channels, np.bool_),
        no_memory(channels),
        np.array([last_tick_s]),
    )


def _walk(plan: AlignPlan, memory: _Memory, rows: Rows) -> FrameBlock:
    """The frames at the ticks among the rows; `memory` is updated."""
    ticks, channels = int(np.count_nonzero(rows.step)), len(plan.channels)
    values, age_s = np.empty((ticks, channels)), np.empty((ticks, channels))
    fresh, quality = np.empty((ticks, channels), np.bool_), np.empty((ticks, channels), np.int8)
    time_s, dt_s = np.empty(ticks), np.empty(ticks)
    _walk_rows(
        rows.time_s, rows.step, rows.values, rows.present, rows.faulted,
        plan.expected_s, plan.noise_K, plan.period_s,
        memory.value, memory.seen_s, memory.gap_s, memory.newest, memory.arrived, memory.stuck, memory.noise,
        memory.last_tick_s, time_s, dt_s, values, fresh, quality, age_s,
    )  # fmt: skip
    path = {plan.channels[j]: _path(rows, j) for j in plan.positions}
    return FrameBlock(plan.channels, time_s, dt_s, values, fresh, quality, age_s, path)


def _path(rows: Rows, column: int) -> tuple[FloatArray, FloatArray, NDArray[np.int64]]:
    """All usable samples of one channel, and which of them belong to which tick."""
    cells = rows.values[:, column]
    usable = rows.present[:, column] & ~rows.faulted[:, column] & np.isfinite(cells)
    count = np.cumsum(usable, dtype=np.int64)[rows.step]
    return rows.time_s[usable], cells[usable], np.concatenate([np.zeros(1, np.int64), count])


@njit(cache=True)
def _walk_rows(
    time_s: FloatArray, step: BoolArray, cells: FloatArray, present: BoolArray, faulted: BoolArray,
    expected_s: FloatArray, noise_K: FloatArray, period_s: float,
    value: FloatArray, seen_s: FloatArray, gap_s: FloatArray, newest: QualityArray,
    arrived: BoolArray, stuck: BoolArray, noise: FloatArray, last_tick_s: FloatArray,
    tick_s: FloatArray, dt_s: FloatArray, values: FloatArray, fresh: BoolArray, quality: QualityArray,
    age_s: FloatArray,
) -> None:  # fmt: skip
    """Walk over rows in the order of time, updating what is remembered and filling the frames."""
    k = 0
    for row in range(len(time_s)):
        for j in range(len(value)):
            if not present[row, j]:
                continue
            cell = cells[row, j]
            if faulted[row, j]:
                newest[j] = _REJECTED
            elif not math.isfinite(cell):
                newest[j] = _MISSING
            elif is_stuck(noise[j], cell, noise_K[j]):
                newest[j] = _REJECTED
                stuck[j] = True
            else:
                gap = time_s[row] - seen_s[j]  # NaN before the second sample
                if math.isnan(gap_s[j]):
                    gap_s[j] = gap
                elif gap <= _OUTAGE * gap_s[j]:
                    gap_s[j] += (gap - gap_s[j]) / 16.0
                newest[j], stuck[j], arrived[j] = _GOOD, False, True
                value[j], seen_s[j] = cell, time_s[row]
        if not step[row]:
            continue
        tick_s[k] = time_s[row]
        dt_s[k] = 0.0 if math.isnan(last_tick_s[0]) else time_s[row] - last_tick_s[0]
        last_tick_s[0] = time_s[row]
        for j in range(len(value)):
            usual_s = gap_s[j] if math.isnan(expected_s[j]) else expected_s[j]
            age = math.inf if math.isnan(seen_s[j]) else time_s[row] - seen_s[j]
            limit = 2.0 * (period_s if math.isnan(usual_s) else max(period_s, usual_s))
            late = newest[j] == _GOOD and age > limit
            quality[k, j] = _STALE if late else newest[j]
            fresh[k, j] = arrived[j] and quality[k, j] == _GOOD
            values[k, j], age_s[k, j], arrived[j] = value[j], age, False
        k += 1


class Aligner:
    """Takes readings as they come and gives a frame at each tick.

    A channel is good while its newest reading is a usable value no older than twice the time it is expected
    in (or the tick's period, if that is longer), and stale beyond; missing while it has never been seen or
    its newest reading holds no value; rejected while its newest reading carries a fault or it is stuck.
    After a warm start the first step begins at `last_tick_s`, the last tick before it.
    """

    def __init__(self, plan: AlignPlan, last_tick_s: float = math.nan) -> None:
        self._plan = plan
        self._column = {name: j for j, name in enumerate(plan.channels)}
        self._memory = _no_memory(len(plan.channels), last_tick_s)
        self._pending: list[Reading] = []
        self._faults: dict[str, str] = {}
        self._last_s = -math.inf

    @property
    def faults(self) -> dict[str, str]:
        """The fault each channel shows now, by its name."""
        stuck = {name: "stuck" for j, name in enumerate(self._plan.channels) if self._memory.stuck[j]}
        return stuck | self._faults

    def ingest(self, reading: Reading) -> Reading:
        """Take a reading; returns it as it is used, and is to be recorded: later than all before."""
        values, faults = {}, {}
        for name in self._column:
            if name not in reading.values and name not in reading.faults:
                continue
            values[name] = float(reading.values.get(name, math.nan))
            fault = reading.faults.get(name)
            self._faults.pop(name, None)
            if fault == MISSING_FAULT:
                values[name] = math.nan
            elif fault is not None:
                faults[name] = self._faults[name] = fault or "unknown"
        used = Reading(self._later(reading.time_s), values, faults)
        self._pending.append(used)
        return used

    def tick(self, time_s: float) -> FrameBlock:
        """The frame of all readings up to now; a block of one."""
        n, channels = len(self._pending) + 1, len(self._plan.channels)
        times, step = np.empty(n), np.zeros(n, np.bool_)
        values = np.full((n, channels), np.nan)
        present, faulted = np.zeros((n, channels), np.bool_), np.zeros((n, channels), np.bool_)
        for row, reading in enumerate(self._pending):
            times[row] = reading.time_s
            for name, value in reading.values.items():
                j = self._column[name]
                values[row, j], present[row, j], faulted[row, j] = value, True, name in reading.faults
        times[-1], step[-1] = self._later(time_s), True
        self._pending.clear()
        return _walk(self._plan, self._memory, Rows(times, step, values, present, faulted))

    def _later(self, time_s: float) -> float:
        """This time, or the smallest one after the last, so that rows are in the order of time."""
        self._last_s = time_s if time_s > self._last_s else math.nextafter(self._last_s, math.inf)
        return self._last_s


def frames_of_log(
    log: Log, plan: AlignPlan, block: int = BLOCK, last_tick_s: float = math.nan
) -> Iterator[FrameBlock]:
    """The frames of a log in blocks: the ticks of a recording, or every row of any other log.

    In a plain log each row is a tick at which every channel was read, so an empty cell is a missing value.
    `last_tick_s` is the last tick before a recording that goes on from a warm start.
    """
    memory = _no_memory(len(plan.channels), last_tick_s)
    rows = _rows_of_log(log, plan.channels)
    ends = np.flatnonzero(rows.step) + 1
    start = 0
    for first in range(0, len(ends), block):
        end = int(ends[min(first + block, len(ends)) - 1])
        yield _walk(plan, memory, rows.part(start, end))
        start = end


def _rows_of_log(log: Log, channels: tuple[str, ...]) -> Rows:
    """A log as rows; a channel that the log does not have is never present."""
    known = [j for j, name in enumerate(channels) if name in log.channels]
    values = np.full((len(log), len(channels)), np.nan)
    values[:, known] = log.values[:, [log.channels.index(channels[j]) for j in known]]
    faulted = np.zeros(values.shape, np.bool_)
    present = np.zeros(values.shape, np.bool_)
    if log.step is None or log.flags is None:
        present[:, known] = True
        return Rows(log.time_s, np.ones(len(log), np.bool_), values, present, faulted)
    present[:] = ~np.isnan(values)
    column = {name: j for j, name in enumerate(channels)}
    for row, flags in enumerate(log.flags):
        for name, fault in faults_of(flags).items():
            if name in column:
                present[row, column[name]] = True
                faulted[row, column[name]] = fault != MISSING_FAULT
    return Rows(log.time_s, log.step, values, present, faulted)


def faults_of(flags: str | None) -> dict[str, str]:
    """The faults written in a recording's `flags` cell: `channel=fault;channel=fault`; a checksum is none."""
    pairs = (item.split("=", 1) for item in flags.split(";") if item[:1] != "#") if flags else ()
    return {unquote(pair[0]): unquote(pair[-1]) for pair in pairs}
