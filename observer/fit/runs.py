"""A log made ready for fitting: one run, its 30 s means, and what its screw started from."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from observer.config import Config
from observer.errors import LogError
from observer.fit.sparse import filled
from observer.frames import BoolArray, FloatArray, FrameBlock, NutPath, Quality
from observer.model.build import build_plant
from observer.model.drive import Drive

BLOCK_S = 30.0
START_S = 10.0
LEAST_S = 300.0
"""What the longest log has to last for anything to be fitted."""


@dataclass(frozen=True, slots=True)
class Run:
    """One run of a machine, with nothing in it that depends on the parameters.

    `frames` from the first row on which every known input has a value; `first` (b,) the first row of each
    block of 30 s; `usable`, `values_degC` (K, s); `count` (b, s) how many values each mean has;
    `measured_degC` (b, s), NaN without any; `start_degC`, `start_R_K2` (s,) the mean over the
    first 10 s, and its variance.
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
        """How long the run lasts."""
        return float(self.frames.time_s[-1] - self.frames.time_s[0])

    def means(self, rows: FloatArray) -> FloatArray:
        """Average rows (K, s) over each block's usable samples, (b, s); 0 where there is none."""
        total = np.add.reduceat(np.where(self.usable, rows, 0.0), self.first, axis=0)
        return np.asarray(total / np.maximum(self.count, 1.0))


def mean_over(rows: FloatArray, weight: FloatArray, first: NDArray[np.int64]) -> FloatArray:
    """Return the weighted mean of rows (K,) or (K, c) over stretches that begin at `first` (T,)."""
    over, column = np.add.reduceat(weight, first), (-1, *[1] * (rows.ndim - 1))
    total = np.add.reduceat(rows * weight.reshape(column), first)
    return np.asarray(total / np.where(over > 0, over, 1.0).reshape(column))


def prepare(config: Config, blocks: Sequence[FrameBlock], name: str) -> Run:
    """Return a run from the frames of a log; `name` is named in errors.

    Raises `LogError` where an input or every sensor is without a value throughout.
    """
    frames = joined(blocks)
    _refuse_empty(config, frames, name)
    drive = Drive(config, replace(build_plant(config), moving=()))  # nobody asks here where nuts are
    inputs = drive.run(drive.initial(), frames)[1]
    known = np.flatnonzero(np.isfinite(inputs.z_end).all(axis=1))
    if len(known) == 0:
        raise LogError(f"{name}: the ambient or a prescribed end has no value; add its channel to the log")
    usable = inputs.usable & ~frozen(inputs.y_degC, inputs.quality == int(Quality.REJECTED))
    seen = np.flatnonzero(usable.any(axis=1))
    if len(seen) == 0:
        raise LogError(f"{name}: no sensor has a usable value; check the sensors' channels")
    begin = int(max(known[0], seen[0]))
    frames, usable, y_degC = tail(frames, begin), usable[begin:], inputs.y_degC[begin:]
    block = np.floor((frames.time_s - frames.time_s[0]) / BLOCK_S).astype(np.int64)
    first = np.flatnonzero(np.diff(block, prepend=-1))
    count = np.add.reduceat(usable, first, axis=0, dtype=float)
    total = np.add.reduceat(np.where(usable, y_degC, 0.0), first, axis=0)
    early = frames.time_s <= frames.time_s[0] + START_S
    at_start = np.sum(usable[early], axis=0).astype(float)
    noise_R_K2 = np.array([s.noise_K**2 for s in config.sensor])
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


def _refuse_empty(config: Config, frames: FrameBlock, name: str) -> None:
    """Refuse a log in which what tells a heat is without a value throughout: no heat is another heat."""
    tell = [c for s in config.source for c in (s.speed_channel, s.nut_speed_channel, s.power_channel)]
    for channel in dict.fromkeys(c for c in tell if c is not None):
        if not np.isfinite(frames.values[:, frames.channels.index(channel)]).any():
            raise LogError(
                f"{name}: {channel}, by which heat enters, has no value; mend that column of the log"
            )


def frozen(y_degC: FloatArray, rejected: BoolArray) -> BoolArray:
    """Which values (K, s) belong to a stretch of equal ones that was rejected in the end.

    A sensor is known to be stuck only after a while; a log can be read backwards.
    """
    out = np.zeros_like(rejected)
    for s, own in enumerate(y_degC.T):
        held = np.flatnonzero(np.isfinite(own))
        stretch = np.cumsum(np.diff(own[held], prepend=np.nan) != 0.0)
        found = np.unique(stretch[rejected[held, s]])
        out[held, s] = np.isin(stretch, found)
    return out


def joined(blocks: Sequence[FrameBlock]) -> FrameBlock:
    """Return consecutive blocks of frames as one."""
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
        )
    arrays = {key: np.concatenate([getattr(b, key) for b in blocks]) for key in _ROWS}
    return FrameBlock(channels=blocks[0].channels, path=path, **arrays)


def tail(frames: FrameBlock, begin: int) -> FrameBlock:
    """Return the frames from row `begin` on; its first step has no length."""
    return frames if begin == 0 else part(frames, begin, len(frames))


def part(frames: FrameBlock, begin: int, end: int) -> FrameBlock:
    """Return the frames from row `begin` up to `end`; the first step has no length."""
    path = {name: p._replace(offset=p.offset[begin : end + 1].copy()) for name, p in frames.path.items()}
    arrays = {key: getattr(frames, key)[begin:end].copy() for key in _ROWS}
    arrays["dt_s"][:1] = 0.0
    return FrameBlock(channels=frames.channels, path=path, **arrays)


_ROWS = ("time_s", "dt_s", "values", "fresh", "quality", "age_s")
