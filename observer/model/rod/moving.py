"""A nut that moves: its input and output columns, averaged over the path inside a step.

A nut crosses its stroke in seconds. Where the samples of its position show its path (`reversals`), heat is
spread along it, reversals included: straight lines between samples would cut them off, and read 20–36 % too
little heat. Where they do not, the footprint at the sampled points alone, averaged over about 20 s, is the
better account: short against diffusion between sensors, long against a traverse. Across a gap of more than
ten seconds of which nothing is known the nut counts as spread over its stroke.

A nut runs to and fro. Speed times lead bounds how far it can have gone since the last sample; where that is
not known, its recent speed does. Where samples are close together the path is the line through them. Where
they are sparse, a step shorter than the way it ran holds a reversal, and the missing distance says where.
Where a sample comes late, the nut is taken to have run on between the places where it turned last. Nothing
divides by a time that may be an accident of delivery: two samples a microsecond apart say where the nut is
and nothing of how fast it runs.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Literal, NamedTuple

import numpy as np

from observer.frames import FloatArray, NutPath
from observer.kernels import add_columns, average_columns, follow_path, record
from observer.kernels.layout import Records, packed, state_type
from observer.kernels.path import SAMPLES_PER_TRAVERSE


def no_path_yet() -> Records:
    """Return what is remembered (1,) of a nut's path before its first sample (see `kernels/states.pxd`)."""
    path = np.zeros(1, state_type("PathMemory"))
    for name in ("time_s", "here_m", "low_m", "high_m", "driven_m_s", "far_m"):
        path[name] = np.nan
    return path


def reversals(state: Records, path: NutPath, stroke_m: float) -> tuple[Records, FloatArray]:
    """Return the state after K steps, and after each the places (K, 2) where the nut turned last.

    They are NaN before they are known.
    """
    state, ends_m = state.copy(), np.empty((len(path.offset) - 1, 2))
    follow_path(state, record(path), stroke_m, ends_m)
    return state, ends_m


TABLE_POINTS = 129


@dataclass(frozen=True, slots=True)
class NutTable:
    """Everything the compiled averaging needs of one moving source.

    Shapes: `mu_1_m`, `phase`, `scale` (N,) of the kept modes; `table_C` (P, R), the output column of the
    source's lag with the nut at P evenly spaced centres from 0 to `screw_m`; `mean_B` (n_x,), `mean_C` (R,)
    the columns of the nut spread over its stroke, used before the first position is known. Input columns are
    those of the states x, which `turn` (n_x, n_x) takes to the plant's own, ξ; it is empty where these are x.
    Of a screw with sections the first are those of cosines, more than there are modes, which `turn` makes of
    them: columns are then longer inside than outside.
    """

    mu_1_m: FloatArray
    phase: FloatArray
    scale: FloatArray
    conductance_W_m: float
    nut_m: float
    screw_m: float
    stroke_m: float
    lag: int
    lag_decay_1_s: float
    table_C: FloatArray
    mean_B: FloatArray
    mean_C: FloatArray
    turn: FloatArray = field(default_factory=lambda: np.zeros((0, 0)))

    def _asdict(self) -> dict[str, Any]:
        """Return the fields as kernels take them."""
        return {name: packed(getattr(self, name)) for name in self.__slots__}

    @property
    def states(self) -> int:
        """How many states the columns that come out have."""
        return len(self.turn) or len(self.mean_B)

    def of_lag(self) -> NutTable:
        """The table of the lag's output column alone, for a plant without modes."""
        empty = np.zeros(0)
        return replace(
            self, mu_1_m=empty, phase=empty, scale=empty, lag=0, mean_B=np.zeros(1), turn=np.zeros((0, 0))
        )


@dataclass(frozen=True, slots=True)
class NutState:
    """What is remembered of a nut between steps.

    Its motion; the columns in force, `B` (n_x,), `C` (R,); and the fading sums `sum_B`, `sum_C` of the
    footprints of the last seconds, with their `weight_s`.
    """

    path: Records
    weight_s: float
    B: FloatArray
    C: FloatArray
    sum_B: FloatArray
    sum_C: FloatArray


def start(table: NutTable) -> NutState:
    """Return the state before the first position is known."""
    B, C = table.mean_B.copy(), table.mean_C.copy()
    return NutState(no_path_yet(), 0.0, B, C, np.zeros_like(B), np.zeros_like(C))


class NutDesk(NamedTuple):
    """What is averaged: the state, changed in place, the columns of K steps, and scratch."""

    path: Records
    weight_s: FloatArray
    B: FloatArray
    C: FloatArray
    sum_B: FloatArray
    sum_C: FloatArray
    out_B: FloatArray
    out_C: FloatArray
    step_B: FloatArray
    step_C: FloatArray


def arrays_of(state: NutState) -> dict[str, FloatArray]:
    """Return a state as the first arrays of a desk."""
    weight_s = np.array([state.weight_s])
    return {
        "path": state.path, "weight_s": weight_s, "B": state.B, "C": state.C, "sum_B": state.sum_B,
        "sum_C": state.sum_C,
    }  # fmt: skip


def state_of(desk: NutDesk) -> NutState:
    """Return the state that a desk holds, as copies."""
    return NutState(desk.path.copy(), float(desk.weight_s[0]), *[array.copy() for array in desk[2:6]])


def columns(
    table: NutTable, state: NutState, dt_s: FloatArray, path: NutPath
) -> tuple[NutState, FloatArray, FloatArray]:
    """Average the nut's columns over K steps.

    Returns the state after the last step, the input columns (K, n_x) and the output columns of the source's
    lag (K, R).
    """
    k, B, C = len(dt_s), len(state.B), len(state.C)
    arrays = {name: array.copy() for name, array in arrays_of(state).items()}
    desk = NutDesk(
        **arrays,
        out_B=np.empty((k, table.states)),
        out_C=np.empty((k, C)),
        step_B=np.empty(B),
        step_C=np.empty(C),
    )
    average_columns(record(table), record(desk), dt_s, record(path))
    return state_of(desk), desk.out_B, desk.out_C


def columns_at(table: NutTable, places_m: Sequence[float]) -> tuple[FloatArray, FloatArray]:
    """Return the columns (n_x,), (R,) of a nut that stands at each of some places for equal times."""
    B, C = table.mean_B.copy(), np.zeros_like(table.mean_C)
    B[: len(table.mu_1_m)] = 0.0
    nut = record(table)
    for place_m in places_m:
        add_columns(B, C, 1.0 / len(places_m), place_m, nut)
    return (table.turn @ B if len(table.turn) else B), C


def columns_at_ends(
    table: NutTable, state: Records, dt_s: FloatArray, path: NutPath
) -> tuple[Records, FloatArray, FloatArray]:
    """Have the nut stand at both ends of the stroke that it really makes for equal times.

    The stroke of the configuration is the longest; a machine may run over part of it.

    Returns the state after the last step, the input columns (K, n_x) and the output columns of the source's
    lag (K, R); those of the nut spread over its stroke while the ends are not known.
    """
    state, ends_m = reversals(state, path, table.stroke_m)
    B, C = np.empty((len(dt_s), table.states)), np.empty((len(dt_s), len(table.mean_C)))
    spread = (table.turn @ table.mean_B if len(table.turn) else table.mean_B), table.mean_C
    new = np.flatnonzero(np.append(True, np.any(ends_m[1:] != ends_m[:-1], axis=1)))
    for begin, end in itertools.pairwise([*new.tolist(), len(dt_s)]):
        are_known = np.isfinite(ends_m[begin]).all()
        mean_columns = columns_at(table, ends_m[begin].tolist()) if are_known else spread
        B[begin:end], C[begin:end] = mean_columns
    return state, B, C


def from_unknown(
    table: NutTable, dt_s: FloatArray, path: NutPath, *, at_ends: bool = False
) -> tuple[FloatArray, FloatArray]:
    """Return the columns (K, n_x), (K, R) of a nut of which nothing is known before: averaged along its path,
    or, `at_ends`, as `columns_at_ends` gives them.
    """
    if at_ends:
        return columns_at_ends(table, no_path_yet(), dt_s, path)[1:]
    return columns(table, start(table), dt_s, path)[1:]


PathRegime = Literal["path", "points", "undetermined"]


def judge_path(position_m: FloatArray, stroke_m: float) -> PathRegime:
    """Say how well samples show a nut's path.

    "path": samples enough for every traverse; "points": fewer, but they cover the stroke; "undetermined":
    fewer, and in step with the motion, so that only a few places are ever seen and the footprint is not in
    the log.
    """
    position = position_m[np.isfinite(position_m)]
    jumps = np.abs(np.diff(position))
    moving = jumps > 1e-6 * stroke_m
    if not moving.any() or float(np.quantile(jumps[moving], 0.9)) * SAMPLES_PER_TRAVERSE <= stroke_m:
        return "path"
    visited_m = position[1:][moving]
    bins = np.histogram(visited_m, bins=20, range=(float(visited_m.min()), float(visited_m.max()) + 1e-12))[0]
    return "points" if np.count_nonzero(bins > 0.002 * len(visited_m)) >= 12 else "undetermined"
