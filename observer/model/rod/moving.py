"""A nut that moves: its input and output columns, averaged over the path inside a step.

A nut crosses its stroke in seconds. Where the samples of its position tell its path (see `path`), the heat is
spread along it, reversals included: straight lines between samples would cut them off, and read 20–36 % too
little heat. Where they do not, the footprint at the sampled points alone, averaged over about 20 s, is the
better account: short against diffusion between sensors, long against a traverse. Across a gap of more than
ten seconds of which nothing is known the nut counts as spread over its stroke.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from observer.compiled import cached_call, cached_loop
from observer.frames import FloatArray, NutPath
from observer.model.rod.path import MEMORY_S, SAMPLES_PER_TRAVERSE, PathState, advance, on_the_way

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

    def of_lag(self) -> NutTable:
        """The table of the lag's output column alone, for a plant without modes."""
        none = np.zeros(0)
        return replace(self, mu_1_m=none, phase=none, scale=none, lag=0, mean_B=np.zeros(1))


@dataclass(frozen=True, slots=True)
class NutState:
    """What is remembered of a nut between steps.

    Its motion; the columns in force, `B` (n_x,), `C` (R,); and the fading sums `sum_B`, `sum_C` of the
    footprints of the last seconds, with their `weight_s`.
    """

    path: PathState
    weight_s: float
    B: FloatArray
    C: FloatArray
    sum_B: FloatArray
    sum_C: FloatArray


def start(table: NutTable) -> NutState:
    """Return the state before the first position is known."""
    B, C = table.mean_B.copy(), table.mean_C.copy()
    return NutState(PathState(), 0.0, B, C, np.zeros_like(B), np.zeros_like(C))


def columns(
    table: NutTable, state: NutState, dt_s: FloatArray, path: NutPath
) -> tuple[NutState, FloatArray, FloatArray]:
    """Average the nut's columns over K steps.

    Returns the state after the last step, the input columns (K, n_x) and the output columns of the source's
    lag (K, R).
    """
    scalars, weight_s = state.path.scalars, np.array([state.weight_s])
    B, C, sum_B, sum_C = state.B.copy(), state.C.copy(), state.sum_B.copy(), state.sum_C.copy()
    out_B, out_C = np.empty((len(dt_s), len(B))), np.empty((len(dt_s), len(C)))
    _average(
        scalars, weight_s, B, C, sum_B, sum_C, dt_s, *path, out_B, out_C, table.mu_1_m, table.phase,
        table.scale, table.conductance_W_m, table.nut_m, table.screw_m, table.stroke_m, table.lag,
        table.lag_decay_1_s, table.table_C, table.mean_B, table.mean_C,
    )  # fmt: skip
    return NutState(PathState.of(scalars), float(weight_s[0]), B, C, sum_B, sum_C), out_B, out_C


def columns_at(table: NutTable, places_m: Sequence[float]) -> tuple[FloatArray, FloatArray]:
    """Return the columns (n_x,), (R,) of a nut that stands at each of some places for equal times."""
    B, C = table.mean_B.copy(), np.zeros_like(table.mean_C)
    B[: len(table.mu_1_m)] = 0.0
    for place_m in places_m:
        _add(
            B, C, 1.0 / len(places_m), place_m, table.mu_1_m, table.phase, table.scale,
            table.conductance_W_m, table.nut_m, table.screw_m, table.table_C,
        )  # fmt: skip
    return B, C


@cached_call
def _average(  # type: ignore[no-untyped-def]
    scalars, weight_s, B, C, sum_B, sum_C, dt_s, sample_s, sample_m, offset, driven_m_s, out_B, out_C,
    mu, phase, scale, kA, nut_m, screw_m, stroke_m, lag, lag_decay, table_C, mean_B, mean_C,
):  # fmt: skip
    """Advance the averaged columns B, C through K steps; `scalars` are those of `PathState`, in its order."""
    step_B, step_C = np.empty_like(B), np.empty_like(C)
    for k in range(len(dt_s)):
        step_B[:] = 0.0
        step_C[:] = 0.0
        weight, gap_s, told = 0.0, 0.0, True
        for i in range(offset[k], offset[k + 1]):
            here_m, there_m, since_s = scalars[1], sample_m[i], sample_s[i] - scalars[0]
            before, low_m, high_m = scalars[2], scalars[4], scalars[5]
            turn_m = advance(scalars, sample_s[i], there_m, driven_m_s[i], stroke_m)
            runs_on = np.isnan(turn_m) and since_s > 0.0 and before != 0.0 and scalars[4] < scalars[5]
            run_m = np.sign(before) * scalars[3] * since_s
            if abs(run_m) > 4 * stroke_m:  # it has been everywhere equally long
                run_m = 2 * (high_m - low_m)
            if np.isnan(turn_m) and not runs_on:
                told, here_m, turn_m = False, there_m, there_m
                gap_s = max(gap_s, since_s)
            share = max(since_s, 1e-6) if since_s > 0.0 else 1e-6
            weight += share
            out_m, back_m = abs(turn_m - here_m), abs(there_m - turn_m)
            length_m = abs(run_m) if runs_on else out_m + back_m
            points = 1 + int(length_m / (nut_m / 4))
            for j in range(points):
                part = (j + 0.5) / points
                if runs_on:
                    centre, _ = on_the_way(here_m, run_m * part, low_m, high_m)
                elif part * length_m <= out_m:
                    centre = here_m + part * length_m * np.sign(turn_m - here_m)
                else:
                    centre = turn_m + (part * length_m - out_m) * np.sign(there_m - turn_m)
                _add(step_B, step_C, share / points, centre, mu, phase, scale, kA, nut_m, screw_m, table_C)
        if weight > 0.0:
            share = max(min(dt_s[k], MEMORY_S / 4), 1e-6)  # a longer step says where the nut is after it only
            fade = np.exp(-share / MEMORY_S)
            weight_s[0] = fade * weight_s[0] + share
            # What the dropped modes hold follows the nut as fast as they settle, not at once.
            settle = 1.0 - np.exp(-dt_s[k] * lag_decay)
            spread = gap_s > MEMORY_S
            for n in range(len(mu)):
                sum_B[n] = fade * sum_B[n] + share * step_B[n] / weight
                B[n] = step_B[n] / weight if told else mean_B[n] if spread else sum_B[n] / weight_s[0]
            for r in range(len(C)):
                sum_C[r] = fade * sum_C[r] + share * step_C[r] / weight
                seen = step_C[r] / weight if told else mean_C[r] if spread else sum_C[r] / weight_s[0]
                C[r] += settle * (seen - C[r])
        B[lag] = lag_decay
        out_B[k, :] = B
        out_C[k, :] = C


@cached_loop  # `columns_at` calls it too
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

    "path": samples enough for every traverse; "points": fewer, but they cover the stroke; "undetermined":
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
