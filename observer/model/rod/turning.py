"""A nut's columns while it stands where it turns: at both ends of the stroke that it really makes.

The stroke of the configuration is the longest; a machine may run over part of it.
"""

from __future__ import annotations

import itertools

import numpy as np

from observer.frames import FloatArray, NutPath
from observer.model.rod import moving
from observer.model.rod.moving import NutTable
from observer.model.rod.path import PathState, reversals


def from_unknown(
    table: NutTable, dt_s: FloatArray, path: NutPath, *, at_ends: bool = False
) -> tuple[FloatArray, FloatArray]:
    """Return the columns (K, n_x), (K, R) of a nut of which nothing is known before: averaged along its path,
    or, `at_ends`, as `columns` gives them.
    """
    if at_ends:
        return columns(table, PathState(), dt_s, path)[1:]
    return moving.columns(table, moving.start(table), dt_s, path)[1:]


def columns(
    table: NutTable, state: PathState, dt_s: FloatArray, path: NutPath
) -> tuple[PathState, FloatArray, FloatArray]:
    """Have the nut stand at both ends of its stroke for equal times.

    Returns the state after the last step, the input columns (K, n_x) and the output columns of the source's
    lag (K, R); those of the nut spread over its stroke while the ends are not known.
    """
    state, ends_m = reversals(state, path, table.stroke_m)
    B, C = np.empty((len(dt_s), len(table.mean_B))), np.empty((len(dt_s), len(table.mean_C)))
    spread = (table.turn @ table.mean_B if len(table.turn) else table.mean_B), table.mean_C
    new = np.flatnonzero(np.append(True, np.any(ends_m[1:] != ends_m[:-1], axis=1)))
    for begin, end in itertools.pairwise([*new.tolist(), len(dt_s)]):
        known = np.isfinite(ends_m[begin]).all()
        own = moving.columns_at(table, ends_m[begin].tolist()) if known else spread
        B[begin:end], C[begin:end] = own
    return state, B, C
