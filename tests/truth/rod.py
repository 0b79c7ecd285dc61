"""One-dimensional finite volumes of the screw: any pairing of ends, any heats, many runs at once."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from tests.truth.bar import Bar, End, FloatArray, Mesh
from tests.truth.reader import Reader
from tests.truth.stepper import Network

INSULATED = End()


@dataclass(frozen=True, slots=True)
class Heat:
    """One heat: `share` (cells,) or, moving, (K, cells); `heat_W` (K,) or (K, R), mean over each step.

    `end`: it enters through that end's face. The face's temperature then includes its gradient, a convective
    end takes a share of it at once, and a prescribed end takes it all.
    """

    share: FloatArray
    heat_W: FloatArray
    end: Literal["left", "right"] | None = None


@dataclass(frozen=True, slots=True)
class History:
    """Temperatures and their integral at chosen positions.

    `temperature_degC`, `integral_Km` (K + 1, P, R), the latter ∫_0^x T dx in °C·m.
    """

    time_s: FloatArray
    position_m: FloatArray
    temperature_degC: FloatArray
    integral_Km: FloatArray

    def error_um(self, bar: Bar, reference_degC: float) -> FloatArray:
        """Growth of a free screw from x = 0, (K + 1, P, R): α ∫_0^x (T − T_ref) dx."""
        rise = self.integral_Km - reference_degC * self.position_m[:, None]
        return 1e6 * bar.expansion_1_K * rise


def simulate(
    bar: Bar,
    mesh: Mesh,
    time_s: FloatArray,
    heats: Sequence[Heat],
    position_m: FloatArray,
    *,
    ends: tuple[End, End] = (INSULATED, INSULATED),
    ambient_degC: FloatArray | float = 20.0,
    left_degC: FloatArray | float = 20.0,
    right_degC: FloatArray | float = 20.0,
    initial_degC: FloatArray | float = 20.0,
    runs: int = 1,
) -> History:
    """Simulate K = len(time_s) − 1 steps of `runs` bars that share mesh, ends and ambient.

    Ambient and end temperatures are given at the K + 1 times (or constant) and taken as linear in between;
    `initial_degC` is a number, (cells,) or (cells, R).
    """
    steps = len(time_s) - 1
    ambient, left, right = (np.broadcast_to(v, (steps + 1,)) for v in (ambient_degC, left_degC, right_degC))
    network, ties = _assemble(bar, mesh, ends)
    start = np.asarray(initial_degC, float)
    start = start[:, None] if start.ndim == 1 else start
    field = np.array(np.broadcast_to(start, (mesh.cells, runs)))
    reader = Reader(bar, mesh, ends, np.asarray(position_m, float))
    temperature = np.empty((steps + 1, len(reader.position_m), runs))
    integral = np.empty_like(temperature)
    fluxes = end_fluxes(heats, steps, runs)
    kept = {None: 1.0, "left": _end_share(bar, mesh, ends[0]), "right": _end_share(bar, mesh, ends[1])}
    outside = np.stack([left, right, ambient])
    temperature[0], integral[0] = reader.read(field, outside[:, 0], fluxes[0] * 0.0)
    for k in range(steps):
        mean = 0.5 * (outside[:, k] + outside[:, k + 1])
        load = np.repeat((ties @ mean)[:, None], runs, axis=1)
        for heat in heats:
            share = heat.share if heat.share.ndim == 1 else heat.share[k]
            load += share[:, None] * (kept[heat.end] * heat.heat_W[k])
        field = network.step(field, load, float(time_s[k + 1] - time_s[k]))
        temperature[k + 1], integral[k + 1] = reader.read(field, outside[:, k + 1], fluxes[k])
    return History(time_s, reader.position_m, temperature, integral)


def _assemble(bar: Bar, mesh: Mesh, ends: tuple[End, End]) -> tuple[Network, FloatArray]:
    """The network, and how [left, right, ambient] temperatures load each cell, (cells, 3), W/K."""
    inner = bar.conductance_Wm_K / mesh.width_m
    bands = np.zeros((2, mesh.cells))
    bands[0] = 2.0 * inner + bar.film_W_mK * mesh.width_m
    bands[1, :-1] = -inner
    ties = np.zeros((mesh.cells, 3))
    ties[:, 2] = bar.film_W_mK * mesh.width_m
    for side, (end, cell) in enumerate(zip(ends, (0, -1), strict=True)):
        tie = _end_conductance_W_K(bar, mesh, end)
        bands[0, cell] += tie - inner
        ties[cell, 2 if end.kind == "convective" else side] += tie
    return Network(np.full(mesh.cells, bar.capacity_J_mK * mesh.width_m), bands), ties


def _end_share(bar: Bar, mesh: Mesh, end: End) -> float:
    """Share of a heat through an end's face that reaches the end cell; the rest passes to the outside."""
    if end.kind == "prescribed":
        return 0.0
    half = 2.0 * bar.conductance_Wm_K / mesh.width_m
    return half / (half + end.coefficient_W_m2K * bar.area_m2)


def _end_conductance_W_K(bar: Bar, mesh: Mesh, end: End) -> float:
    """Conductance from the end cell's centre to the outside."""
    half = 2.0 * bar.conductance_Wm_K / mesh.width_m
    if end.kind == "prescribed":
        return half
    return end.coefficient_W_m2K * bar.area_m2 * _end_share(bar, mesh, end)


def end_fluxes(heats: Sequence[Heat], steps: int, runs: int) -> FloatArray:
    """Heat through both faces, (K, 2, R)."""
    fluxes = np.zeros((steps, 2, runs))
    for heat in heats:
        if heat.end:
            fluxes[:, ("left", "right").index(heat.end)] += heat.heat_W.reshape(steps, -1)
    return fluxes
