"""Streams of readings and ticks as a plant might deliver them, for the tests of alignment and recording."""

import math
from pathlib import Path

import numpy as np
from hypothesis import strategies as st

from observer.align.aligner import Aligner, AlignPlan, Position
from observer.align.plausibility import ChannelKind, Limits
from observer.frames import FrameBlock, Reading
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
            recording += f"{frames[-1].time_s[0].item()!r},{',' * len(channels)}1,,\n".encode()
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
