"""Rings and slices of a round bar, and how a section mean is read between slices."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from tests.truth.machine.physics import FloatArray, Physics


class Grid(NamedTuple):
    """Equal slices of rings of equal thickness; conductances of one slice in W/K."""

    slices: int
    rings: int
    slice_m: float
    share: FloatArray  # (rings,) of the section's area
    capacity_J_K: FloatArray  # (rings,) of one slice
    radial_W_K: FloatArray  # (rings,) from a ring to the next one out; the last is 0
    axial_W_K: FloatArray  # (rings,) from a slice to the next
    skin_K_W: float  # from the middle of the outer ring to the surface
    surface_m2: float  # of one slice
    face_K_W: float  # lever of a face's gradient: dz/(3 k A)


def build_grid(physics: Physics, slices: int, rings: int) -> Grid:
    """Mesh a screw."""
    radius_m, k = physics.diameter_m / 2.0, physics.conductivity_W_mK
    dz, dr = physics.length_m / slices, radius_m / rings
    edge_m = np.linspace(0.0, radius_m, rings + 1)
    area_m2 = math.pi * np.diff(edge_m**2)
    radial = k * 2.0 * math.pi * edge_m[1:] * dz / dr
    radial[-1] = 0.0
    return Grid(
        slices=slices,
        rings=rings,
        slice_m=dz,
        share=area_m2 / area_m2.sum(),
        capacity_J_K=physics.capacity_J_m3K * area_m2 * dz,
        radial_W_K=radial,
        axial_W_K=k * area_m2 / dz,
        skin_K_W=0.5 * dr / (k * 2.0 * math.pi * radius_m * dz),
        surface_m2=2.0 * math.pi * radius_m * dz,
        face_K_W=dz / (3.0 * k * area_m2.sum()),
    )


def stretch_share(grid: Grid, from_m: float, to_m: float) -> FloatArray:
    """Covered part of each slice, (slices,)."""
    edge_m = np.arange(grid.slices + 1) * grid.slice_m
    return np.asarray(np.diff(np.clip(edge_m, from_m, to_m)) / grid.slice_m)


def point_share(grid: Grid, position_m: float) -> FloatArray:
    """Share of a heat at a point, (slices,): two neighbours whose centre of gravity is the point."""
    place = min(max(position_m / grid.slice_m - 0.5, 0.0), grid.slices - 1.0)
    first = min(int(place), grid.slices - 2)
    share = np.zeros(grid.slices)
    share[first], share[first + 1] = 1.0 - (place - first), place - first
    return share


def reading_weights(grid: Grid, position_m: FloatArray) -> tuple[np.ndarray, FloatArray]:
    """First slice (P,) and weights (P, 4) of a section mean at a point, from the means of four slices.

    The cubic with these four means, evaluated at the point: fourth order where the field is smooth.
    """
    first = np.clip(np.round(position_m / grid.slice_m).astype(np.int64) - 2, 0, grid.slices - 4)
    weights = np.empty((len(position_m), 4))
    edge = np.arange(5.0)
    power = np.arange(4)
    means = np.diff(edge[:, None] ** (power + 1), axis=0) / (power + 1)  # of s^p over each slice
    for row, (start, x_m) in enumerate(zip(first, position_m, strict=True)):
        s = x_m / grid.slice_m - start
        weights[row] = np.linalg.solve(means.T, s**power)
    return first, weights
