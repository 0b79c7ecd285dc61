"""The rig's log, and a small machine whose logs are made from known parameters."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from observer.align.aligner import AlignPlan, frames_of_log
from observer.config import Config
from observer.files.logs import read_log
from observer.frames import FloatArray, FrameBlock
from observer.installation import load, parse
from observer.model.build import build_plant
from observer.model.drive import Drive
from observer.model.simulate import simulate, start

RIG = Path(__file__).parents[1] / "data" / "rig"


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


def frames(config: Config, time_s: FloatArray, columns: dict[str, FloatArray]) -> FrameBlock:
    """A log without gaps as one block; a NaN cell is missing."""
    values = np.column_stack([columns[name] for name in config.channels])
    fresh = np.isfinite(values)
    return FrameBlock(
        channels=config.channels,
        time_s=time_s,
        dt_s=np.diff(time_s, prepend=time_s[0]),
        values=values,
        fresh=fresh,
        quality=np.where(fresh, 0, 1).astype(np.int8),
        age_s=np.zeros_like(values),
        path={},
    )


def made_log(
    truth: Config, seed: int, *, minutes: float = 100.0, heater_W: float = 15.0, speed_rpm: float = 1000.0
) -> FrameBlock:
    """A log of the machine `truth`: rest, heater on, bearing on, rest; one row every 2 s, white noise."""
    time_s = np.arange(0.0, 60 * minutes, 2.0)
    share = time_s / (60 * minutes)
    columns = {
        "heater_W": np.where((share > 0.05) & (share < 0.5), heater_W, 0.0),
        "n_rpm": np.where((share > 0.3) & (share < 0.7), speed_rpm, 0.0),
    }
    blank = {s.channel: np.full_like(time_s, 20.0) for s in truth.sensor}
    plant = build_plant(truth)
    drive = Drive(truth, plant)
    _, inputs = drive.run(drive.initial(), frames(truth, time_s, columns | blank))
    rows = simulate(plant, start(plant, 20.0, inputs.law_W[0]), inputs)[1]
    noise_K = 0.05 * np.random.default_rng(seed).normal(size=(len(time_s), len(truth.sensor)))
    for i, sensor in enumerate(truth.sensor):
        columns[sensor.channel] = rows[:, i] + noise_K[:, i]
    return frames(truth, time_s, columns)


def machine(**changes: Any) -> Config:
    return parse(table(**changes))
