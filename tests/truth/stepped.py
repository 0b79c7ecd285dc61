"""One-dimensional finite volumes of a screw whose diameter and bore differ from cell to cell."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tests.truth.bar import FloatArray, Mesh
from tests.truth.stepper import Network

CONDUCTIVITY_W_MK, CAPACITY_J_M3K = 50.0, 7800.0 * 460.0


@dataclass(frozen=True, slots=True)
class SteppedBar:
    """Outer and inner diameters of the cells of a mesh, (cells,), and the coefficients of both ends' films, 0
    where an end is insulated.
    """

    mesh: Mesh
    outer_m: FloatArray
    inner_m: FloatArray
    ends_W_m2K: tuple[float, float] = (0.0, 0.0)

    @property
    def area_m2(self) -> FloatArray:
        """The ring that conducts and stores, (cells,)."""
        return math.pi / 4.0 * (self.outer_m - self.inner_m) * (self.outer_m + self.inner_m)

    def at_faces(self, field: FloatArray) -> FloatArray:
        """Temperatures of the faces between cells, (…, cells − 1), which the same heat passes from either."""
        area = self.area_m2
        return (area[:-1] * field[..., :-1] + area[1:] * field[..., 1:]) / (area[:-1] + area[1:])

    def network(self, film_W_m2K: float) -> tuple[Network, FloatArray]:
        """Its capacities and conductances under a film, and what each cell loses per kelvin, (cells,)."""
        dx, half = self.mesh.width_m, 2.0 * CONDUCTIVITY_W_MK * self.area_m2 / self.mesh.width_m
        between = half[1:] * half[:-1] / (half[1:] + half[:-1])
        lost = film_W_m2K * math.pi * self.outer_m * dx
        for cell, end in ((0, self.ends_W_m2K[0]), (-1, self.ends_W_m2K[1])):
            tie = end * self.area_m2[cell]
            lost[cell] += tie * half[cell] / (tie + half[cell])
        bands = np.zeros((2, self.mesh.cells))
        bands[0] = lost
        bands[0, 1:] += between
        bands[0, :-1] += between
        bands[1, :-1] = -between
        return Network(CAPACITY_J_M3K * self.area_m2 * dx, bands), lost


def simulate(
    bar: SteppedBar,
    time_s: FloatArray,
    heats: Sequence[tuple[FloatArray, FloatArray]],
    film_W_m2K: FloatArray,
    air_degC: float,
) -> FloatArray:
    """Cell temperatures (K + 1, cells) from the air's temperature on: heats (K,) in W with their shares of
    cells, (cells,) or (K, cells), under a film (K,) that stays within each step.
    """
    made = {film: bar.network(film) for film in np.unique(film_W_m2K).tolist()}
    field = np.zeros((bar.mesh.cells, 1))  # above the air
    out = np.empty((len(time_s), bar.mesh.cells))
    out[0] = air_degC
    for k, dt_s in enumerate(np.diff(time_s)):
        load = sum((s if s.ndim == 1 else s[k]) * heat_W[k] for s, heat_W in heats)
        network, _ = made[float(film_W_m2K[k])]
        field = network.step(field, np.asarray(load)[:, None], float(dt_s))
        out[k + 1] = air_degC + field[:, 0]
    return out
