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
    """Thomas factors of both one-dimensional operators; row i: (lower, 1/pivot, upper/pivot)."""

    radial: FloatArray  # (rings, 3)
    axial: FloatArray  # (slices, 3)


def factorise(grid: Grid, step_s: float) -> Factors:
    """Factor both operators for one step length."""
    outward = 0.5 * step_s * grid.radial_W_K
    inward = np.concatenate([[0.0], outward[:-1]])
    radial = _thomas(-inward / grid.capacity_J_K, -outward / grid.capacity_J_K)
    number = 0.5 * step_s * grid.axial_W_K[0] / grid.capacity_J_K[0]  # the same for every ring
    lower = np.full(grid.slices, -number)
    upper = lower.copy()
    lower[0] = upper[-1] = 0.0
    return Factors(radial, _thomas(lower, upper))


def _thomas(lower: FloatArray, upper: FloatArray) -> FloatArray:
    """Factors of 1 + a conservative tridiagonal operator with these off-diagonals."""
    out = np.zeros((len(lower), 3))
    ratio = 0.0
    for i in range(len(lower)):
        pivot = 1.0 - lower[i] - upper[i] - lower[i] * ratio
        ratio = upper[i] / pivot
        out[i] = lower[i], 1.0 / pivot, ratio
    return out


@numba.njit(cache=True)
def _inflow_W(field: FloatArray, i: int, j: int, grid: Grid) -> float:
    """Heat into a cell from its neighbours."""
    here, flow_W = field[i, j], 0.0
    if i > 0:
        flow_W += grid.axial_W_K[j] * (field[i - 1, j] - here)
    if i < grid.slices - 1:
        flow_W += grid.axial_W_K[j] * (field[i + 1, j] - here)
    if j > 0:
        flow_W += grid.radial_W_K[j - 1] * (field[i, j - 1] - here)
    if j < grid.rings - 1:
        flow_W += grid.radial_W_K[j] * (field[i, j + 1] - here)
    return flow_W


@numba.njit(cache=True)
def conduct(
    field: FloatArray, load_J: FloatArray, change: FloatArray, step_s: float, grid: Grid, factors: Factors
) -> None:
    """Advance `field` (slices, rings) by one step under a load in J; `change` (slices, rings) is scratch."""
    slices, rings = field.shape
    radial, axial = factors.radial, factors.axial
    for i in range(slices):
        for j in range(rings):
            rate = (step_s * _inflow_W(field, i, j, grid) + load_J[i, j]) / grid.capacity_J_K[j]
            before = change[i, j - 1] if j > 0 else 0.0
            change[i, j] = (rate - radial[j, 0] * before) * radial[j, 1]
        for j in range(rings - 2, -1, -1):
            change[i, j] -= radial[j, 2] * change[i, j + 1]
        if i > 0:
            for j in range(rings):
                change[i, j] = (change[i, j] - axial[i, 0] * change[i - 1, j]) * axial[i, 1]
        else:
            for j in range(rings):
                change[i, j] *= axial[i, 1]
    for j in range(rings):
        field[slices - 1, j] += change[slices - 1, j]
    for i in range(slices - 2, -1, -1):
        for j in range(rings):
            change[i, j] -= axial[i, 2] * change[i + 1, j]
            field[i, j] += change[i, j]
