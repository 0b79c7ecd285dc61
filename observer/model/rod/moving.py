"""A moving nut: its input and output columns, averaged over the path inside a step.

A nut crosses its stroke in seconds. If the samples of its position resolve its path (`reversals`), heat is
spread along it, reversals included. Straight lines between samples would cut the reversals off and read
20–36 % too little heat. If the samples do not resolve the path, the footprint at the sampled points is
averaged over about 20 s: short against diffusion between sensors, long against a traverse. During more than
ten seconds without samples the nut counts as spread over its stroke.

A nut runs to and fro. Speed times lead limits its distance since the last sample; without a speed channel,
its recent speed does. Between close samples the path is the line through them. If samples are sparse, a step
shorter than the distance covered contains a reversal, and the missing distance locates it. While a sample is
late, the nut is assumed to run on between its last reversals. The computation never divides by a time that
may be an accident of delivery: two samples a microsecond apart give a position and no speed.
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
    """Return the memory of a nut's path before its first sample, (1,), as in `kernels/states.pxd`."""
    path = np.zeros(1, state_type("PathMemory"))
    for name in ("time_s", "here_m", "low_m", "high_m", "driven_m_s", "far_m"):
        path[name] = np.nan
    return path


def reversals(state: Records, path: NutPath, stroke_m: float) -> tuple[Records, FloatArray]:
    """Follow a nut's path, and return the places where it turned round.

    Args:
        state: Memory of the path.
        path: Samples of K steps.
        stroke_m: Length of the stroke, m.

    Returns:
        The memory after K steps. Places of the last two reversals after each step, m, (K, 2), NaN before
        them.
    """
    state, ends_m = state.copy(), np.empty((len(path.offset) - 1, 2))
    follow_path(state, record(path), stroke_m, ends_m)
    return state, ends_m


TABLE_POINTS = 129


@dataclass(frozen=True, slots=True)
class NutTable:
    """The data of one moving source for the compiled averages.

    Input columns are those of the states x, which `turn` converts to the plant's own, ξ. For a screw with
    sections, the first entries are those of cosines, more than there are modes; `turn` makes the modes of
    them.

    Attributes:
        mu_1_m: Wave numbers of the modes, (N,).
        phase: Their phases, (N,).
        scale: Their amplitudes, (N,).
        conductance_W_m: k A.
        nut_m: Length of the nut.
        screw_m: Length of the screw.
        stroke_m: Length of the stroke.
        lag: Number of the source's lag among the states.
        lag_decay_1_s: Decay rate of that lag.
        table_C: Output column of the lag with the nut at P evenly spaced places along the screw, (P, R).
        mean_B: Input column of the nut spread over its stroke, before the first position, (n_x,).
        mean_C: Output column likewise, (R,).
        turn: Matrix from x to ξ, (n_x, n_x); empty if both are equal.
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
        """Length of the resulting input columns."""
        return len(self.turn) or len(self.mean_B)

    def of_lag(self) -> NutTable:
        """Return the table of the lag's output column alone, for a plant without modes."""
        empty = np.zeros(0)
        return replace(
            self, mu_1_m=empty, phase=empty, scale=empty, lag=0, mean_B=np.zeros(1), turn=np.zeros((0, 0))
        )


@dataclass(frozen=True, slots=True)
class NutState:
    """The state of a nut between steps.

    Attributes:
        path: Memory of its motion.
        weight_s: Weight of the fading sums.
        B: Input column in force, (n_x,).
        C: Output column in force, (R,).
        sum_B: Fading sum of the input columns of the last seconds, (n_x,).
        sum_C: Fading sum of the output columns of the last seconds, (R,).
    """

    path: Records
    weight_s: float
    B: FloatArray
    C: FloatArray
    sum_B: FloatArray
    sum_C: FloatArray


def start(table: NutTable) -> NutState:
    """Return the state before the first position: the nut is spread over its stroke."""
    B, C = table.mean_B.copy(), table.mean_C.copy()
    return NutState(no_path_yet(), 0.0, B, C, np.zeros_like(B), np.zeros_like(C))


class NutDesk(NamedTuple):
    """Arguments of the averages for the kernel.

    Attributes:
        path: Memory of the nut's motion, and then the fields of `NutState`; all are changed in place.
        out_B: Input columns of K steps, (K, n_x).
        out_C: Output columns of K steps, (K, R).
        step_B: Scratch, (n_x,).
        step_C: Scratch, (R,).
    """

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
    """Return a copy of the state in a desk."""
    return NutState(desk.path.copy(), float(desk.weight_s[0]), *[array.copy() for array in desk[2:6]])


def columns(
    table: NutTable, state: NutState, dt_s: FloatArray, path: NutPath
) -> tuple[NutState, FloatArray, FloatArray]:
    """Return the nut's columns averaged over K steps.

    Args:
        table: Table of the nut.
        state: Its state before the steps.
        dt_s: Lengths of the steps, s, (K,).
        path: Samples of its position.

    Returns:
        The state after the last step, the input columns, (K, n_x), and the output columns of the source's
        lag, (K, R).
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
    """Return the columns of a nut that rests at each of some places for equal times.

    Args:
        table: Table of the nut.
        places_m: Positions of its centre, m, at least one.

    Returns:
        Input column, (n_x,), and output column of the source's lag, (R,).
    """
    B, C = table.mean_B.copy(), np.zeros_like(table.mean_C)
    B[: len(table.mu_1_m)] = 0.0
    nut = record(table)
    for place_m in places_m:
        add_columns(B, C, 1.0 / len(places_m), place_m, nut)
    return (table.turn @ B if len(table.turn) else B), C


def columns_at_ends(
    table: NutTable, state: Records, dt_s: FloatArray, path: NutPath
) -> tuple[Records, FloatArray, FloatArray]:
    """Return the columns of a nut that rests at both ends of its actual stroke for equal times.

    The stroke of the configuration is the longest; a machine may run over part of it.

    Args:
        table: Table of the nut.
        state: Memory of its path.
        dt_s: Lengths of the steps, s, (K,).
        path: Samples of its position.

    Returns:
        The memory after the last step, the input columns, (K, n_x), and the output columns of the source's
        lag, (K, R). Before the first reversals, they are those of the nut spread over its stroke.
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
    """Return the columns of a nut from its first sample on.

    Args:
        table: Table of the nut.
        dt_s: Lengths of the steps, s, (K,).
        path: Samples of its position.
        at_ends: Whether the nut rests at the ends of its stroke, as in `columns_at_ends`. Otherwise columns
            are averaged along its path.

    Returns:
        Input columns, (K, n_x), and output columns, (K, R).
    """
    if at_ends:
        return columns_at_ends(table, no_path_yet(), dt_s, path)[1:]
    return columns(table, start(table), dt_s, path)[1:]


PathRegime = Literal["path", "points", "undetermined"]


def judge_path(position_m: FloatArray, stroke_m: float) -> PathRegime:
    """Return how well samples resolve a nut's path.

    Args:
        position_m: Positions in consecutive samples, m, NaN without one.
        stroke_m: Length of the stroke, m.

    Returns:
        "path" with enough samples for every traverse. "points" with fewer that cover the stroke.
        "undetermined" with fewer in step with the motion: they show a few places only, and the log does not
        determine the footprint.
    """
    position = position_m[np.isfinite(position_m)]
    jumps = np.abs(np.diff(position))
    moving = jumps > 1e-6 * stroke_m
    if not moving.any() or float(np.quantile(jumps[moving], 0.9)) * SAMPLES_PER_TRAVERSE <= stroke_m:
        return "path"
    visited_m = position[1:][moving]
    bins = np.histogram(visited_m, bins=20, range=(float(visited_m.min()), float(visited_m.max()) + 1e-12))[0]
    return "points" if np.count_nonzero(bins > 0.002 * len(visited_m)) >= 12 else "undetermined"
