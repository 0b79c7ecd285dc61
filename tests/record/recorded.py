"""What a machine did, as a service would have recorded it: readings and ticks, file by file."""

from __future__ import annotations

import math
from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path

import numpy as np

from observer.align.aligner import Aligner, AlignPlan
from observer.frames import FloatArray, FrameBlock, Reading
from observer.record.recorder import header, row_of_reading


def tick_row(time_s: float, channels: Sequence[str]) -> bytes:
    """A tick as a row of a recording."""
    return f"{time_s!r},{',' * len(channels)}1,,\n".encode()


def recorded(
    folder: Path,
    plan: AlignPlan,
    begin_s: float,
    time_s: FloatArray,
    channels: Sequence[str],
    values: FloatArray,
    *,
    rotate_rows: float = math.inf,
    name: str = "rig-x",
) -> list[FrameBlock]:
    """Record rows (n, c) at times (n,) since `begin_s`, each read just before the tick; return what was seen.

    A new file begins after so many rows, as where a file is full.
    """
    aligner, seen, rows, count = Aligner(plan), [], [header(plan.channels)], 0
    first_s = begin_s = float(begin_s)
    for since_s, cells in zip(time_s.tolist(), values.tolist(), strict=True):
        found = {
            c: v for c, v in zip(channels, cells, strict=True) if c in plan.channels and not math.isnan(v)
        }
        used = aligner.ingest(Reading(begin_s + since_s - 0.01, found))
        frame = aligner.tick(begin_s + since_s)
        seen.append(frame)
        rows += [row_of_reading(used, plan.channels), tick_row(float(frame.time_s[0]), plan.channels)]
        count += 1
        if count >= rotate_rows:
            write_file(folder, name, first_s, b"".join(rows))
            rows, count, first_s = [header(plan.channels)], 0, begin_s + since_s
    if count:
        write_file(folder, name, first_s, b"".join(rows))
    return seen


def write_file(folder: Path, name: str, begin_s: float, data: bytes) -> Path:
    """Write a recording that began at a time."""
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / f"{name}-{datetime.fromtimestamp(begin_s, UTC):%Y%m%dT%H%M%SZ}.csv"
    path.write_bytes(data)
    return path


def thinned(time_s: FloatArray, values: FloatArray, step_s: float) -> tuple[FloatArray, FloatArray]:
    """Rows no closer than a step."""
    keep = np.flatnonzero(np.diff(np.floor(time_s / step_s), prepend=-1.0) > 0)
    return time_s[keep], values[keep]
