"""Configurations that describe the truth's bars, and a plain propagation of a plant."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from observer.config.machine import Config
from observer.installation import parse
from observer.model.plant import Plant
from tests.truth.bar import Bar, End, FloatArray


def end_table(end: End, channel: str) -> dict[str, Any]:
    """The table of one end."""
    extra = {"convective": {"coefficient_W_m2K": end.coefficient_W_m2K}, "prescribed": {"channel": channel}}
    return {"kind": end.kind, **extra.get(end.kind, {})}


def sensors(position_m: Sequence[float], noise_K: float = 0.05) -> list[dict[str, Any]]:
    """Thermocouples t1, t2, … at the positions."""
    return [
        {"name": f"t{i}", "channel": f"t{i}_degC", "position_m": float(x), "noise_K": noise_K}
        for i, x in enumerate(position_m, 1)
    ]


def point(name: str, position_m: float, **extra: Any) -> dict[str, Any]:
    """A point source whose heat is a measured power."""
    return {"name": name, "shape": "point", "position_m": position_m, "power_channel": f"{name}_W", **extra}


def config_of(
    bar: Bar,
    sources: list[dict[str, Any]],
    grid_m: Sequence[float] | FloatArray,
    *,
    ends: tuple[End, End] = (End(), End()),
    sensor_m: Sequence[float] = (0.5,),
    **tables: Any,
) -> Config:
    """A configuration of the same bar, checked as a file would be."""
    screw = {
        "length_m": bar.length_m,
        "diameter_m": bar.diameter_m,
        "conductivity_W_mK": bar.conductivity_W_mK,
        "density_kg_m3": bar.density_kg_m3,
        "specific_heat_J_kgK": bar.specific_heat_J_kgK,
        "expansion_1_K": bar.expansion_1_K,
    }
    table = {
        "screw": screw,
        "surface": {"convection_W_m2K": bar.convection_W_m2K},
        "ambient": {"channel": "ambient_degC"},
        "boundary": {"left": end_table(ends[0], "left_degC"), "right": end_table(ends[1], "right_degC")},
        "source": sources,
        "sensor": sensors(sensor_m),
        "output": {"positions_m": [float(x) for x in grid_m], "reference_degC": 20.0},
    }
    return parse(table | tables)


def play(
    plant: Plant, time_s: FloatArray, heat_W: FloatArray, z: FloatArray, initial_degC: float
) -> FloatArray:
    """Rows (K + 1, R) of a plant from a uniform start: heats (K, m) constant in a step, z (K + 1, p) linear.

    Written with the series of the textbook, not with the project's own discretisation.
    """
    decay, rows = plant.decay_1_s, plant.rows
    x = plant.uniform * initial_degC
    out = np.empty((len(time_s), len(rows.C)))
    out[0] = rows.C @ x + rows.F @ z[0]
    for k, dt in enumerate(np.diff(time_s)):
        s = decay * dt
        small = s < 1e-6
        safe = np.where(small, 1.0, s)
        whole = np.where(small, 1.0 - s / 2.0, -np.expm1(-safe) / safe)
        late = np.where(small, 0.5 - s / 6.0, (1.0 - whole) / safe)
        start = plant.B @ heat_W[k] + plant.E @ z[k]
        change = plant.E @ (z[k + 1] - z[k])
        x = np.exp(-s) * x + dt * (whole * start + late * change)
        out[k + 1] = rows.C @ x + rows.F @ z[k + 1]
    return out


def known(plant: Plant, count: int, **series: FloatArray | float) -> FloatArray:
    """The known inputs (count, p) of a plant by name."""
    return np.column_stack([np.broadcast_to(series[name], (count,)) for name in plant.known_names])
