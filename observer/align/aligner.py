"""From readings to frames: every channel's latest value, age and quality at each tick.

Readings and ticks are rows in the order in which they were used, live as in a recording, and one compiled
function (`walk.py`) walks over them. The live service hands it the rows since the last tick, a replay
thousands at once; the frames are the same to the last bit. Nothing here knows a clock: times come with the
readings and ticks. A reading that was held up on its way keeps the time of its source: its row says how late
it is.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence, Set
from dataclasses import dataclass, replace
from typing import Any
from urllib.parse import unquote

import numpy as np

from observer.align.log_times import doubt_of_times, expected_cells, gaps_of, given_intervals_s, intervals_s
from observer.align.passing import Passing, Passings, never_read, passings_of, with_passings
from observer.align.plausibility import Breach, Limits, doubts_of_log, implausible
from observer.align.walk import Expected, Memory, Rows, Walk
from observer.config import Config
from observer.errors import LogError
from observer.files.logs import Log
from observer.frames import BoolArray, FloatArray, FrameBlock, NutPath, Reading, contiguous

BLOCK = 4096
_ABSENT = {"silent", "disconnected", "missing"}  # what an occasional channel is most of the time
MISSING_FAULT = "missing"  # marks a reading without a value and without a fault in a recording
COMMAND_MARK = "!"  # begins a command in `flags`; in the name of a channel it would be escaped
RESET = f"{COMMAND_MARK}reset=done"
LATE_S = 1e-6  # a reading later than its row by less is in time: rows are a bit apart to be in order


@dataclass(frozen=True, slots=True)
class Position:
    """A channel whose path is kept: its column, and that of the speed that drives it times `lead_m`.

    `speed` is −1 where speed or lead is not known, or the nut is driven as well as the screw.
    """

    column: int
    speed: int = -1
    lead_m: float = math.nan


@dataclass(frozen=True, slots=True)
class AlignPlan:
    """What is expected of the channels.

    `period_s` is the tick's; `expected_s` (c,) each channel's own, NaN where it is learned from what comes,
    infinite where it is occasional; `noise_K` (c,) that of thermocouples, NaN elsewhere; `positions` those
    whose path is kept; `limits` the plausible values. `log_s` (c,) the channels' own periods in logs that
    others wrote, NaN where learnt. `passings` are the displacements that are read where the nut passes.

    `heartbeat_s` (c,) is the age beyond which the value of a channel that sends only on change is stale, NaN
    of any other channel. Such a channel has no `expected_s`, as no two of its values are a period apart, and
    no `noise_K`, as equal values are heartbeats and no sign of a stuck sensor.
    """

    channels: tuple[str, ...]
    positions: tuple[Position, ...]
    expected_s: FloatArray
    noise_K: FloatArray
    period_s: float
    limits: Limits
    log_s: FloatArray | None = None
    passings: tuple[Passing, ...] = ()
    heartbeat_s: FloatArray | None = None

    @classmethod
    def of(cls, config: Config) -> AlignPlan:
        """The plan of a configuration."""
        channels = config.channels
        never = {s.channel: math.inf for s in config.sensor if s.occasional}
        periods = config.sample_s | never
        noise_K = {s.channel: s.noise_K for s in config.sensor if s.kind == "temperature"}
        heartbeat_s = np.array([config.heartbeats_s.get(name, math.nan) for name in channels])
        periodic = np.isnan(heartbeat_s)
        return cls(
            channels,
            tuple(_positions(config).values()),
            np.where(periodic, [periods.get(name, math.nan) for name in channels], math.nan),
            np.where(periodic, [noise_K.get(name, math.nan) for name in channels], math.nan),
            config.estimator.period_s,
            Limits.of(config),
            given_intervals_s(config),
            passings_of(config),
            heartbeat_s,
        )

    def of_log(self, log: Log) -> AlignPlan:
        """The plan with the sampling intervals found in a log from another recorder."""
        if log.step is not None:
            return self
        unknown_s = np.full(len(self.channels), np.nan)
        own_s = intervals_s(log, self.channels, unknown_s if self.log_s is None else self.log_s)
        unchanged = np.isnan(own_s) | self.on_change
        return replace(self, expected_s=np.where(unchanged, self.expected_s, own_s), log_s=own_s)

    @property
    def occasional(self) -> BoolArray:
        """Which channels (c,) come only now and then, and are never overdue."""
        return np.isinf(self.expected_s)

    @property
    def on_change(self) -> BoolArray:
        """Which channels (c,) send only when their value changes, and at heartbeats."""
        if self.heartbeat_s is None:
            return np.zeros(len(self.channels), np.bool_)
        return ~np.isnan(self.heartbeat_s)

    def expected(self) -> Expected:
        """The plan as the compiled walk takes it."""
        own = self.limits
        none_s = np.full(len(self.channels), math.nan)
        return Expected(
            self.expected_s, none_s if self.heartbeat_s is None else self.heartbeat_s, self.noise_K,
            self.period_s, own.low, own.high, own.rate_per_s, own.above_K, own.below_K, own.slack,
            own.ambient, own.ambient_degC,
            np.array([p.column for p in self.positions], np.int64),
            np.array([p.speed for p in self.positions], np.int64),
            np.array([p.lead_m for p in self.positions], float),
        )  # fmt: skip


def _positions(config: Config) -> dict[str, Position]:
    """The position channels, each once."""
    found: dict[str, Position] = {}
    for source in config.source:
        if source.position_channel is None:
            continue
        column = config.channels.index(source.position_channel)
        lead_m = source.lead_m or (source.nut_friction.lead_m if source.nut_friction else None)
        if source.speed_channel is None or source.nut_speed_channel is not None or lead_m is None:
            found.setdefault(source.position_channel, Position(column))
        else:
            speed = config.channels.index(source.speed_channel)
            found[source.position_channel] = Position(column, speed, lead_m)
    return found


class Aligner:
    """Takes readings as they come and gives a frame at each tick.

    A channel is good while its newest reading is a usable value no older than twice the time it is expected
    in (or the tick's period, if that is longer), and stale beyond; missing while it has never been seen or
    its newest reading holds no value; rejected while its newest reading carries a fault or it is stuck. One
    that sends only on change is good until its heartbeat has passed; its silence before says nothing.
    After a warm start the first step begins at `last_tick_s`, the last tick before it.
    """

    def __init__(self, plan: AlignPlan, last_tick_s: float = math.nan) -> None:
        self._plan = plan
        self._walk = Walk(plan.channels, plan.expected(), last_tick_s)
        self._occasional = {name: j for j, name in enumerate(plan.channels) if plan.occasional[j]}
        self._on_change = {name for j, name in enumerate(plan.channels) if plan.on_change[j]}
        self._passings = Passings(plan.passings)
        self._faults: dict[str, str] = {}
        self._last_s = -math.inf

    @property
    def memory(self) -> Memory:
        """The state of the channels, as a copy."""
        return self._walk.memory.copy()

    @property
    def faults(self) -> dict[str, str]:
        """The fault each channel shows now, by its name."""
        memory, found = self._walk.memory, {}
        ambient = self._plan.limits.ambient
        ambient_degC = self._plan.limits.ambient_degC if ambient < 0 else float(memory.value[ambient])
        for j, name in enumerate(self._plan.channels):
            if memory.stuck[j]:
                found[name] = "stuck"
            if breach := int(memory.breach[j]):
                value = float(memory.refused[j])
                found[name] = self._plan.limits.sentence(j, Breach(breach), value, ambient_degC)
        return found | self._faults

    def news_of(self, reading: Reading) -> list[Reading]:
        """Return what of a reading is news, none where nothing is: of an occasional channel no absence, and
        no value that it still has, as a register keeps it, but a new one; of one that sends only on change no
        silence. What follows from it where the nut has passed comes first.
        """
        given = [*self._passings.take(reading), reading]
        return [news for each in given if (news := self._new_in(each)) is not None]

    def _new_in(self, reading: Reading) -> Reading | None:
        occasional = self._occasional.keys() & reading.values.keys()
        old = [name for name in occasional if self._is_old(name, reading)]
        if reading.faults:
            old += [name for name in self._on_change if reading.faults.get(name) == "silent"]
        if not old:
            return reading
        values = {name: value for name, value in reading.values.items() if name not in old}
        faults = {name: fault for name, fault in reading.faults.items() if name not in old}
        return replace(reading, values=values, faults=faults) if values else None

    def _is_old(self, name: str, reading: Reading) -> bool:
        """Whether a reading says of an occasional channel nothing, or what is known."""
        value, fault = float(reading.values[name]), reading.faults.get(name)
        known = self._walk.memory.value[self._occasional[name]]
        return fault in _ABSENT or (fault is None and (math.isnan(value) or value == known))

    def ingest(self, reading: Reading) -> Reading:
        """Take a reading; returns it as used and to be recorded, in a row later than all before."""
        row_s = time_s = reading.time_s
        if time_s <= self._last_s:
            row_s = math.nextafter(self._last_s, math.inf)
        self._last_s = row_s
        late_s = row_s - time_s if row_s - time_s >= LATE_S else 0.0
        values, faults = reading.values, reading.faults
        if faults or self._faults:
            values, faults = self._with_faults(reading)
        if not self._walk.take(row_s, late_s, values, faults):
            values = {name: float(values[name]) for name in self._plan.channels if name in values}
        elif row_s == time_s and values is reading.values:
            return reading
        return Reading(row_s, values, faults, late_s)

    def _with_faults(self, reading: Reading) -> tuple[Mapping[str, float], dict[str, str]]:
        """The values and faults of a reading, the faults that channels show now being noted."""
        values, faults = {}, {}
        for name in self._plan.channels:
            if name not in reading.values and name not in reading.faults:
                continue
            values[name] = float(reading.values.get(name, math.nan))
            fault = reading.faults.get(name)
            self._faults.pop(name, None)
            if fault == MISSING_FAULT:
                values[name] = math.nan
            elif fault is not None:
                faults[name] = self._faults[name] = fault or "unknown"
        return values, faults

    def tick(self, time_s: float) -> FrameBlock:
        """The frame of all readings up to now; a block of one."""
        if time_s <= self._last_s:
            time_s = math.nextafter(self._last_s, math.inf)
        self._last_s = time_s
        return self._walk.tick(time_s)


def frames_of_log(
    log: Log, plan: AlignPlan, block: int = BLOCK, last_tick_s: float = math.nan
) -> Iterator[FrameBlock]:
    """The frames of a log in blocks: the ticks of a recording, or every row of any other log.

    In a plain log each row is a tick at which every channel was read, so an empty cell is a missing value. Of
    a channel that is regularly rarer than the rows one is missing that is overdue.
    `last_tick_s` is the last tick before a recording that goes on from a warm start.
    """
    return (frames for frames, _ in blocks_of_log(log, plan, block, last_tick_s))


def blocks_of_log(
    log: Log,
    plan: AlignPlan,
    block: int = BLOCK,
    last_tick_s: float = math.nan,
    walk: Walk | None = None,
) -> Iterator[tuple[FrameBlock, bool]]:
    """The frames of a log in blocks, each with whether the estimator was reset before its first frame.

    `walk` is that of the part before, for a part of a recording.
    """
    log = log if log.step is not None else with_passings(log, plan.passings)
    plan = plan.of_log(log)
    walk = walk or Walk(plan.channels, plan.expected(), last_tick_s)
    rows = _rows_of_log(log, plan)
    ends = np.flatnonzero(rows.step) + 1
    resets = [row for row, flags in enumerate(log.flags or ()) if flags and flags.startswith(RESET)]
    afresh = set(np.searchsorted(ends, resets, side="right").tolist())
    start = first = 0
    while first < len(ends):
        last = min([first + block, len(ends), *(k for k in afresh if k > first)])
        end = int(ends[last - 1])
        yield walk.on(rows.part(start, end)), first in afresh
        start, first = end, last


def _rows_of_log(log: Log, plan: AlignPlan) -> Rows:
    """A log as rows, `plan` being that of the log; a channel that the log does not have is never present."""
    channels = plan.channels
    known = [j for j, name in enumerate(channels) if name in log.channels]
    time_s = contiguous(log.time_s)
    values = np.full((len(log), len(channels)), np.nan)
    values[:, known] = log.values[:, [log.channels.index(channels[j]) for j in known]]
    faulted = np.zeros(values.shape, np.bool_)
    present = np.zeros(values.shape, np.bool_)
    if log.step is None or log.flags is None:
        for j in known:
            own_s = math.nan if plan.log_s is None else float(plan.log_s[j])
            there = np.isfinite(values[:, j])
            if plan.occasional[j]:  # a value that the row before has too is held, and no new one
                there[1:] &= values[1:, j] != values[:-1, j]
            present[:, j] = expected_cells(time_s, there, own_s)
        none_late = np.zeros(len(log))
        return Rows(time_s, none_late, np.ones(len(log), np.bool_), values, present, faulted)
    present[:] = ~np.isnan(values)
    column = {name: j for j, name in enumerate(channels)}
    for row, flags in enumerate(log.flags):
        for name, fault in faults_of(flags).items():
            if name in column:
                present[row, column[name]] = True
                faulted[row, column[name]] = fault != MISSING_FAULT
    late_s = np.zeros(len(log)) if log.late_s is None else np.nan_to_num(log.late_s)
    return Rows(time_s, late_s, contiguous(log.step, np.bool_), values, present, faulted)


def faults_of(flags: str | None) -> dict[str, str]:
    """The faults written in a recording's `flags` cell: `channel=fault;channel=fault`; commands are none."""
    items = flags.split(";") if flags else ()
    pairs = (item.split("=", 1) for item in items if not item.startswith(COMMAND_MARK))
    return {unquote(pair[0]): unquote(pair[-1]) for pair in pairs}


def commands_of(log: Log) -> list[dict[str, Any]]:
    """The commands in a recording: of each `time_s`, `command`, and `outcome`, as `done by anna@desk`."""
    found = []
    for row, flags in enumerate(log.flags or ()):
        for item in (flags or "").split(";"):
            if item.startswith(COMMAND_MARK):
                name, _, outcome = item.removeprefix(COMMAND_MARK).partition("=")
                found.append({"time_s": float(log.time_s[row]), "command": name, "outcome": unquote(outcome)})
    return found


def read_in(frames: FrameBlock) -> set[str]:
    """The channels that had a usable value in frames."""
    return {frames.channels[j] for j in np.flatnonzero(frames.fresh.any(axis=0)).tolist()}


def doubts(
    log: Log, paths: Sequence[Mapping[str, NutPath]], config: Config, read: Set[str] | None = None
) -> list[str]:
    """List doubts about a log: channels that do not fit the configuration, with their likely unit,
    words that were read as missing values, sensors without any value, and places along a nut's way that are
    never read.

    `paths` are the nuts' paths in the log's frames, block by block, `read` the channels with a value in these
    (see `read_in`), None where that is not known.
    """
    words = [each.text for each in log.words if each.column in config.channels]
    dead = [
        f"channel {name} has no value in any row, so its sensor counts as missing throughout"
        for name in _without_value(log, {sensor.channel for sensor in config.sensor})
    ]
    slow = [] if (times := doubt_of_times(log, config)) is None else [times]
    return [
        *log.doubts,
        *slow,
        *gaps_of(log),
        *dead,
        *words,
        *(() if read is None else never_read(log, passings_of(config), read)),
        *doubts_of_log(config, log.values, log.channels, paths),
    ]


def refuse_empty(log: Log, config: Config, *, sensors: bool) -> None:
    """Raise `LogError` where an input has no value in any row, or, if asked, no sensor has one: the wrong
    column, or one never written. In a recording of the service any may have been away, and is not refused.
    """
    if log.step is not None:
        return
    of_sensors = {sensor.channel for sensor in config.sensor}
    empty = _without_value(log, of_sensors)
    if sensors and len(empty) == len(of_sensors):
        names = ", ".join(f'"{name}"' for name in empty)
        raise LogError(f"{log.path}: no sensor has a value in any row ({names}); check the sensors' channels")
    if not (empty := _without_value(log, set(config.channels) - of_sensors)):
        return
    names = ", ".join(f'"{name}"' for name in empty)
    one = len(empty) == 1
    columns, it = (f"column {names} never has", "it") if one else (f"columns {names} never have", "them")
    raise LogError(
        f"{log.path}: {columns} a value; fill {it}, or leave {it} out of the log and the configuration"
    )


def refuse_implausible(log: Log, config: Config, *, laws: bool = False) -> None:
    """Raise `LogError` where a temperature that the screw is in, or, if asked, an input of a heat law, is
    beyond its limits in every row: it counts as missing, and nothing follows from the log.
    """
    needed = {config.boundary.left.channel, config.boundary.right.channel, config.ambient.channel}
    if config.bed is not None:
        needed.add(config.bed.channel)
    if laws:
        needed |= {c for s in config.source for c in (s.speed_channel, s.nut_speed_channel, s.power_channel)}
    for name, part, sentence in implausible(config, log.values, log.channels):
        if name in needed and part == 1.0:
            raise LogError(
                f"{log.path}: channel {name} is {sentence}; convert it, or give its unit in [log.columns]"
            )


def _without_value(log: Log, among: Set[str]) -> list[str]:
    """The channels of a log without a value in any row."""
    columns = ((name, log.values[:, j]) for j, name in enumerate(log.channels) if name in among)
    return [name for name, values in columns if not np.isfinite(values).any()]
