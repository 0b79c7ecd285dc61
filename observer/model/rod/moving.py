"""A nut that moves: its input and output columns, averaged over the path inside a step.

A nut crosses its stroke in seconds. Where its position is sampled at least three times a traverse, the heat
is spread along the path between the samples. Straight lines would cut off the reversals (and read 20–36 % too
little heat), so the path is folded: a nut that ran at full speed and then came less far than it should has
turned on the way, and where it turned follows from what is missing. Where the nut is sampled more coarsely
still, the footprint at the sampled points alone, averaged over about 20 s, is the better account: short
against diffusion between sensors, long against a traverse. Across a gap of more than ten seconds the nut
counts as spread over its stroke.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numba
import numpy as np
from numpy.typing import NDArray

from observer.frames import FloatArray

MEMORY_S = 10.0
"""Time constant of the averaged footprint: an exponential memory with the mean age of a 20 s window."""
SAMPLES_PER_TRAVERSE = 3.0
"""Two samples at full speed between two reversals tell the speed, and one more tells the next reversal."""
FULL = 0.95
"""Part of the recent speed below which a step holds a reversal."""
TABLE_POINTS = 129


@dataclass(frozen=True, slots=True)
class NutTable:
    """Everything the compiled averaging needs of one moving source.

    Shapes: `mu_1_m`, `phase`, `scale` (N,) of the kept modes; `table_C` (P, R), the output column of the
    source's lag with the nut at P evenly spaced centres from 0 to `screw_m`; `mean_B` (n_x,), `mean_C` (R,)
    the columns of the nut spread over its stroke, used before the first position is known.
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


@dataclass(frozen=True, slots=True)
class NutState:
    """What is remembered of a nut between steps.

    Last sample; velocity over the step to it, and 0 unless that was at full speed; recent largest speed; the
    columns in force, `B` (n_x,), `C` (R,); and the fading sums `sum_B`, `sum_C` of the footprints of
    the last seconds, with their `weight_s`.
    """

    time_s: float
    position_m: float
    velocity_m_s: float
    speed_m_s: float
    weight_s: float
    B: FloatArray
    C: FloatArray
    sum_B: FloatArray
    sum_C: FloatArray


def start(table: NutTable) -> NutState:
    """Return the state before the first position is known."""
    B, C = table.mean_B.copy(), table.mean_C.copy()
    return NutState(np.nan, np.nan, 0.0, 0.0, 0.0, B, C, np.zeros_like(B), np.zeros_like(C))


def columns(
    table: NutTable,
    state: NutState,
    dt_s: FloatArray,
    path: tuple[FloatArray, FloatArray, NDArray[np.int64]],
) -> tuple[NutState, FloatArray, FloatArray]:
    """Average the nut's columns over K steps.

    `path` is the samples' time, position and offset (K+1,) as in `FrameBlock`. Returns the state after the
    last step, the input columns (K, n_x) and the output columns of the source's lag (K, R).
    """
    scalars = np.array([state.time_s, state.position_m, state.velocity_m_s, state.speed_m_s, state.weight_s])
    B, C, sum_B, sum_C = state.B.copy(), state.C.copy(), state.sum_B.copy(), state.sum_C.copy()
    out_B, out_C = np.empty((len(dt_s), len(B))), np.empty((len(dt_s), len(C)))
    _average(
        scalars, B, C, sum_B, sum_C, dt_s, *path, out_B, out_C, table.mu_1_m, table.phase, table.scale,
        table.conductance_W_m, table.nut_m, table.screw_m, table.stroke_m, table.lag, table.lag_decay_1_s,
        table.table_C, table.mean_B, table.mean_C,
    )  # fmt: skip
    time_s, position_m, velocity_m_s, speed_m_s, weight_s = scalars.tolist()
    return NutState(time_s, position_m, velocity_m_s, speed_m_s, weight_s, B, C, sum_B, sum_C), out_B, out_C


def standing(table: NutTable, places_m: Sequence[float]) -> tuple[FloatArray, FloatArray]:
    """Return the columns (n_x,), (R,) of a nut that stands at each of some places for equal times."""
    B, C = table.mean_B.copy(), np.zeros_like(table.mean_C)
    B[: len(table.mu_1_m)] = 0.0
    for place_m in places_m:
        _add(
            B, C, 1.0 / len(places_m), place_m, table.mu_1_m, table.phase, table.scale,
            table.conductance_W_m, table.nut_m, table.screw_m, table.table_C,
        )  # fmt: skip
    return B, C


@numba.njit(cache=True)
def _average(  # type: ignore[no-untyped-def]
    scalars, B, C, sum_B, sum_C, dt_s, sample_s, sample_m, offset, out_B, out_C,
    mu, phase, scale, kA, nut_m, screw_m, stroke_m, lag, lag_decay, table_C, mean_B, mean_C,
):  # fmt: skip
    """Advance the averaged columns B, C through K steps; `scalars` are those of `NutState`, in its order."""
    step_B, step_C = np.empty_like(B), np.empty_like(C)
    for k in range(len(dt_s)):
        step_B[:] = 0.0
        step_C[:] = 0.0
        along_path = _told(scalars, dt_s[k], sample_s, sample_m, offset[k], offset[k + 1], stroke_m)
        weight, gap_s = 0.0, 0.0
        for i in range(offset[k], offset[k + 1]):
            share, a_m, b_m, turn_m = 1.0, sample_m[i], sample_m[i], sample_m[i]
            if not np.isnan(scalars[1]):
                since_s = sample_s[i] - scalars[0]
                gap_s = max(gap_s, since_s)
                turn_m = turn(scalars, sample_m[i], since_s)
                if along_path:
                    share, a_m = since_s, scalars[1]
                else:
                    turn_m = b_m
            weight += share
            out_m, back_m = abs(turn_m - a_m), abs(b_m - turn_m)
            points = 1 + int((out_m + back_m) / (nut_m / 4))
            for j in range(points):
                run_m = (out_m + back_m) * (j + 0.5) / points
                if run_m <= out_m:
                    centre = a_m + run_m * np.sign(turn_m - a_m)
                else:
                    centre = turn_m + (run_m - out_m) * np.sign(b_m - turn_m)
                _add(step_B, step_C, share / points, centre, mu, phase, scale, kA, nut_m, screw_m, table_C)
            scalars[0], scalars[1] = sample_s[i], sample_m[i]
        if weight > 0.0:
            share = min(dt_s[k], MEMORY_S / 4)  # a longer step knows no more than where the nut is after it
            fade = np.exp(-share / MEMORY_S)
            scalars[4] = fade * scalars[4] + max(share, 1e-6)
            # What the dropped modes hold follows the nut as fast as they settle, not at once.
            settle = 1.0 - np.exp(-dt_s[k] * lag_decay)
            for n in range(len(mu)):
                sum_B[n] = fade * sum_B[n] + max(share, 1e-6) * step_B[n] / weight
                B[n] = step_B[n] / weight if along_path else sum_B[n] / scalars[4]
            for r in range(len(C)):
                sum_C[r] = fade * sum_C[r] + max(share, 1e-6) * step_C[r] / weight
                C[r] += settle * ((step_C[r] / weight if along_path else sum_C[r] / scalars[4]) - C[r])
            if gap_s > MEMORY_S:
                for n in range(len(mu)):
                    B[n] = mean_B[n]
                for r in range(len(C)):
                    C[r] = mean_C[r]
        B[lag] = lag_decay
        out_B[k, :] = B
        out_C[k, :] = C


@numba.njit(cache=True)
def _told(scalars, dt_s, sample_s, sample_m, begin, end, stroke_m):  # type: ignore[no-untyped-def]
    """Bring the recent largest speed up to date; return whether the samples are close enough for a path."""
    speed, gap_s = scalars[3] * np.exp(-dt_s / (2 * MEMORY_S)), 0.0
    time_s, position_m = scalars[0], scalars[1]
    for i in range(begin, end):
        if sample_s[i] > time_s:  # not with the first sample ever
            gap_s = max(gap_s, sample_s[i] - time_s)
            speed = max(speed, abs(sample_m[i] - position_m) / (sample_s[i] - time_s))
        time_s, position_m = sample_s[i], sample_m[i]
    scalars[3] = speed
    return speed * gap_s * SAMPLES_PER_TRAVERSE <= stroke_m


@numba.njit(cache=True)
def turn(scalars, there_m, since_s):  # type: ignore[no-untyped-def]
    """Where the nut turned on its way from the last sample; the new place itself, if it came straight."""
    here_m, before_m_s, speed_m_s = scalars[1], scalars[2], scalars[3]
    if since_s <= 0.0:
        return there_m
    velocity_m_s = (there_m - here_m) / since_s
    if abs(velocity_m_s) >= FULL * speed_m_s or before_m_s == 0.0:
        scalars[2] = velocity_m_s if abs(velocity_m_s) >= FULL * speed_m_s else 0.0
        return there_m
    scalars[2] = -np.sign(before_m_s) * speed_m_s  # it runs back
    onward = speed_m_s * since_s + np.sign(before_m_s) * (there_m - here_m)
    return here_m + np.sign(before_m_s) * 0.5 * onward


@numba.njit(cache=True)
def _add(B, C, share, centre_m, mu, phase, scale, kA, nut_m, screw_m, table_C):  # type: ignore[no-untyped-def]
    """Add `share` of the columns with the nut at one place."""
    centre = min(max(centre_m, 0.0), screw_m)
    a, b = max(centre - nut_m / 2, 0.0), min(centre + nut_m / 2, screw_m)
    middle, half = (a + b) / 2, (b - a) / 2
    for n in range(len(mu)):
        reach = mu[n] * half
        mean = np.sin(reach) / reach if reach > 1e-8 else 1.0
        B[n] += share * scale[n] * np.cos(mu[n] * middle - phase[n]) * mean / kA
    place = centre / screw_m * (len(table_C) - 1)
    low = min(int(place), len(table_C) - 2)
    right = place - low
    for r in range(len(C)):
        C[r] += share * ((1.0 - right) * table_C[low, r] + right * table_C[low + 1, r])


PathRegime = Literal["path", "points", "undetermined"]


def judge_path(position_m: FloatArray, stroke_m: float) -> PathRegime:
    """Say how well samples tell a nut's path.

    "path": at least three samples a traverse; "points": fewer, but they cover the stroke; "undetermined":
    fewer, and in step with the motion, so that only a few places are ever seen and the footprint is not in
    the log.
    """
    position = position_m[np.isfinite(position_m)]
    jumps = np.abs(np.diff(position))
    moving = jumps > 1e-6 * stroke_m
    if not moving.any() or float(np.quantile(jumps[moving], 0.9)) * SAMPLES_PER_TRAVERSE <= stroke_m:
        return "path"
    seen = position[1:][moving]
    bins = np.histogram(seen, bins=20, range=(float(seen.min()), float(seen.max()) + 1e-12))[0]
    return "points" if np.count_nonzero(bins > 0.002 * len(seen)) >= 12 else "undetermined"
