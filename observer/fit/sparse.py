"""Where a nut was between rows that are too far apart to follow it, as far as its places in other rows tell.

A nut that makes traverses between two rows shows itself at places of its stroke as if drawn by lot, or, as
under a stroboscope, creeping: a line from one to the next is not its way. While the speed stays what it is,
the nut is taken to run to and fro between the outermost places it shows.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from observer.config import Config
from observer.frames import FloatArray, FrameBlock, NutPath

FAR_APART_S = 15.0
"""Rows nearer to each other show a nut's way."""
LEAST_LEAD_M = 1e-3
"""A turn of any ball screw moves its nut at least so far."""
SAME_SPEED = 0.03
"""Part of the largest speed by which it may change from row to row."""
FEWEST = 4
"""Rows from which a stroke can be told."""
TRAVERSES, PER_TRAVERSE = 5, 24
"""Of the way between two rows, where it is not known."""


def filled(frames: FrameBlock, config: Config) -> FrameBlock:
    """Return the frames of a log with the ways of nuts that its rows cannot show."""
    paths = dict(frames.path)
    if len(frames) < FEWEST or np.median(frames.dt_s[1:]) < FAR_APART_S:
        return frames
    for source in config.source:
        name = source.position_channel
        if name not in paths or len(paths[name].time_s) != len(frames) or source.speed_channel is None:
            continue
        speed_rpm = np.abs(np.nan_to_num(frames.values[:, frames.channels.index(source.speed_channel)]))
        paths[name] = _to_and_fro(paths[name], frames.dt_s, speed_rpm, config.screw.length_m)
    return replace(frames, path=paths)


def _to_and_fro(path: NutPath, dt_s: FloatArray, speed_rpm: FloatArray, length_m: float) -> NutPath:
    """The path with traverses between samples among which it cannot be followed."""
    ends = np.full((len(path.time_s), 2), np.nan)
    for part in _alike(speed_rpm):
        low, high = float(path.position_m[part].min()), float(path.position_m[part].max())
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
    return NutPath(every_s, np.concatenate(place_m), offset, np.full(len(every_s), np.nan))


def _alike(speed_rpm: FloatArray) -> Iterator[NDArray[np.int64]]:
    """Yield the rows of each stretch of a log throughout which a nut runs at one speed."""
    new = np.abs(np.diff(speed_rpm, prepend=speed_rpm[0])) > SAME_SPEED * speed_rpm.max()
    for part in np.split(np.arange(len(speed_rpm)), np.flatnonzero(new)):
        if len(part) >= FEWEST and speed_rpm[part].min() > 0.0:
            yield part
