"""From readings to frames: every channel's latest value, age and quality at each tick.

Readings and ticks are rows in the order in which they were used, live as in a recording. One compiled
function (`walk.py`) processes them. The live service hands it the rows since the last tick, a replay
thousands at once; the frames are the same to the last bit. Nothing here reads a clock: times come with the
readings and ticks. A delayed reading keeps the time of its source, and its row holds the delay.
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
from observer.config.machine import Config
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
    """A nut's position channel.

    Attributes:
        column: Its column among the channels.
        speed: The column of the speed that drives the nut; −1 if speed or lead is not known, or if the nut is
            driven as well as the screw.
        lead_m: The lead in m, by which that speed moves the nut; NaN without.
    """

    column: int
    speed: int = -1
    lead_m: float = math.nan


@dataclass(frozen=True, slots=True)
class AlignPlan:
    """How each of c channels is expected to deliver its values.

    Attributes:
        positions: channels with a nut's position
        expected_s: (c,) interval between values: NaN if learnt from the readings, infinite if occasional
        noise_K: (c,) noise of thermocouples, NaN elsewhere
        period_s: interval between ticks
        limits: plausible values
        log_s: (c,) intervals in logs from other recorders, NaN where learnt
        passings: displacements that are read where the nut passes
        heartbeat_s: (c,) age beyond which the value of a channel that sends only on change is stale, else NaN

    A channel with a heartbeat has no `expected_s`, since its values have no common interval. It has no
    `noise_K` either, since equal values are heartbeats and not the sign of a stuck sensor.
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
        """Return the plan of a configuration.

        Intervals come from drivers and sensors. A channel whose interval is not configured has NaN, and it is
        learnt.
        """
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
        """Return the plan with the sampling intervals found in a log from another recorder.

        A recording of the service leaves the plan unchanged.
        """
        if log.step is not None:
            return self
        unknown_s = np.full(len(self.channels), np.nan)
        log_s = intervals_s(log, self.channels, unknown_s if self.log_s is None else self.log_s)
        unchanged = np.isnan(log_s) | self.on_change
        return replace(self, expected_s=np.where(unchanged, self.expected_s, log_s), log_s=log_s)

    @property
    def occasional(self) -> BoolArray:
        """Which channels (c,) deliver values only now and then, and are never overdue."""
        return np.isinf(self.expected_s)

    @property
    def on_change(self) -> BoolArray:
        """Which channels (c,) send only when their value changes, and at heartbeats."""
        if self.heartbeat_s is None:
            return np.zeros(len(self.channels), np.bool_)
        return ~np.isnan(self.heartbeat_s)

    def expected(self) -> Expected:
        """Return the plan in the form that the compiled walk takes."""
        limits = self.limits
        none_s = np.full(len(self.channels), math.nan)
        return Expected(
            self.expected_s, none_s if self.heartbeat_s is None else self.heartbeat_s, self.noise_K,
            self.period_s, limits.low, limits.high, limits.rate_per_s, limits.above_K, limits.below_K,
            limits.slack, limits.ambient, limits.ambient_degC,
            np.array([p.column for p in self.positions], np.int64),
            np.array([p.speed for p in self.positions], np.int64),
            np.array([p.lead_m for p in self.positions], float),
        )  # fmt: skip


def _positions(config: Config) -> dict[str, Position]:
    """Return the position channels by name, each once."""
    positions: dict[str, Position] = {}
    for source in config.source:
        if source.position_channel is None:
            continue
        column = config.channels.index(source.position_channel)
        lead_m = source.lead_m or (source.nut_friction.lead_m if source.nut_friction else None)
        if source.speed_channel is None or source.nut_speed_channel is not None or lead_m is None:
            positions.setdefault(source.position_channel, Position(column))
        else:
            speed = config.channels.index(source.speed_channel)
            positions[source.position_channel] = Position(column, speed, lead_m)
    return positions


class Aligner:
    """Takes readings as they come and gives a frame at each tick.

    The quality of a channel follows from its newest reading. It is good while that is a usable value no older
    than twice its expected interval, or twice the tick's period if that is longer. Beyond that age it is
    stale. It is missing before the first reading and after one without a value. It is rejected after a
    reading with a fault, and while the channel is stuck. A channel that sends only on change is good until
    its heartbeat is overdue.

    After a warm start the first step begins at `last_tick_s`, the last tick before it.

    Call `ingest` and `tick` in the order of time; it belongs to one thread.
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
        """A copy of the state of all channels."""
        return self._walk.memory.copy()

    @property
    def faults(self) -> dict[str, str]:
        """The present fault of each faulty channel, by name."""
        memory, faults = self._walk.memory, {}
        ambient = self._plan.limits.ambient
        ambient_degC = self._plan.limits.ambient_degC if ambient < 0 else float(memory.value[ambient])
        for j, name in enumerate(self._plan.channels):
            if memory.stuck[j]:
                faults[name] = "stuck"
            if breach := int(memory.breach[j]):
                value = float(memory.refused[j])
                faults[name] = self._plan.limits.sentence(j, Breach(breach), value, ambient_degC)
        return faults | self._faults

    def news_of(self, reading: Reading) -> list[Reading]:
        """Return the readings with news that follow from one: first those at places that the nut has passed.

        Values without news are left out. For an occasional channel these are a missing value and an unchanged
        one, as a register repeats it. For a channel that sends only on change it is silence. A reading
        without news gives an empty list.
        """
        readings = [*self._passings.take(reading), reading]
        return [news for candidate in readings if (news := self._new_in(candidate)) is not None]

    def _new_in(self, reading: Reading) -> Reading | None:
        """Return a reading without the channels that bring no news; None if none is left."""
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
        """Whether the value of an occasional channel in a reading is missing or equal to its last value."""
        value, fault = float(reading.values[name]), reading.faults.get(name)
        last_value = self._walk.memory.value[self._occasional[name]]
        return fault in _ABSENT or (fault is None and (math.isnan(value) or value == last_value))

    def ingest(self, reading: Reading) -> Reading:
        """Take a reading; return it as used and to be recorded, in a row later than all before.

        Unknown channels are left out. A reading that is not later than the last row gets the next possible
        time, and its delay is recorded.
        """
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
        """Return the values and faults of a reading, and store the present faults of its channels."""
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
        """Return the frame of all readings up to `time_s`, as a block of one.

        Args:
            time_s: The time of the tick; a time before the last row is moved just after it.
        """
        if time_s <= self._last_s:
            time_s = math.nextafter(self._last_s, math.inf)
        self._last_s = time_s
        return self._walk.tick(time_s)


def frames_of_log(
    log: Log, plan: AlignPlan, block: int = BLOCK, last_tick_s: float = math.nan
) -> Iterator[FrameBlock]:
    """Yield the frames of a log in blocks: the ticks of a recording, or every row of any other log.

    In a plain log each row is a tick at which every channel was read, so an empty cell is a missing value. In
    a channel that is regularly rarer than the rows, an empty cell is a missing value only when the channel is
    overdue.

    Args:
        log: The log; it is not changed.
        plan: The plan of the configuration.
        block: Most ticks in a block.
        last_tick_s: The last tick before a recording that continues from a warm start; NaN without.
    """
    return (frames for frames, _ in blocks_of_log(log, plan, block, last_tick_s))


def blocks_of_log(
    log: Log,
    plan: AlignPlan,
    block: int = BLOCK,
    last_tick_s: float = math.nan,
    walk: Walk | None = None,
) -> Iterator[tuple[FrameBlock, bool]]:
    """Yield the frames of a log in blocks, each with whether the estimator was reset before its first frame.

    Args:
        log: The log; it is not changed.
        plan: The plan of the configuration.
        block: Most ticks in a block.
        last_tick_s: The last tick before a recording that continues from a warm start; NaN without.
        walk: For a part of a recording, the one that has processed the part before; None begins anew.
    """
    log = log if log.step is not None else with_passings(log, plan.passings)
    plan = plan.of_log(log)
    walk = walk or Walk(plan.channels, plan.expected(), last_tick_s)
    rows = _rows_of_log(log, plan)
    ends = np.flatnonzero(rows.step) + 1
    resets = [row for row, flags in enumerate(log.flags or ()) if flags and flags.startswith(RESET)]
    reset_ticks = set(np.searchsorted(ends, resets, side="right").tolist())
    start = first = 0
    while first < len(ends):
        last = min([first + block, len(ends), *(k for k in reset_ticks if k > first)])
        end = int(ends[last - 1])
        yield walk.on(rows.part(start, end)), first in reset_ticks
        start, first = end, last


def _rows_of_log(log: Log, plan: AlignPlan) -> Rows:
    """Return a log as rows; `plan` is the log's. A channel that the log lacks is never present."""
    channels = plan.channels
    columns = [j for j, name in enumerate(channels) if name in log.channels]
    time_s = contiguous(log.time_s)
    values = np.full((len(log), len(channels)), np.nan)
    values[:, columns] = log.values[:, [log.channels.index(channels[j]) for j in columns]]
    faulted = np.zeros(values.shape, np.bool_)
    present = np.zeros(values.shape, np.bool_)
    if log.step is None or log.flags is None:
        for j in columns:
            interval_s = math.nan if plan.log_s is None else float(plan.log_s[j])
            has_value = np.isfinite(values[:, j])
            if plan.occasional[j]:  # a value that the row before has too is held, and no new one
                has_value[1:] &= values[1:, j] != values[:-1, j]
            present[:, j] = expected_cells(time_s, has_value, interval_s)
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
    """Return the fault of each channel in a recording's `flags` cell: `channel=fault;channel=fault`.

    Commands in the cell are left out.
    """
    items = flags.split(";") if flags else ()
    pairs = (item.split("=", 1) for item in items if not item.startswith(COMMAND_MARK))
    return {unquote(pair[0]): unquote(pair[-1]) for pair in pairs}


def commands_of(log: Log) -> list[dict[str, Any]]:
    """Return the commands in a recording, each with `time_s`, `command` and `outcome`, such as `done by
    anna@desk`.
    """
    commands = []
    for row, flags in enumerate(log.flags or ()):
        for item in (flags or "").split(";"):
            if item.startswith(COMMAND_MARK):
                name, _, outcome = item.removeprefix(COMMAND_MARK).partition("=")
                commands.append(
                    {"time_s": float(log.time_s[row]), "command": name, "outcome": unquote(outcome)}
                )
    return commands


def read_in(frames: FrameBlock) -> set[str]:
    """Return the channels that had a usable value in frames."""
    return {frames.channels[j] for j in np.flatnonzero(frames.fresh.any(axis=0)).tolist()}


def doubts(
    log: Log, paths: Sequence[Mapping[str, NutPath]], config: Config, read: Set[str] | None = None
) -> list[str]:
    """Return the doubts about a log, a sentence each.

    They concern channels that do not fit the configuration, with their likely unit, and words that were read
    as missing values. They also name sensors without any value and places along a nut's way that are never
    read.

    Args:
        log: The log.
        paths: The nuts' paths in the log's frames, block by block.
        config: The configuration.
        read: The channels with a value in these frames (see `read_in`); None if that is not known.
    """
    words = [unread.text for unread in log.words if unread.column in config.channels]
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
    """Reject a log whose inputs have no value.

    The cause is a wrong column or one that was never written. A recording of the service is accepted, since
    any channel may have been disconnected.

    Args:
        log: The log.
        config: The configuration.
        sensors: Whether at least one sensor must have a value.

    Raises:
        LogError: If an input has no value in any row, or none of the sensors has one; it names the columns.
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
    columns, pronoun = (f"column {names} never has", "it") if one else (f"columns {names} never have", "them")
    raise LogError(
        f"{log.path}: {columns} a value; fill {pronoun}, or leave {pronoun} out of the log and "
        "the configuration"
    )


def refuse_implausible(log: Log, config: Config, *, laws: bool = False) -> None:
    """Reject a log in which a required temperature is beyond its limits in every row.

    Such a channel counts as missing, so the log cannot be used.

    Args:
        log: The log.
        config: The configuration.
        laws: Whether this also applies to the inputs of heat laws.

    Raises:
        LogError: It names the channel, its value and the likely unit.
    """
    required = {config.boundary.left.channel, config.boundary.right.channel, config.ambient.channel}
    if config.bed is not None:
        required.add(config.bed.channel)
    if laws:
        required |= {
            c for s in config.source for c in (s.speed_channel, s.nut_speed_channel, s.power_channel)
        }
    for name, part, sentence in implausible(config, log.values, log.channels):
        if name in required and part == 1.0:
            raise LogError(
                f"{log.path}: channel {name} is {sentence}; convert it, or give its unit in [log.columns]"
            )


def _without_value(log: Log, among: Set[str]) -> list[str]:
    """Return the channels among those named that have no value in any row of a log."""
    columns = ((name, log.values[:, j]) for j, name in enumerate(log.channels) if name in among)
    return [name for name, values in columns if not np.isfinite(values).any()]
