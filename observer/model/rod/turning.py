"""Where a nut turns round: the ends of the stroke it really makes, and its columns while it stands there.

The stroke of the configuration is the longest; a machine may run over part of it. The ends are the places of
the last reversal on either side, found as the folded path finds them.
"""

from __future__ import annotations

import itertools
from dataclasses import astuple, dataclass

import numba
import numpy as np
from numpy.typing import NDArray

from observer.frames import FloatArray
from observer.model.rod import moving
from observer.model.rod.moving import NutTable


@dataclass(frozen=True, slots=True)
class TurnState:
    """What is remembered of a nut: last sample, velocity over the step to it (0 unless at full speed), recent
    largest speed, and the places `low_m`, `high_m` where it turned last, NaN while not known.
    """

    time_s: float
    position_m: float
    velocity_m_s: float
    speed_m_s: float
    low_m: float
    high_m: float


def start() -> TurnState:
    """Return the state before the first position is known."""
    return TurnState(np.nan, np.nan, 0.0, 0.0, np.nan, np.nan)


def columns(
    table: NutTable,
    state: TurnState,
    dt_s: FloatArray,
    path: tuple[FloatArray, FloatArray, NDArray[np.int64]],
) -> tuple[TurnState, FloatArray, FloatArray]:
    """Return the columns of a nut that stands at both ends of its stroke for equal times.

    `path` is the samples' time, position and offset (K+1,) as in `FrameBlock`. Returns the state after the
    last step, the input columns (K, n_x) and the output columns of the source's lag (K, R); those of the
    nut spread over its stroke while no position is known.
    """
    scalars = np.array(astuple(state))
    ends_m = np.empty((len(dt_s), 2))
    _follow(scalars, *path, ends_m)
    B, C = np.empty((len(dt_s), len(table.mean_B))), np.empty((len(dt_s), len(table.mean_C)))
    new = np.flatnonzero(np.append(True, np.any(ends_m[1:] != ends_m[:-1], axis=1)))
    for begin, end in itertools.pairwise([*new.tolist(), len(dt_s)]):
        known = np.isfinite(ends_m[begin]).all()
        own = moving.standing(table, ends_m[begin].tolist()) if known else (table.mean_B, table.mean_C)
        B[begin:end], C[begin:end] = own
    time_s, position_m, velocity_m_s, speed_m_s, low_m, high_m = scalars.tolist()
    return TurnState(time_s, position_m, velocity_m_s, speed_m_s, low_m, high_m), B, C


@numba.njit(cache=True)
def _follow(scalars, sample_s, sample_m, offset, ends_m):  # type: ignore[no-untyped-def]
    """Note where the nut turns; `scalars` are those of `TurnState`, in its order."""
    for k in range(len(ends_m)):
        for i in range(offset[k], offset[k + 1]):
            since_s, before = sample_s[i] - scalars[0], scalars[2]
            if since_s > 0.0:
                fade = np.exp(-since_s / (2 * moving.MEMORY_S))
                scalars[3] = max(scalars[3] * fade, abs(sample_m[i] - scalars[1]) / since_s)
                turn_m = moving.turn(scalars, sample_m[i], since_s)
                if before * scalars[2] < 0.0:
                    if turn_m == sample_m[i]:  # it turned at the sample before
                        turn_m = scalars[1]
                    scalars[4 if before < 0.0 else 5] = turn_m
            scalars[0], scalars[1] = sample_s[i], sample_m[i]
        ends_m[k, 0], ends_m[k, 1] = scalars[4], scalars[5]
