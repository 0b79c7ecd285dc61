"""The nut's motion: to and fro between two ends at constant speed, and where its heat falls meanwhile."""

from __future__ import annotations

import math

import numba
import numpy as np

from tests.truth.machine.compiling import cached
from tests.truth.machine.physics import FloatArray


@numba.njit
def _covered(length_m: float, beyond_m: float) -> float:
    """∫ of the covered length over a path: ∫_{-∞}^{u} clip(v, 0, length) dv."""
    if beyond_m <= 0.0:
        return 0.0
    if beyond_m < length_m:
        return 0.5 * beyond_m * beyond_m
    return length_m * (beyond_m - 0.5 * length_m)


@numba.njit
def spread(
    share: FloatArray, weight: float, from_m: float, to_m: float, nut_m: float, slice_m: float
) -> None:
    """Add `weight` × the mean over a straight path of the nut's uniform footprint, exactly, to each slice."""
    low_m, high_m = min(from_m, to_m), max(from_m, to_m)
    half_m, path_m = 0.5 * nut_m, high_m - low_m
    first = max(math.floor((low_m - half_m) / slice_m), 0)
    last = min(math.floor((high_m + half_m) / slice_m), len(share) - 1)
    below = 0.0
    for i in range(first, last + 1):
        edge_m = (i + 1) * slice_m
        if path_m > 1e-9:
            area = _covered(nut_m, edge_m - low_m + half_m) - _covered(nut_m, edge_m - high_m + half_m)
            above = area / (path_m * nut_m)
        else:
            above = min(max((edge_m - low_m + half_m) / nut_m, 0.0), 1.0)
        share[i] += weight * (above - below)
        below = above


@numba.njit
def next_stop(position_m: float, upward: bool, low_m: float, high_m: float) -> float:
    """Where the present leg ends: at the middle of the stroke, where friction may change, or at an end."""
    middle_m = 0.5 * (low_m + high_m)
    if upward:
        return middle_m if position_m < middle_m else high_m
    return middle_m if position_m > middle_m else low_m


@numba.njit
def travel(
    position_m: float,
    upward: bool,
    distance_m: float,
    low_m: float,
    high_m: float,
    nut_m: float,
    slice_m: float,
    under: FloatArray,
    climb: FloatArray,
) -> tuple[float, bool]:
    """Move the nut; add to `under` the share of the step it spends over each slice, (slices,).

    `climb`: the part of `under` spent climbing the upper half of the stroke. A nut outside a new stroke first
    drives into it. Returns where it is and whether it moves upward.
    """
    if distance_m <= 0.0:
        spread(under, 1.0, position_m, position_m, nut_m, slice_m)
        return position_m, upward
    middle_m, left_m = 0.5 * (low_m + high_m), distance_m
    while left_m > 1e-12:
        if position_m >= high_m:
            upward = False
        elif position_m <= low_m:
            upward = True
        stop_m = next_stop(position_m, upward, low_m, high_m)
        leg_m = min(left_m, abs(stop_m - position_m))
        to_m = position_m + leg_m if upward else position_m - leg_m
        if leg_m == abs(stop_m - position_m):
            to_m = stop_m
        spread(under, leg_m / distance_m, position_m, to_m, nut_m, slice_m)
        if upward and position_m >= middle_m:
            spread(climb, leg_m / distance_m, position_m, to_m, nut_m, slice_m)
        position_m = to_m
        left_m -= leg_m
    return position_m, upward


@cached()
def positions_at(
    time_s: FloatArray,
    step_s: float,
    start_m: float,
    travel_m_s: FloatArray,
    low_m: FloatArray,
    high_m: FloatArray,
) -> FloatArray:
    """Where the nut is at any increasing times, (n,), for speeds and strokes (K,) of equal steps."""
    unused = np.zeros(1)
    out = np.empty(len(time_s))
    position_m, upward, now_s, step = start_m, True, 0.0, 0
    for n in range(len(time_s)):
        while True:
            end_s = min((step + 1) * step_s, time_s[n])
            distance_m = travel_m_s[step] * max(end_s - now_s, 0.0)
            position_m, upward = travel(
                position_m, upward, distance_m, low_m[step], high_m[step], 0.01, 1e3, unused, unused
            )
            now_s = end_s
            if step + 1 < len(travel_m_s) and time_s[n] >= (step + 1) * step_s:
                step += 1
                if time_s[n] > step * step_s:
                    continue
            break
        out[n] = position_m
    return out
