"""Configurations of small machines."""

from __future__ import annotations

import tomllib
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import tomlkit

from observer.align.aligner import AlignPlan, frames_of_log
from observer.config import Config
from observer.files.logs import read_log
from observer.frames import FrameBlock
from observer.installation import load, parse

RIG = Path(__file__).parents[1] / "data" / "rig"
LENGTHS_M = (1.0, 0.8, 1.2)
"""Of the screws of a fleet's three types."""
SCREW = {
    "length_m": 1.0,
    "diameter_m": 0.036,
    "conductivity_W_mK": 50.0,
    "density_kg_m3": 7800.0,
    "specific_heat_J_kgK": 460.0,
}

# A short rod with a bearing at its left end and two thermocouples.
ROD = {
    "screw": SCREW | {"length_m": 0.6, "diameter_m": 0.03},
    "surface": {"convection_W_m2K": 15.0},
    "ambient": {"temperature_degC": 20.0},
    "source": [
        {"name": "bearing", "shape": "point", "position_m": 0.0, "speed_channel": "speed_rpm",
         "heat_W_rpm": 0.01},
    ],
    "sensor": [
        {"name": "t1", "channel": "t1_degC", "position_m": 0.05},
        {"name": "t2", "channel": "t2_degC", "position_m": 0.4},
    ],
}  # fmt: skip


@cache
def rig() -> tuple[Config, list[FrameBlock]]:
    config = load(RIG / "config.toml")
    return config, list(frames_of_log(read_log(RIG / "run_c.csv.gz"), AlignPlan.of(config)))


def table(**changes: Any) -> dict[str, Any]:
    """A bar with a heater and a bearing, small enough that a thousand rows take milliseconds."""
    return {
        "screw": {
            "length_m": 0.4, "diameter_m": 0.02, "conductivity_W_mK": 50.0, "density_kg_m3": 7800.0,
            "specific_heat_J_kgK": 460.0,
        },
        "surface": {"convection_W_m2K": 20.0},
        "tolerance": {
            "conductivity": 0.02, "heat_capacity": 0.02, "position_m": 0.001, "offset_K": 0.0,
            "ambient_K": 0.0,
        },
        "ambient": {"temperature_degC": 20.0},
        "source": [
            {"name": "heater", "shape": "band", "from_m": 0.1, "to_m": 0.15, "power_channel": "heater_W"},
            {"name": "bearing.l", "shape": "point", "position_m": 0.4, "speed_channel": "n_rpm",
             "heat_W_rpm": 0.005},
        ],
        "sensor": [
            {"name": "a", "channel": "a_degC", "position_m": 0.05, "noise_K": 0.05},
            {"name": "b", "channel": "b_degC", "position_m": 0.2, "noise_K": 0.05},
            {"name": "c", "channel": "c_degC", "position_m": 0.35, "noise_K": 0.05},
        ],
    } | changes  # fmt: skip


def probe(name: str, position_m: float, noise_um: float, zero_um: float, *, occasional: bool) -> str:
    """The table of a displacement sensor."""
    sensor = {
        "name": name, "kind": "displacement", "channel": f"{name}_um", "position_m": position_m,
        "noise_um": noise_um, "zero_um": zero_um, "occasional": occasional,
    }  # fmt: skip
    return f"\n{tomlkit.dumps({'sensor': [sensor]})}"


def machine(**changes: Any) -> Config:
    return parse(table(**changes))


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


def configuration(folder: Path, kind: int, name: str, **tables: Any) -> Path:
    """The configuration of a machine of one of three types, the rig's screw in another length."""
    table = tomllib.loads((RIG / "config.toml").read_text(encoding="utf-8"))
    stretch = LENGTHS_M[kind] / table["screw"]["length_m"]
    table["machine"]["name"] = name
    table["screw"]["length_m"] *= stretch
    for source in table["source"]:
        for key in ("position_m", "stroke_m"):
            if key in source:
                source[key] = (stretch * np.array(source[key])).tolist()
    for sensor in table["sensor"]:
        sensor["position_m"] *= stretch
    path = folder / f"{name}.toml"
    path.write_text(tomlkit.dumps(table | tables), encoding="utf-8")
    return path
