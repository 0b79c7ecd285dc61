"""Where a nut turns round: the ends of the stroke it really makes, and its columns while it stands there.

The stroke of the configuration is the longest; a machine may run over part of it. The ends are the extremes
of the sampled positions over the last one to two minutes.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numba
import numpy as np
from numpy.typing import NDArray

from observer.frames import FloatArray
from observer.model.rod import moving
from observer.model.rod.moving import NutTable

WINDOW_S = 60.0
LEAST_SAMPLES = 20.0


@dataclass(frozen=True, slots=True)
class TurnState:
    """The extremes of a nut's positions: `current` of the window since `since_s` with its number of samples,
    and `before` of the one before it, each (low, high) in m, NaN while not known.
    """

    current_m: tuple[float, float]
    before_m: tuple[float, float]
    since_s: float
    samples: float


def start() -> TurnState:
    """Return the state before the first position is known."""
    return TurnState((np.nan, np.nan), (np.nan, np.nan), np.nan, 0.0)


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
    scalars = np.array([*state.current_m, *state.before_m, state.since_s, state.samples])
    ends_m = np.empty((len(dt_s), 2))
    _follow(scalars, *path, ends_m)
    B, C = np.empty((len(dt_s), len(table.mean_B))), np.empty((len(dt_s), len(table.mean_C)))
    new = np.flatnonzero(np.append(True, np.any(ends_m[1:] != ends_m[:-1], axis=1)))
    for begin, end in itertools.pairwise([*new.tolist(), len(dt_s)]):
        known = np.isfinite(ends_m[begin, 0])
        own = moving.standing(table, ends_m[begin].tolist()) if known else (table.mean_B, table.mean_C)
        B[begin:end], C[begin:end] = own
    low, high, low_before, high_before, since_s, samples = (float(value) for value in scalars)
    return TurnState((low, high), (low_before, high_before), since_s, samples), B, C


@numba.njit(cache=True)
def _follow(scalars, sample_s, sample_m, offset, ends_m):  # type: ignore[no-untyped-def]
    """Fill in the extremes known at each step, (K, 2); `scalars` is the state, changed in place."""
    for k in range(len(ends_m)):
        for i in range(offset[k], offset[k + 1]):
            position, first = sample_m[i], np.isnan(scalars[0])
            if first or (sample_s[i] - scalars[4] >= WINDOW_S and scalars[5] >= LEAST_SAMPLES):
                scalars[2] = position if first else scalars[0]
                scalars[3] = position if first else scalars[1]
                scalars[0], scalars[1], scalars[4], scalars[5] = position, position, sample_s[i], 0.0
            scalars[0], scalars[1] = min(scalars[0], position), max(scalars[1], position)
            scalars[5] += 1.0
        ends_m[k, 0], ends_m[k, 1] = min(scalars[0], scalars[2]), max(scalars[1], scalars[3])
