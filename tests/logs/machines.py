"""Configurations of small machines."""

from __future__ import annotations

import tomllib
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import tomlkit

from observer.align.aligner import AlignPlan, frames_of_log
from observer.config.machine import Config
from observer.files.logs import read_log
from observer.frames import FrameBlock
from observer.installation import load, parse

RIG = Path(__file__).parents[1] / "data" / "rig"
MACHINES = RIG.with_name("machines")
LENGTHS_M = (1.0, 0.8, 1.2)
"""Of the screws of a fleet's three types."""
SCREW = {
    "length_m": 1.0,
    "diameter_m": 0.036,
    "conductivity_W_mK": 50.0,
    "density_kg_m3": 7800.0,
    "specific_heat_J_kgK": 460.0,
}


def machine_table(name: str, **by_path: Any) -> dict[str, Any]:
    """Return the table of a machine in `tests/data/machines` with other values.

    A path such as `sensor__0__noise_K` names a value; None takes it out.
    """
    return put_values(tomllib.loads((MACHINES / f"{name}.toml").read_text(encoding="utf-8")), by_path)


def put_values(table: dict[str, Any], by_path: dict[str, Any]) -> dict[str, Any]:
    """Put values into a table by their paths; returns it."""
    for path, value in by_path.items():
        keys: list[Any] = [int(part) if part.isdigit() else part for part in path.split("__")]
        *parents, last = keys
        at: Any = table
        for part in parents:
            at = at[part] if isinstance(at, list) else at.setdefault(part, {})
        if value is None:
            del at[last]
        else:
            at[last] = value
    return table


def machine_text(name: str, **by_path: Any) -> str:
    """Return the same as the text of a configuration."""
    return tomlkit.dumps(machine_table(name, **by_path))


@cache
def rig() -> tuple[Config, list[FrameBlock]]:
    config = load(RIG / "config.toml")
    return config, list(frames_of_log(read_log(RIG / "run_c.csv.gz"), AlignPlan.of(config)))


def table(**changes: Any) -> dict[str, Any]:
    """Return the bar's table with other tables in place."""
    return machine_table("bar") | changes


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
