"""The path of a nut between the samples of its position: how fast it runs, and where it turns.

A nut runs to and fro at an even speed. Where it is sampled often enough, a step that is shorter than the
recent speed makes it holds a reversal, and the missing distance says where. Where a sample comes late, the
nut is taken to have run on between the places where it turned last.
"""

from __future__ import annotations

from dataclasses import astuple, dataclass

import numba
import numpy as np
from numpy.typing import NDArray

from observer.frames import FloatArray

MEMORY_S = 10.0
"""Time constant of what is remembered of a nut's speed (twice this) and footprint."""
SAMPLES_PER_TRAVERSE = 2.5
"""With fewer, some traverses show the full speed once or never; seen on an independent screw."""
FORGOTTEN_S = 3600.0
"""After so long nobody knows what a nut is at."""
FULL = 0.95
"""Part of the recent speed below which a step holds a reversal."""


@dataclass(frozen=True, slots=True)
class PathState:
    """What is remembered of a nut's motion.

    Last sample; velocity over the step to it, 0 unless that was at full speed; recent largest speed; and the
    places `low_m`, `high_m` where it turned last, NaN while not known.
    """

    time_s: float = np.nan
    position_m: float = np.nan
    velocity_m_s: float = 0.0
    speed_m_s: float = 0.0
    low_m: float = np.nan
    high_m: float = np.nan

    @property
    def scalars(self) -> FloatArray:
        """The state as compiled code takes it, (6,)."""
        return np.array(astuple(self))

    @classmethod
    def of(cls, scalars: FloatArray) -> PathState:
        """The state from what compiled code left, (6,)."""
        return cls(*scalars.tolist())


def reversals(
    state: PathState, path: tuple[FloatArray, FloatArray, NDArray[np.int64]], stroke_m: float
) -> tuple[PathState, FloatArray]:
    """Return the state after K steps, and after each the places (K, 2) where the nut turned last, NaN before.

    `path` is the samples' time, position and offset (K+1,) as in `FrameBlock`.
    """
    scalars = state.scalars
    ends_m = np.empty((len(path[2]) - 1, 2))
    _follow(scalars, *path, stroke_m, ends_m)
    return PathState.of(scalars), ends_m


@numba.njit(cache=True)
def _follow(scalars, sample_s, sample_m, offset, stroke_m, ends_m):  # type: ignore[no-untyped-def]
    for k in range(len(ends_m)):
        for i in range(offset[k], offset[k + 1]):
            advance(scalars, sample_s[i], sample_m[i], stroke_m)
        ends_m[k, 0], ends_m[k, 1] = scalars[4], scalars[5]


@numba.njit
def advance(scalars, at_s, there_m, stroke_m):  # type: ignore[no-untyped-def]
    """Take in a sample. Return where the nut turned on its way to it: the sample itself if it came straight,
    NaN if that cannot be told.
    """
    since_s, here_m, before = at_s - scalars[0], scalars[1], scalars[2]
    turn_m = np.nan
    if since_s > 0.0:
        made_m_s = abs(there_m - here_m) / since_s
        told = max(scalars[3], made_m_s) * since_s * SAMPLES_PER_TRAVERSE <= stroke_m
        if told:
            scalars[3] = max(scalars[3] * np.exp(-since_s / (2 * MEMORY_S)), made_m_s)
            turn_m = _turn(scalars, there_m, since_s)
            if before * scalars[2] < 0.0:
                scalars[4 if before < 0.0 else 5] = here_m if turn_m == there_m else turn_m
        elif since_s < FORGOTTEN_S and before != 0.0 and scalars[4] < scalars[5]:
            _, sense = on_the_way(here_m, np.sign(before) * scalars[3] * since_s, scalars[4], scalars[5])
            scalars[2] = sense * np.sign(before) * scalars[3]
        else:
            scalars[2], scalars[3] = 0.0, max(scalars[3] * np.exp(-since_s / (2 * MEMORY_S)), made_m_s)
    scalars[0], scalars[1] = at_s, there_m
    return turn_m


@numba.njit
def on_the_way(here_m, run_m, low_m, high_m):  # type: ignore[no-untyped-def]
    """Where a nut comes that runs so far to and fro between two places, and 1 or −1: whether it then runs as
    at first or back.
    """
    length_m = high_m - low_m
    along = (here_m + run_m - low_m) % (2.0 * length_m)
    back = along > length_m
    turned = np.floor((here_m + run_m - low_m) / length_m) % 2.0 != 0.0
    return low_m + (2.0 * length_m - along if back else along), -1.0 if turned else 1.0


@numba.njit
def _turn(scalars, there_m, since_s):  # type: ignore[no-untyped-def]
    """Where the nut turned on its way from the last sample; the new place itself, if it came straight."""
    here_m, before_m_s, speed_m_s = scalars[1], scalars[2], scalars[3]
    velocity_m_s = (there_m - here_m) / since_s
    if abs(velocity_m_s) >= FULL * speed_m_s or before_m_s == 0.0:
        scalars[2] = velocity_m_s if abs(velocity_m_s) >= FULL * speed_m_s else 0.0
        return there_m
    scalars[2] = -np.sign(before_m_s) * speed_m_s  # it runs back
    onward = speed_m_s * since_s + np.sign(before_m_s) * (there_m - here_m)
    return here_m + np.sign(before_m_s) * 0.5 * onward
