"""A service's recordings of the last hours, as the frames that it used, a run for each stretch.

A file that was full goes on in the next one as if it were one. After a start the service knows no channel any
more until it has been read, and so do the frames here. Stretches end where nothing was recorded for a while,
and where the estimator was reset: somebody may have done something to the machine.
"""

from __future__ import annotations

import itertools
import math
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path

import numpy as np

from observer.align.aligner import AlignPlan, blocks_of_log
from observer.align.passing import Passings, passings_of
from observer.config.publishing import RecordSettings
from observer.errors import ConfigError, LogError
from observer.files.logs import Log, read_log
from observer.fit.runs import LEAST_S, joined, part
from observer.frames import FrameBlock, Reading
from observer.installation import Installation
from observer.record.recorder import flags_of
from observer.record.retention import START_SUFFIX, Recording, recordings
from observer.units import BY_NAME

PAUSE_S = 30.0
"""A longer pause parts two stretches."""
ROTATED_S = 2.0
"""A file that begins so soon after another one, without a start of its own, goes on with it."""
_STAMP = re.compile(r"-(\d{8}T\d{6}Z)(?:-(\d+))?\.csv$")


@dataclass(frozen=True, slots=True)
class RecordedStretch:
    """Frames without a long pause.

    Attributes:
        path: The recording that they begin in.
        frames: The frames that the service used, (K, c).
    """

    path: Path
    frames: FrameBlock

    def __str__(self) -> str:
        """The file and the times of day, in UTC."""
        begin, end = (datetime.fromtimestamp(s, UTC) for s in (self.begin_s, self.end_s))
        return f"{self.path.name}, {begin:%Y-%m-%d %H:%M} to {end:%Y-%m-%d %H:%M} UTC"

    @property
    def begin_s(self) -> float:
        """Time of the first frame, s since 1970."""
        return float(self.frames.time_s[0])

    @property
    def end_s(self) -> float:
        """Time of the last frame, s since 1970."""
        return float(self.frames.time_s[-1])


def duration_s(text: str) -> float:
    """Return a duration such as 90min, 8h or 2d in seconds.

    Raises:
        ConfigError: The text has another form, or is 0.
    """
    match = re.fullmatch(r"\s*(\d{1,6}(?:\.\d{1,6})?)\s*(min|h|d)\s*", text)
    if match is None or float(match[1]) == 0.0:
        raise ConfigError(
            f"--recent: {text!r} is not a duration; give a number and min, h or d, as in 90min or 8h"
        )
    return BY_NAME[match[2]].to_base(float(match[1]))


def stretches(record: RecordSettings, name: str, plan: AlignPlan, last_s: float) -> list[RecordedStretch]:
    """Return the stretches that a service has recorded recently, the oldest first.

    Time counts back from the newest row. A row that is being written is left out, as are stretches that are
    too short for a fit.

    Args:
        record: The `[record]` table.
        name: `<machine>-<axis>`.
        plan: The alignment by which frames are made.
        last_s: Seconds before the newest row.

    Raises:
        ConfigError: `record.directory` is missing.
        LogError: Nothing is recorded, every stretch is too short, or a recording cannot be read.
    """
    if record.directory is None:
        raise ConfigError("--recent: the configuration has no record.directory; add [record], or name logs")
    logs = _logs(record.directory, name, plan, last_s)
    recorded = [s for run in _runs(logs) for s in _stretches(run, plan, float(logs[-1].time_s[-1]) - last_s)]
    long = [s for s in recorded if s.end_s - s.begin_s >= LEAST_S]
    if not long:
        most_s = max((s.end_s - s.begin_s for s in recorded), default=0.0)
        raise LogError(
            f"{record.directory}: the longest stretch recorded in that time lasts {most_s:.0f} s, and "
            f"{LEAST_S:.0f} s are needed; ask for a longer time, or let the service record for longer"
        )
    return long


def _logs(folder: Path, name: str, plan: AlignPlan, last_s: float) -> list[Log]:
    """The recordings that reach into the last seconds, the oldest first; none overlaps another."""
    try:
        files = sorted(recordings(folder, name), key=_order)
    except OSError as error:
        raise LogError(f"{folder}: cannot be read ({error.strerror}); correct record.directory") from None
    logs: list[Log] = []
    for file in reversed(files):
        log = _read(file, plan)
        if log is None or (logs and log.time_s[-1] >= logs[0].time_s[0]):
            continue  # it has no row yet, or the clock was set back since
        if logs and log.time_s[-1] < logs[-1].time_s[-1] - last_s:
            break
        logs.insert(0, log)
    if not logs:
        raise LogError(
            f"{folder}: no service called {name} has recorded anything there; run one for some hours, or "
            "name logs"
        )
    return logs


def _order(file: Recording) -> tuple[str, int]:
    stamp = _STAMP.search(file.path.name)
    return (stamp[1], int(stamp[2] or 1)) if stamp else ("", 0)


def _read(file: Recording, plan: AlignPlan) -> Log | None:
    """Return the whole rows of a recording; None if it has no row, or has been removed."""
    try:
        with file.path.open("rb") as opened:
            if opened.read(1_000_000).count(b"\n") < 2:
                return None
    except OSError as error:
        if isinstance(error, FileNotFoundError):
            return None
        raise LogError(
            f"{file.path}: cannot be read ({error.strerror}); run this as the service's user"
        ) from None
    return read_log(file.path, plan.channels, accept_truncated=True)


def _runs(logs: Sequence[Log]) -> Iterator[list[Log]]:
    """Recordings that belong together: no long pause between them, the ones a file was full after as one."""
    run: list[Log] = []
    for log in logs:
        pause_s = log.time_s[0] - run[-1].time_s[-1] if run else np.inf
        if pause_s > PAUSE_S:
            if run:
                yield run
            run = [log]
        elif pause_s <= ROTATED_S and not log.path.with_suffix(START_SUFFIX).exists():
            run[-1] = one_log(run[-1], log)
        else:
            run.append(log)
    if run:
        yield run


def one_log(before: Log, after: Log) -> Log:
    """Return two recordings of the same channels as one; the second one follows in time."""
    late = [np.full(len(log), np.nan) if log.late_s is None else log.late_s for log in (before, after)]
    assert before.step is not None
    assert after.step is not None
    order = [after.channels.index(name) for name in before.channels]
    return replace(
        before,
        time_s=np.concatenate([before.time_s, after.time_s]),
        values=np.concatenate([before.values, after.values[:, order]]),
        step=np.concatenate([before.step, after.step]),
        flags=(*(before.flags or ()), *(after.flags or ())),
        late_s=np.concatenate(late),
    )


def _stretches(run: Sequence[Log], plan: AlignPlan, from_s: float) -> Iterator[RecordedStretch]:
    """The frames of a run from a time on, parted where nothing came for long, or the estimator was reset."""
    blocks, starts, count, last_tick_s = list[FrameBlock](), list[int](), 0, math.nan
    for log in run:
        for block, afresh in blocks_of_log(log, plan, last_tick_s=last_tick_s):
            blocks.append(block)
            starts += [count] if afresh else []
            count, last_tick_s = count + len(block), float(block.time_s[-1])
    if not blocks:
        return
    frames = joined(blocks)
    first_row = int(np.searchsorted(frames.time_s, from_s))
    starts += [first_row, *np.flatnonzero(frames.dt_s > PAUSE_S).tolist()]
    edges = [*sorted({start for start in starts if first_row <= start < count}), count]
    for begin, end in itertools.pairwise(edges):
        yield RecordedStretch(run[0].path, part(frames, begin, end))


SUFFIXES = (".asc", ".blf", ".trc", ".log", ".mf4", ".db")
"""What `observer replay` takes for a CAN recording; `.csv` is always a log of channels."""


def is_can_recording(path: Path) -> bool:
    """Return whether a path names a CAN recording by its suffix, compressed or not."""
    suffix = path.suffix.lower()
    return (path.with_suffix("").suffix.lower() if suffix == ".gz" else suffix) in SUFFIXES


def read_can_log(path: Path, config: Installation) -> Log:
    """Decode a recording by the configuration's CAN drivers, with a tick at each period.

    Args:
        path: The recording of one bus or several.
        config: Its CAN drivers with their DBC files decode the frames.

    Returns:
        A log in the form of a recording of the service. Its `doubts` name the lines that are damaged or cut
            off.

    Raises:
        ConfigError: No CAN driver is configured.
        LogError: The file is missing, no frame can be decoded, or the time goes back.
    """
    decoded = [driver.decodes(path, name) for name, driver in config.drivers.items()]
    buses = [readings for readings in decoded if readings is not None]
    if not buses:
        raise ConfigError(f'{path}: a CAN recording needs a [drivers.…] table with kind = "can" to decode it')
    if not path.exists():
        raise LogError(f"{path}: no such file; give the path of a log")
    readings = [reading for readings in buses for reading in readings]
    if len(buses) == 1 and any(b.time_s < a.time_s for a, b in itertools.pairwise(readings)):
        raise LogError(f"{path}: time goes backwards; sort the recording by time")
    readings.sort(key=lambda reading: reading.time_s)
    passings = Passings(passings_of(config))
    readings += [passed for reading in readings for passed in passings.take(reading)]
    readings.sort(key=lambda reading: reading.time_s)
    if not readings:
        raise LogError(f"{path}: no frame that the configured DBC files describe; check the bus and the DBC")
    log = _with_ticks(path, readings, config.channels, config.estimator.period_s)
    doubts = dict.fromkeys(doubt for bus in buses for doubt in getattr(bus, "doubts", ()))
    return replace(log, doubts=tuple(doubts))


def _with_ticks(path: Path, readings: list[Reading], channels: tuple[str, ...], period_s: float) -> Log:
    """The rows of a recording of the service: readings as they came, ticks at whole periods."""
    first = math.floor(readings[0].time_s / period_s) + 1
    last = math.floor(readings[-1].time_s / period_s)
    ticks = np.arange(first, last + 1) * period_s
    times = np.array([r.time_s for r in readings])
    for i in range(1, len(times)):
        times[i] = max(times[i], math.nextafter(times[i - 1], math.inf))
    values = np.array([[r.values.get(c, math.nan) for c in channels] for r in readings])
    flags = [flags_of(r, channels) for r in readings]
    no_values = np.full((len(ticks), len(channels)), math.nan)
    ticks = np.where(np.isin(ticks, times), np.nextafter(ticks, math.inf), ticks)
    order = np.argsort(np.concatenate([times, ticks]), kind="stable")
    return Log(
        path,
        np.concatenate([times, ticks])[order],
        channels,
        np.concatenate([values, no_values])[order],
        np.concatenate([np.zeros(len(times), np.bool_), np.ones(len(ticks), np.bool_)])[order],
        tuple([*flags, *[None] * len(ticks)][i] for i in order),
    )
