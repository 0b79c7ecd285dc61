"""Conduction in rings × slices, insulated all round: Crank–Nicolson split by direction (Douglas, 1955).

(1 − ½dt A_r)(1 − ½dt A_z) δ = dt (A_r + A_z) T + load, T ← T + δ. Second order, unconditionally stable, and
what is at rest stays at rest: the splitting leaves no error in a steady state. Heat is conserved to rounding,
because both operators only move it.
"""

from __future__ import annotations

from typing import NamedTuple

import numba
import numpy as np

from tests.truth.machine.grid import Grid
from tests.truth.machine.physics import FloatArray


class Factors(NamedTuple):
    """What a step needs, all without units: exchange numbers, and Thomas factors of both operators.

    Rows of `radial`, `axial`: (lower, 1/pivot, upper/pivot).
    """

    number: float  # step × conductance to the next slice / capacity, the same for every ring
    inward: FloatArray  # (rings,) the same with the next ring in; the first is 0
    outward: FloatArray  # (rings,) and out; the last is 0
    per_J: FloatArray  # (rings,) 1/capacity, K/J
    radial: FloatArray  # (rings, 3)
    axial: FloatArray  # (slices, 3)


def factorise(grid: Grid, step_s: float) -> Factors:
    """Factor both operators for one step length."""
    flow = step_s * grid.radial_W_K
    outward = flow / grid.capacity_J_K
    inward = np.concatenate([[0.0], flow[:-1]]) / grid.capacity_J_K
    number = float(step_s * grid.axial_W_K[0] / grid.capacity_J_K[0])
    lower = np.full(grid.slices, -0.5 * number)
    upper = lower.copy()
    lower[0] = upper[-1] = 0.0
    radial = _thomas(-0.5 * inward, -0.5 * outward)
    return Factors(number, inward, outward, 1.0 / grid.capacity_J_K, radial, _thomas(lower, upper))


def _thomas(lower: FloatArray, upper: FloatArray) -> FloatArray:
    """Factors of 1 + a conservative tridiagonal operator with these off-diagonals."""
    out = np.zeros((len(lower), 3))
    ratio = 0.0
    for i in range(len(lower)):
        pivot = 1.0 - lower[i] - upper[i] - lower[i] * ratio
        ratio = upper[i] / pivot
        out[i] = lower[i], 1.0 / pivot, ratio
    return out


@numba.njit
def conduct(field: FloatArray, load_J: FloatArray, change: FloatArray, factors: Factors) -> None:
    """Advance `field` (slices, rings) by one step under a load in J; `change` (slices, rings) is scratch.

    A neighbour beyond an edge is the cell itself: nothing flows.
    """
    slices, rings = field.shape
    radial, axial, number = factors.radial, factors.axial, factors.number
    inward, outward, per_J = factors.inward, factors.outward, factors.per_J
    for i in range(slices):
        above, below = max(i - 1, 0), min(i + 1, slices - 1)
        before = 0.0
        for j in range(rings):
            here = field[i, j]
            gain = number * (field[above, j] + field[below, j] - 2.0 * here) + per_J[j] * load_J[i, j]
            gain += inward[j] * (field[i, max(j - 1, 0)] - here)
            gain += outward[j] * (field[i, min(j + 1, rings - 1)] - here)
            before = (gain - radial[j, 0] * before) * radial[j, 1]
            change[i, j] = before
        for j in range(rings - 2, -1, -1):
            change[i, j] -= radial[j, 2] * change[i, j + 1]
        for j in range(rings):
            change[i, j] = (change[i, j] - axial[i, 0] * change[above, j]) * axial[i, 1]
    for j in range(rings):
        field[slices - 1, j] += change[slices - 1, j]
    for i in range(slices - 2, -1, -1):
        for j in range(rings):
            change[i, j] -= axial[i, 2] * change[i + 1, j]
            field[i, j] += change[i, j]
