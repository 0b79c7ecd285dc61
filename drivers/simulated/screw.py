"""The screw's heat conduction by finite volumes, implicit in time.

C_i dT_i/dt = G (T_{i-1} − 2 T_i + T_{i+1}) + H (T_amb − T_i) + q_i, with insulated ends, C = ρ c A Δx,
G = k A / Δx, H = h P Δx. Backward Euler gives a symmetric positive definite tridiagonal system, factored once
for each step length (Patankar 1980, chapter 4).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import lapack

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Rod:
    """Geometry, material and surroundings of the screw."""

    length_m: float = 1.0
    diameter_m: float = 0.036
    conductivity_W_mK: float = 50.0
    density_kg_m3: float = 7800.0
    specific_heat_J_kgK: float = 460.0
    film_W_m2K: float = 15.0
    ambient_degC: float = 22.0
    cells: int = 250


class Screw:
    """The temperature of every cell, advanced in steps."""

    def __init__(self, rod: Rod) -> None:
        self.rod = rod
        self._dx_m = rod.length_m / rod.cells
        self._edges_m = np.linspace(0.0, rod.length_m, rod.cells + 1)
        self._centres_m = 0.5 * (self._edges_m[1:] + self._edges_m[:-1])
        area_m2 = math.pi * rod.diameter_m**2 / 4
        self._capacity_J_K = rod.density_kg_m3 * rod.specific_heat_J_kgK * area_m2 * self._dx_m
        self._conductance_W_K = rod.conductivity_W_mK * area_m2 / self._dx_m
        self._film_W_K = rod.film_W_m2K * math.pi * rod.diameter_m * self._dx_m
        self._factors: dict[float, tuple[FloatArray, FloatArray]] = {}
        self.temperature_degC = np.full(rod.cells, rod.ambient_degC)

    def step(self, dt_s: float, heat_W: FloatArray) -> None:
        """Advance by one implicit step under the heat of each cell (cells,)."""
        diagonal, off_diagonal = self._factor(dt_s)
        right = (
            self._capacity_J_K / dt_s * self.temperature_degC
            + self._film_W_K * self.rod.ambient_degC
            + heat_W
        )
        self.temperature_degC, _ = lapack.dpttrs(diagonal, off_diagonal, right)

    def _factor(self, dt_s: float) -> tuple[FloatArray, FloatArray]:
        """The L D Lᵀ factors of the step matrix."""
        if dt_s not in self._factors:
            neighbours = np.full(self.rod.cells, 2.0)
            neighbours[[0, -1]] = 1.0
            diagonal = self._capacity_J_K / dt_s + self._film_W_K + neighbours * self._conductance_W_K
            off_diagonal = np.full(self.rod.cells - 1, -self._conductance_W_K)
            d, e, _ = lapack.dpttrf(diagonal, off_diagonal)
            self._factors[dt_s] = (d, e)
        return self._factors[dt_s]

    def spread(self, from_m: float, to_m: float) -> FloatArray:
        """The share of each cell (cells,) in a heat that is uniform over a stretch; it sums to 1."""
        overlap_m = np.minimum(self._edges_m[1:], to_m) - np.maximum(self._edges_m[:-1], from_m)
        share: FloatArray = np.clip(overlap_m, 0.0, None) / (to_m - from_m)
        return share

    def at(self, position_m: FloatArray) -> FloatArray:
        """Temperatures at positions, interpolated between cell centres."""
        found: FloatArray = np.interp(position_m, self._centres_m, self.temperature_degC)
        return found
