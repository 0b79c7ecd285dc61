"""A log made ready for fitting: one run, its half-minute means in blocks or ticks, and its initial state.

Where the rows are too far apart to follow a nut, its path between them is filled in. Such a nut appears at
seemingly random positions of its stroke or, as under a stroboscope, seems to creep. Straight lines between
these positions are not its path.

While the speed stays the same, the nut is taken to run to and fro. The ends are the outermost positions it
shows, and a little beyond. If it shows too few places, they are those of the whole log. Where speed and lead
are known, the path follows from them instead.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from observer.config.machine import Config
from observer.errors import LogError
from observer.frames import BoolArray, FloatArray, FrameBlock, NutPath, Quality
from observer.model.build import build_plant
from observer.model.drive import Drive
from observer.model.simulate import Means

BLOCK_S = 30.0
START_S = 10.0
TICK_S = 10.0
"""The tick of a search."""
FINE_TICK_S = 2.0
"""The tick of a calibration from a log whose rows are closer than half of this.

Predicted means differ by a few mK from those by rows 50 ms apart, at a fortieth of the cost.
"""
LEAST_S = 300.0
"""Least duration of the longest log for a fit."""


@dataclass(frozen=True, slots=True)
class Run:
    """One run of a machine, with nothing in it that depends on the parameters.

    With K rows, b blocks of 30 s and s sensors. Displacements are in µm instead of °C.

    Attributes:
        frames: Rows from the first on which every known input has a value.
        first: First row of each block, (b,).
        usable: True for readings that count, (K, s).
        values_degC: Readings, °C, (K, s).
        count: Number of usable readings of each mean, (b, s).
        measured_degC: Mean of each block, °C, (b, s), NaN without a reading.
        start_degC: Mean over the first 10 s, °C, (s,), NaN without a reading.
        start_R_K2: Variance of that mean by noise, K², (s,), infinite without a reading.
    """

    frames: FrameBlock
    first: NDArray[np.int64]
    usable: BoolArray
    values_degC: FloatArray
    count: FloatArray
    measured_degC: FloatArray
    start_degC: FloatArray
    start_R_K2: FloatArray

    @property
    def duration_s(self) -> float:
        """Time from the first to the last row, s."""
        return float(self.frames.time_s[-1] - self.frames.time_s[0])

    def means(self, rows: FloatArray) -> FloatArray:
        """Return the averages of values over each block's usable samples, (b, s); 0 in a block without any.

        Args:
            rows: Values of every row, (K, s).
        """
        total = np.add.reduceat(np.where(self.usable, rows, 0.0), self.first, axis=0)
        return np.asarray(total / np.maximum(self.count, 1.0))


def mean_over(rows: FloatArray, weight: FloatArray, first: NDArray[np.int64]) -> FloatArray:
    """Return the weighted means of rows over stretches; 0 over a stretch without weight.

    Args:
        rows: Values, (K,) or (K, c).
        weight: Weight of each row, (K,), such as its duration.
        first: First row of each stretch, (T,), increasing from 0.

    Returns:
        Means, (T,) or (T, c).
    """
    over, column = np.add.reduceat(weight, first), (-1, *[1] * (rows.ndim - 1))
    total = np.add.reduceat(rows * weight.reshape(column), first)
    return np.asarray(total / np.where(over > 0, over, 1.0).reshape(column))


def prepare_all(config: Config, logs: Sequence[Sequence[FrameBlock]]) -> list[Run]:
    """Return the runs of several logs, which errors call "log 1" and so on.

    Args:
        config: The machine.
        logs: Frames of each log.

    Raises:
        LogError: If an input of a law, an input of the plant, or every sensor has no value in a log.
    """
    drive = _drive(config)
    return [_prepared(config, drive, blocks, f"log {i + 1}") for i, blocks in enumerate(logs)]


def refuse_short(runs: Sequence[Run], purpose: str) -> None:
    """Refuse logs that are all too short.

    Args:
        runs: The prepared logs.
        purpose: What they are for, such as "a calibration", as the message names it.

    Raises:
        LogError: If every run is shorter than `LEAST_S`.
    """
    longest_s = max((run.duration_s for run in runs), default=0.0)
    if longest_s < LEAST_S:
        raise LogError(
            f"the longest log lasts {longest_s:.0f} s and {purpose} needs at least {LEAST_S:.0f} s; "
            "record from a standstill through warming up to cooling down"
        )


def prepare(config: Config, blocks: Sequence[FrameBlock], name: str) -> Run:
    """Return a run from the frames of a log.

    The run begins at the first row where every known input and some sensor has a value. Stretches of a stuck
    sensor do not count.

    Args:
        config: The machine.
        blocks: Consecutive frames of the log.
        name: How errors call the log.

    Raises:
        LogError: If an input of a law, an input of the plant, or every sensor has no value throughout.
    """
    return _prepared(config, _drive(config), blocks, name)


def _drive(config: Config) -> Drive:
    """Return the reader of the frames; it ignores nut positions."""
    return Drive(config, replace(build_plant(config, nut_places=2), moving=()))


def _prepared(config: Config, drive: Drive, blocks: Sequence[FrameBlock], name: str) -> Run:
    frames = joined(blocks)
    _refuse_empty(config, frames, name)
    inputs = drive.run(drive.initial(), frames)[1]
    complete = np.flatnonzero(np.isfinite(inputs.z_end).all(axis=1))
    if len(complete) == 0:
        raise LogError(f"{name}: the ambient or a prescribed end has no value; add its channel to the log")
    usable = inputs.usable & ~frozen(inputs.y_degC, inputs.quality == int(Quality.REJECTED))
    measured = np.flatnonzero(usable.any(axis=1))
    if len(measured) == 0:
        raise LogError(f"{name}: no sensor has a usable value; check the sensors' channels")
    begin = int(max(complete[0], measured[0]))
    frames, usable, y_degC = tail(frames, begin), usable[begin:], inputs.y_degC[begin:]
    block = np.floor((frames.time_s - frames.time_s[0]) / BLOCK_S).astype(np.int64)
    first = np.flatnonzero(np.diff(block, prepend=-1))
    count = np.add.reduceat(usable, first, axis=0, dtype=float)
    total = np.add.reduceat(np.where(usable, y_degC, 0.0), first, axis=0)
    early = frames.time_s <= frames.time_s[0] + START_S
    at_start = np.sum(usable[early], axis=0).astype(float)
    noise_R_K2 = np.array([s.noise**2 for s in config.sensor])
    with np.errstate(invalid="ignore", divide="ignore"):
        return Run(
            frames=filled(frames, config),
            first=first,
            usable=usable,
            values_degC=y_degC,
            count=count,
            measured_degC=total / count,
            start_degC=np.where(usable[early], y_degC[early], 0.0).sum(axis=0) / at_start,
            start_R_K2=noise_R_K2 / at_start,
        )


@dataclass(frozen=True, slots=True)
class Ticks:
    """How a run's rows fall into T ticks and b means.

    Attributes:
        first: First row of each tick, (T,).
        length_s: Duration of each tick, s, (T,).
        mean: Mean that each tick belongs to, (T,).
        count: Usable values of each mean, (b, s).
        measured_degC: Average of each mean, °C or µm, (b, s), NaN without a value.
        time_s: End of each mean since the start of the run, s, (b,).
        share: Share of its mean's values that fell into each tick, (T, s).
        late: Delay of the values against an even distribution, relative to the tick, (T, s).
        at_end: True for ticks too long (outages) for the mean of their ends, (T,).
    """

    first: NDArray[np.int64]
    length_s: FloatArray
    mean: NDArray[np.int64]
    count: FloatArray
    measured_degC: FloatArray
    time_s: FloatArray
    share: FloatArray
    late: FloatArray
    at_end: NDArray[np.bool_]


def calibration_tick_s(runs: Sequence[Run]) -> float:
    """Return the tick with which a calibration predicts runs, s; 0 is row by row.

    Logs with a median distance of rows below 1 s take `FINE_TICK_S`.
    """
    closest_s = min(float(np.median(run.frames.dt_s[1:])) if len(run.frames) > 1 else 0.0 for run in runs)
    return FINE_TICK_S if closest_s < FINE_TICK_S / 2 else 0.0


def ticks_of(run: Run, tick_s: float = TICK_S) -> Ticks:
    """Return a run cut into ticks; a tick without a row does not exist.

    Args:
        run: The prepared log.
        tick_s: Length of a tick, s, a whole part of 30 s.
    """
    frames = run.frames
    since_s = frames.time_s - frames.time_s[0]
    number = np.maximum(np.ceil(since_s / tick_s - 1e-9).astype(np.int64) - 1, 0)
    first = np.flatnonzero(np.diff(number, prepend=-1))
    number = number[first]
    length_s = np.add.reduceat(frames.dt_s, first)
    means, mean = np.unique(number // round(BLOCK_S / tick_s), return_inverse=True)
    per_tick = np.add.reduceat(run.usable, first, axis=0, dtype=float)
    total = np.add.reduceat(np.where(run.usable, run.values_degC, 0.0), first, axis=0)
    begin_s = since_s[first] - frames.dt_s[first]
    came_s = np.add.reduceat(np.where(run.usable, since_s[:, None], 0.0), first, axis=0)
    middle_s = np.where(per_tick > 0, came_s / np.maximum(per_tick, 1.0) - begin_s[:, None], 0.0)
    starts = np.flatnonzero(np.diff(mean, prepend=-1))
    count = np.add.reduceat(per_tick, starts, axis=0)
    with np.errstate(invalid="ignore", divide="ignore"):
        measured = np.add.reduceat(total, starts, axis=0) / count
        share = np.where(count[mean] > 0, per_tick / np.maximum(count[mean], 1.0), 0.0)
    return Ticks(
        first=first,
        length_s=length_s,
        mean=mean,
        count=count,
        measured_degC=measured,
        time_s=(means + 1) * BLOCK_S,
        share=share,
        late=middle_s / np.maximum(length_s, 1e-9)[:, None] - 0.5,
        at_end=length_s > 1.5 * tick_s,
    )


def means_of(ticks: Ticks, rows: Means, ripple_K: FloatArray) -> FloatArray:
    """Return the predicted half-minute means, (b, s).

    Args:
        ticks: Ticks of the run.
        rows: Output rows of the ticks, (T, s).
        ripple_K: Contribution of passing nuts to them, K, (T, s).
    """
    tick_means = rows.means + ticks.late * rows.way + ripple_K
    out = np.zeros_like(ticks.measured_degC)
    np.add.at(out, ticks.mean, np.where(ticks.at_end[:, None], rows.ends, tick_means) * ticks.share)
    return out


def rows_of(run: Run) -> Ticks:
    """Return a run with each row as a tick, and its blocks as the means."""
    rows = np.arange(len(run.frames))
    mean = np.repeat(np.arange(len(run.first)), np.diff([*run.first, len(rows)]))
    number = np.floor((run.frames.time_s[run.first] - run.frames.time_s[0]) / BLOCK_S)
    return Ticks(
        first=rows,
        length_s=run.frames.dt_s,
        mean=mean,
        count=run.count,
        measured_degC=run.measured_degC,
        time_s=(number + 1) * BLOCK_S,
        share=run.usable / np.maximum(run.count[mean], 1.0),
        late=np.zeros(run.usable.shape),
        at_end=np.ones(len(rows), dtype=bool),
    )


def _refuse_empty(config: Config, frames: FrameBlock, name: str) -> None:
    """Raise `LogError` where an input of a heat law has no value throughout: that would read as no heat."""
    inputs = [c for s in config.source for c in (s.speed_channel, s.nut_speed_channel, s.power_channel)]
    for channel in dict.fromkeys(c for c in inputs if c is not None):
        if not np.isfinite(frames.values[:, frames.channels.index(channel)]).any():
            raise LogError(
                f"{name}: {channel}, an input of a heat law, has no value; fix that column of the log"
            )


def frozen(y_degC: FloatArray, rejected: BoolArray) -> BoolArray:
    """Return which values belong to a stretch of equal ones that was later rejected, (K, s).

    A stuck sensor is detected only after a while. In a log, the values before that can be rejected as well.

    Args:
        y_degC: Readings, °C, (K, s), NaN without one.
        rejected: True for readings that a check has rejected, (K, s).
    """
    out = np.zeros_like(rejected)
    for s, column in enumerate(y_degC.T):
        finite = np.flatnonzero(np.isfinite(column))
        stretch = np.cumsum(np.diff(column[finite], prepend=np.nan) != 0.0)
        rejected_stretches = np.unique(stretch[rejected[finite, s]])
        out[finite, s] = np.isin(stretch, rejected_stretches)
    return out


def joined(blocks: Sequence[FrameBlock]) -> FrameBlock:
    """Return consecutive blocks of frames as one; they must have the same channels and nuts."""
    if len(blocks) == 1:
        return blocks[0]
    path = {}
    for name in blocks[0].path:
        parts = [b.path[name] for b in blocks]
        ends = np.cumsum([0] + [len(p.time_s) for p in parts])
        offsets = [p.offset[1:] + end for p, end in zip(parts, ends[:-1], strict=True)]
        path[name] = NutPath(
            np.concatenate([p.time_s for p in parts]),
            np.concatenate([p.position_m for p in parts]),
            np.concatenate([parts[0].offset[:1], *offsets]),
            np.concatenate([p.driven_m_s for p in parts]),
            np.concatenate([p.speed_age_s for p in parts]),
        )
    arrays = {key: np.concatenate([getattr(b, key) for b in blocks]) for key in _ROWS}
    return FrameBlock(channels=blocks[0].channels, path=path, **arrays)


def tail(frames: FrameBlock, begin: int) -> FrameBlock:
    """Return the frames from row `begin` on, with a first step of 0 s."""
    return frames if begin == 0 else part(frames, begin, len(frames))


def thinned(frames: FrameBlock, every_s: float) -> FrameBlock:
    """Return frames at least some time apart, as a service with that period makes them of the same readings.

    The paths of nuts keep all their samples. A value is that of the last row, and fresh where one of the rows
    brought one.

    Args:
        frames: Frames of a log. Rows farther apart are returned unchanged.
        every_s: Least time between two rows, s.
    """
    number = np.floor((frames.time_s - frames.time_s[0]) / every_s + 1e-6)
    last = np.flatnonzero(np.diff(number, append=np.inf))
    if len(last) == len(frames):
        return frames
    path = {name: p._replace(offset=p.offset[np.append(0, last + 1)]) for name, p in frames.path.items()}
    arrays = {key: getattr(frames, key)[last] for key in _ROWS}
    first = np.append(0, last[:-1] + 1)
    arrays["fresh"] = np.logical_or.reduceat(frames.fresh, first, axis=0)
    arrays["dt_s"] = np.add.reduceat(frames.dt_s, first)
    arrays["dt_s"][0] = 0.0
    return FrameBlock(channels=frames.channels, path=path, **arrays)


def without_rows(frames: FrameBlock, doubtful: BoolArray) -> FrameBlock:
    """Return the frames without some rows; these become an outage, and nuts' paths lack their samples.

    Args:
        frames: Frames of a log.
        doubtful: True for the rows to leave out, (K,).
    """
    rows = np.flatnonzero(~doubtful)
    path = {}
    for name, p in frames.path.items():
        count = np.diff(p.offset)
        sample = np.flatnonzero(np.repeat(~doubtful, count)) + p.offset[0]
        offset = np.append(0, np.cumsum(count[rows]))
        columns = {key: getattr(p, key)[sample] for key in p._fields if key != "offset"}
        path[name] = p._replace(offset=offset, **columns)
    arrays = {key: getattr(frames, key)[rows] for key in _ROWS}
    arrays["dt_s"] = np.diff(arrays["time_s"], prepend=arrays["time_s"][:1])
    return FrameBlock(channels=frames.channels, path=path, **arrays)


def part(frames: FrameBlock, begin: int, end: int) -> FrameBlock:
    """Return some rows of a log as copies, with a first step of 0 s.

    Args:
        frames: Frames of a log.
        begin: The first row.
        end: The row behind the last one.
    """
    path = {name: p._replace(offset=p.offset[begin : end + 1].copy()) for name, p in frames.path.items()}
    arrays = {key: getattr(frames, key)[begin:end].copy() for key in _ROWS}
    arrays["dt_s"][:1] = 0.0
    return FrameBlock(channels=frames.channels, path=path, **arrays)


_ROWS = ("time_s", "dt_s", "values", "fresh", "quality", "age_s")


FAR_APART_S = 15.0
"""Rows closer together than this show a nut's path."""
LEAST_LEAD_M = 1e-3
"""Least lead of any ball screw."""
SAME_SPEED = 0.03
"""Largest change of the speed from row to row within a stretch, as a part of the largest speed."""
FEWEST = 4
"""Least number of rows to identify a stroke."""
FEWEST_TURNS, CREEPS = 4, 0.02
"""Least number of turns that even and odd rows show together, for a stroke to be visible.

The second number is the largest distance between rows that counts as no step, relative to the whole range.
"""
TRAVERSES, PER_TRAVERSE = 6, 24
"""Traverses between two rows where the path is unknown, and points on each.

The number of traverses is even, so that both ends of the stroke are equally frequent.
"""


def filled(frames: FrameBlock, config: Config) -> FrameBlock:
    """Return the frames of a log with the paths of nuts that its rows cannot show filled in.

    Logs with rows closer than `FAR_APART_S` are returned unchanged. So is a nut without a speed channel, or
    with a known speed and lead.

    Args:
        frames: Frames of a whole log.
        config: The machine, for the channels and the length of the screw.
    """
    paths = dict(frames.path)
    if len(frames) < FEWEST or np.median(frames.dt_s[1:]) < FAR_APART_S:
        return frames
    for source in config.source:
        name = source.position_channel
        if name not in paths or len(paths[name].time_s) != len(frames) or source.speed_channel is None:
            continue
        if driven(paths[name]):
            continue
        speed_rpm = np.abs(np.nan_to_num(frames.values[:, frames.channels.index(source.speed_channel)]))
        paths[name] = _to_and_fro(paths[name], frames.dt_s, speed_rpm, config.screw.length_m)
    return replace(frames, path=paths)


def driven(path: NutPath) -> bool:
    """Return whether a path is known between its samples.

    With the screw's speed and the lead it is followed to the ends of the stroke and back (see
    `kernels.path`).
    """
    return bool(np.isfinite(path.driven_m_s).any())


def _to_and_fro(path: NutPath, dt_s: FloatArray, speed_rpm: FloatArray, length_m: float) -> NutPath:
    """The path with traverses inserted between samples too far apart to follow it."""
    ends = np.full((len(path.time_s), 2), np.nan)
    for part in stretches_of_a_speed(speed_rpm):
        own_m, whole_m = path.position_m[part], path.position_m
        low, high = float(whole_m.min()), float(whole_m.max())
        if shows_ends(own_m, high - low):
            beyond_m = float(np.ptp(own_m)) / (len(own_m) - 1)  # K of even chance span (K − 1)/(K + 1) of it
            low = max(float(own_m.min()) - beyond_m, 0.0)
            high = min(float(own_m.max()) + beyond_m, length_m)
        gone_m = speed_rpm[part].min() / 60.0 * LEAST_LEAD_M * float(np.median(dt_s[part]))
        if low < high and gone_m > 0.5 * length_m:
            ends[part] = low, high
    time_s, place_m = [path.time_s[:1]], [path.position_m[:1]]
    for k in range(1, len(path.time_s)):
        times, places = path.time_s[k : k + 1], path.position_m[k : k + 1]
        if np.isfinite(ends[k]).all() and path.time_s[k] > path.time_s[k - 1]:
            turns = np.tile(ends[k][::-1], TRAVERSES)[:TRAVERSES]
            way_m = np.concatenate([path.position_m[k - 1 : k], turns, places])
            gone_m = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(way_m)))])
            at_m = np.linspace(0.0, gone_m[-1], TRAVERSES * PER_TRAVERSE + 1)[1:]
            times = path.time_s[k - 1] + (path.time_s[k] - path.time_s[k - 1]) * at_m / gone_m[-1]
            places = np.interp(at_m, gone_m, way_m)
        time_s.append(times)
        place_m.append(places)
    offset = path.offset[0] + np.cumsum([0, *(len(t) for t in time_s)])
    every_s = np.concatenate(time_s)
    unknown = np.full(len(every_s), np.nan)
    return NutPath(every_s, np.concatenate(place_m), offset, unknown, unknown)


def shows_ends(place_m: FloatArray, whole_m: float) -> bool:
    """Return whether a nut's places, of rows far apart, reach about as far as the nut itself.

    As under a stroboscope, rows may meet the nut at the same place each time, or at two in turn. The nut then
    seems to stand or to creep and hardly ever turns in every second row.

    Args:
        place_m: Places at one speed, m, (K,).
        whole_m: Range of the places in the whole log, m.
    """
    turns = 0
    for every_other_m in (place_m[::2], place_m[1::2]):
        steps_m = np.diff(every_other_m)
        senses = np.sign(steps_m[np.abs(steps_m) > CREEPS * whole_m])
        turns += int(np.count_nonzero(np.diff(senses)))
    return turns >= FEWEST_TURNS


def stretches_of_a_speed(speed_rpm: FloatArray) -> Iterator[NDArray[np.int64]]:
    """Yield the rows of each stretch of at least four rows in which a nut runs at one speed.

    Args:
        speed_rpm: Speed in each row, rpm, (K,), not negative.
    """
    new = np.abs(np.diff(speed_rpm, prepend=speed_rpm[0])) > SAME_SPEED * speed_rpm.max()
    for part in np.split(np.arange(len(speed_rpm)), np.flatnonzero(new)):
        if len(part) >= FEWEST and speed_rpm[part].min() > 0.0:
            yield part
