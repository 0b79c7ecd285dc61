"""The plants that are timed: the size of the published table, and a full axis."""

from __future__ import annotations

from typing import Any

import numpy as np

from observer.config import Config
from observer.frames import FloatArray, Inputs
from observer.installation import parse
from observer.model.discretise import augmented, step_matrices
from observer.model.plant import Plant

SCREW = {
    "length_m": 1.0,
    "diameter_m": 0.036,
    "conductivity_W_mK": 50.0,
    "density_kg_m3": 7800.0,
    "specific_heat_J_kgK": 460.0,
}


def config_of(
    modes: int, sensors: int, grid: int, *, engine: str = "compiled", moving: bool = False, **tables: Any
) -> Config:
    """A screw with a nut and two bearings; `moving` lets the nut follow a position."""
    nut: dict[str, Any] = {"name": "nut", "shape": "nut", "length_m": 0.08, "stroke_m": [0.2, 0.8]}
    if moving:
        nut["position_channel"] = "nut_position_m"
    ends = [{"name": n, "shape": "point", "position_m": x} for n, x in (("left", 0.0), ("right", 1.0))]
    law = {"speed_channel": "screw_speed_rpm", "heat_W_rpm": 0.006}
    table = {
        "screw": SCREW,
        "surface": {"convection_W_m2K": 15.0},
        "ambient": {"temperature_degC": 20.0},
        "source": [source | law for source in (nut, *ends)],
        "sensor": [
            {"name": f"t{i}", "channel": f"t{i}_degC", "position_m": float(x), "noise_K": 0.1}
            for i, x in enumerate(np.linspace(0.05, 0.95, sensors), 1)
        ],
        "model": {"modes": modes},
        "estimator": {"engine": engine, "period_s": 0.5},
        "output": {"positions_m": np.linspace(0.0, 1.0, grid).tolist()},
    }
    return parse(table | tables)


def even_inputs(plant: Plant, steps: int, seed: int = 1) -> Inputs:
    """Inputs of an even log: noise around 20 °C, a steady law, ambient at 20 °C."""
    sensors, sources, known = plant.rows.sensors, len(plant.source_names), len(plant.known_names)
    rng = np.random.default_rng(seed)
    time_s = 0.5 * np.arange(steps, dtype=float)
    return Inputs(
        time_s=time_s,
        dt_s=np.concatenate([[0.0], np.diff(time_s)]),
        y_degC=20.0 + 0.1 * rng.standard_normal((steps, sensors)),
        usable=np.ones((steps, sensors), np.bool_),
        quality=np.zeros((steps, sensors), np.int8),
        law_W=np.full((steps, sources), 9.0),
        law_jump_W=np.zeros((steps, sources)),
        z_start=np.full((steps, known), 20.0),
        z_end=np.full((steps, known), 20.0),
        moving_B=np.zeros((steps, 0, len(plant.decay_1_s))),
        moving_C=np.zeros((steps, 0, len(plant.rows.C))),
        degraded=np.zeros(steps, np.bool_),
        loss_1_s=np.zeros(steps),
        loss_degC=np.zeros(steps),
    )


def dense(plant: Plant, dt_s: float) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Ad, Qd (n, n) and the sensors' rows (s, n) of the augmented pair, for the peers."""
    Ad, Qd = augmented(plant, step_matrices(plant, dt_s))
    H = np.zeros((plant.rows.sensors, len(Ad)))
    H[:, : len(plant.decay_1_s)] = plant.rows.C[plant.rows.sensor_slice]
    return Ad, Qd, H
