"""Two-dimensional finite volumes of the screw: rings × slices, heated on its surface by a moving nut."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from tests.truth.bar import Bar, End, FloatArray, Mesh
from tests.truth.reader import Reader
from tests.truth.rod import Heat, History, end_fluxes
from tests.truth.stepper import Network

INSULATED = (End(), End())


def simulate(
    bar: Bar,
    mesh: Mesh,
    time_s: FloatArray,
    surface: Sequence[Heat],
    section: Sequence[Heat],
    position_m: FloatArray,
    *,
    rings: int = 5,
    ambient_degC: FloatArray | float = 20.0,
    initial_degC: float = 20.0,
) -> History:
    """Simulate one screw with insulated end faces; what is read are means over the section.

    `surface` heats enter through the lateral surface (a nut), `section` heats over the whole section (a
    bearing at an end). Ambient is given at the K + 1 times, linear in between.
    """
    steps = len(time_s) - 1
    ambient = np.broadcast_to(ambient_degC, (steps + 1,))
    network, film_W_K, part = _assemble(bar, mesh, rings)
    area = _ring_areas(bar, rings)
    mean = area / area.sum()
    field = np.full((mesh.cells * rings, 1), float(initial_degC))
    reader = Reader(bar, mesh, INSULATED, np.asarray(position_m, float))
    temperature = np.empty((steps + 1, len(reader.position_m), 1))
    integral = np.empty_like(temperature)
    fluxes = end_fluxes(section, steps, 1)
    for k in range(steps + 1):
        slices = (field.reshape(mesh.cells, rings) @ mean)[:, None]
        outside = np.array([math.nan, math.nan, ambient[k]])
        temperature[k], integral[k] = reader.read(slices, outside, fluxes[k - 1] if k else fluxes[0] * 0.0)
        if k == steps:
            break
        load = np.zeros((mesh.cells, rings))
        load[:, -1] = film_W_K * 0.5 * (ambient[k] + ambient[k + 1])
        load[:, -1] += part * sum(_share(heat, k) * heat.heat_W[k] for heat in surface)
        for heat in section:
            load += (_share(heat, k) * heat.heat_W[k])[:, None] * mean
        field = network.step(field, load.reshape(-1, 1), float(time_s[k + 1] - time_s[k]))
    return History(time_s, reader.position_m, temperature, integral)


def _share(heat: Heat, step: int) -> FloatArray:
    return heat.share if heat.share.ndim == 1 else heat.share[step]


def _ring_areas(bar: Bar, rings: int) -> FloatArray:
    edges_m = np.linspace(0.0, bar.diameter_m / 2.0, rings + 1)
    return math.pi * np.diff(edges_m**2)


def _assemble(bar: Bar, mesh: Mesh, rings: int) -> tuple[Network, float, float]:
    """The network (slice by slice, ring by ring), a surface cell's film in W/K, a surface heat's share kept.

    A surface heat meets the film before the outer ring, so a little of it goes straight to the air.
    """
    radius_m, dz = bar.diameter_m / 2.0, mesh.width_m
    dr = radius_m / rings
    area = _ring_areas(bar, rings)
    faces_m = dr * np.arange(1, rings)
    radial = bar.conductivity_W_mK * 2.0 * math.pi * faces_m * dz / dr
    axial = bar.conductivity_W_mK * area / dz
    half = bar.conductivity_W_mK * 2.0 / dr
    part = half / (half + bar.convection_W_m2K)
    film = bar.convection_W_m2K * part * 2.0 * math.pi * radius_m * dz
    bands = np.zeros((rings + 1, mesh.cells, rings))
    bands[1, :, :-1] = -radial
    bands[0, :, :-1] += radial
    bands[0, :, 1:] += radial
    bands[0, :, -1] += film
    bands[rings, :-1] = -axial
    bands[0, :-1] += axial
    bands[0, 1:] += axial
    capacity = np.tile(bar.density_kg_m3 * bar.specific_heat_J_kgK * area * dz, mesh.cells)
    return Network(capacity, bands.reshape(rings + 1, -1)), film, part
