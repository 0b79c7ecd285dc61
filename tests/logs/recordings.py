"""Readings and ticks as a plant might deliver them, and the recordings that a service makes of them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
from hypothesis import strategies as st

from observer.align.aligner import Aligner, AlignPlan, Position
from observer.align.plausibility import ChannelKind, Limits
from observer.frames import FloatArray, FrameBlock, Reading
from observer.record.recorder import header, row_of_reading

CHANNELS = ("t1_degC", "t2_degC", "nut_position_m")
WIDE = np.full(len(CHANNELS), np.inf)  # no limits


def plan(*, expected_s=(0.5, 0.5, 0.02), noise_K=(0.05, 0.05, math.nan), period_s=0.5) -> AlignPlan:
    return AlignPlan(
        CHANNELS,
        (Position(2),),
        np.array(expected_s, float),
        np.array(noise_K, float),
        period_s,
        Limits(
            (ChannelKind.OTHER,) * 3,
            -WIDE,
            WIDE,
            WIDE,
            WIDE,
            WIDE,
            np.zeros(3),
            np.column_stack([-WIDE, WIDE]),
        ),
    )


_values = st.one_of(st.floats(-50, 150), st.sampled_from([math.nan, math.inf, 20.0, -0.0]))
_faults = st.sampled_from(["open_circuit", "timeout", "exception_2", "missing", "", "50%41", 'a=b;c, "d"\n'])
_reading = st.builds(
    Reading,
    st.floats(-0.3, 0.6),  # seconds after the row before: clocks of drivers go back at times
    st.dictionaries(st.sampled_from([*CHANNELS, "unknown"]), _values),
    st.dictionaries(st.sampled_from([*CHANNELS, "unknown"]), _faults, max_size=2),
)
streams = st.lists(st.one_of(_reading, st.floats(-0.1, 2.0)), max_size=60)


def tick_row(time_s: float, channels: Sequence[str]) -> bytes:
    """A tick as a row of a recording."""
    return f"{time_s!r},{',' * len(channels)}1,,\n".encode()


def play(events, aligner: Aligner, channels=CHANNELS) -> tuple[list[FrameBlock], bytes]:
    """Run events through an aligner as the service does; returns its frames and the recording."""
    time_s, frames, recording = 1.8e9, [], header(channels)
    for event in events:
        if isinstance(event, Reading):
            time_s += event.time_s
            used = aligner.ingest(Reading(time_s, event.values, event.faults))
            recording += row_of_reading(used, channels)
        else:
            time_s += event
            frames.append(aligner.tick(time_s))
            recording += tick_row(frames[-1].time_s[0].item(), channels)
    return frames, recording


def joined(blocks: list[FrameBlock]) -> dict[str, np.ndarray]:
    """Blocks as single arrays, paths included; what two runs are compared by."""
    arrays = {
        name: np.concatenate([getattr(block, name) for block in blocks])
        for name in ("time_s", "dt_s", "values", "fresh", "quality", "age_s")
    }
    for channel in blocks[0].path if blocks else ():
        for i, part in enumerate(("time_s", "value")):
            arrays[f"{channel} {part}"] = np.concatenate([block.path[channel][i] for block in blocks])
        counts = [np.diff(block.path[channel][2]) for block in blocks]
        arrays[f"{channel} count"] = np.concatenate(counts)
    return arrays


def same_bits(one: dict[str, np.ndarray], other: dict[str, np.ndarray]) -> bool:
    return one.keys() == other.keys() and all(
        one[name].tobytes() == other[name].tobytes() and one[name].dtype == other[name].dtype for name in one
    )


def write(folder: Path, data: bytes, name: str = "recording.csv") -> Path:
    path = folder / name
    path.write_bytes(data)
    return path


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
