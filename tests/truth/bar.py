"""The screw as the truth sees it: a round bar, its two ends and its mesh."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Bar:
    """A round bar of one material under one film coefficient."""

    length_m: float = 1.0
    diameter_m: float = 0.036
    conductivity_W_mK: float = 50.0
    density_kg_m3: float = 7800.0
    specific_heat_J_kgK: float = 460.0
    convection_W_m2K: float = 15.0
    expansion_1_K: float = 11.8e-6

    @property
    def area_m2(self) -> float:
        """Cross-section, π d²/4."""
        return math.pi * self.diameter_m**2 / 4.0

    @property
    def conductance_Wm_K(self) -> float:
        """k A: the heat through a section per unit of gradient."""
        return self.conductivity_W_mK * self.area_m2

    @property
    def capacity_J_mK(self) -> float:
        """ρ c A: heat stored per metre and kelvin."""
        return self.density_kg_m3 * self.specific_heat_J_kgK * self.area_m2

    @property
    def film_W_mK(self) -> float:
        """h π d: heat lost per metre and kelvin."""
        return self.convection_W_m2K * math.pi * self.diameter_m

    @property
    def diffusivity_m2_s(self) -> float:
        """α = k/(ρ c)."""
        return self.conductivity_W_mK / (self.density_kg_m3 * self.specific_heat_J_kgK)


@dataclass(frozen=True, slots=True)
class End:
    """One end; `coefficient_W_m2K` belongs to a convective end."""

    kind: Literal["insulated", "convective", "prescribed"] = "insulated"
    coefficient_W_m2K: float = 0.0


@dataclass(frozen=True, slots=True)
class Mesh:
    """Uniform cells along the bar."""

    length_m: float
    cells: int

    @property
    def width_m(self) -> float:
        """Width of one cell."""
        return self.length_m / self.cells

    @property
    def edges_m(self) -> FloatArray:
        """Cell faces, (cells + 1,)."""
        return np.linspace(0.0, self.length_m, self.cells + 1)

    @property
    def centres_m(self) -> FloatArray:
        """Cell centres, (cells,)."""
        return (np.arange(self.cells) + 0.5) * self.width_m


def point_share(mesh: Mesh, position_m: float) -> FloatArray:
    """Share of a point heat in each cell, (cells,): two neighbours, the first moment kept.

    A point nearer to an end than half a cell belongs to the end cell alone: a flux through the face.
    """
    share = np.zeros(mesh.cells)
    place = min(max(position_m / mesh.width_m - 0.5, 0.0), mesh.cells - 1.0)
    cell = min(int(place), mesh.cells - 2)
    share[cell : cell + 2] = 1.0 - (place - cell), place - cell
    return share


def band_share(mesh: Mesh, from_m: float, to_m: float) -> FloatArray:
    """Share of a heat uniform over a stretch in each cell, (cells,)."""
    return np.diff(np.clip(mesh.edges_m, from_m, to_m)) / (to_m - from_m)


def nut_share(mesh: Mesh, length_m: float, centre_m: FloatArray) -> FloatArray:
    """Share of a moving nut's heat in each cell, (K, cells), mean over the path inside each step.

    `centre_m` is (K, s): the nut's centre at s sub-steps of each of K steps (midpoints of the sub-steps).
    """
    share = np.zeros((centre_m.shape[0], mesh.cells))
    for sub in range(centre_m.shape[1]):
        low_m = centre_m[:, sub, None] - 0.5 * length_m
        share += np.diff(np.clip(mesh.edges_m[None, :] - low_m, 0.0, length_m), axis=1)
    return share / (length_m * centre_m.shape[1])


def shuttle_m(time_s: FloatArray, low_m: float, high_m: float, speed_m_s: float) -> FloatArray:
    """Position of a nut that runs to and fro at constant speed, starting at `low_m`."""
    span_m = high_m - low_m
    return low_m + span_m - np.abs(np.mod(speed_m_s * time_s, 2.0 * span_m) - span_m)


def waiting_shuttle_m(
    time_s: FloatArray, low_m: float, high_m: float, traverse_s: float, low_s: float, high_s: float
) -> FloatArray:
    """Position of a nut that stands for `low_s` and `high_s` at the ends, and takes `traverse_s` between."""
    period_s = 2.0 * traverse_s + low_s + high_s
    turns_s = np.cumsum([0.0, low_s, traverse_s, high_s, traverse_s])
    ends_m = np.array([low_m, low_m, high_m, high_m, low_m])
    return np.interp(np.mod(time_s, period_s), turns_s, ends_m)


def substep_times(time_s: FloatArray, substeps: int) -> FloatArray:
    """Midpoints of `substeps` equal parts of each step, (K, substeps), for K + 1 times."""
    part = (np.arange(substeps) + 0.5) / substeps
    return time_s[:-1, None] + np.diff(time_s)[:, None] * part
