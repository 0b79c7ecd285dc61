"""Machines of some types, made by number, with logs that the program itself has simulated.

What is looked at with them is how work is shared and gone on with, never how right an estimate is.
"""

from __future__ import annotations

import tomllib
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import tomlkit

from observer import app
from observer.files.logs import read_log
from observer.files.writer import write_log
from observer.installation import load

RIG = Path(__file__).parents[1] / "data" / "rig" / "config.toml"
LENGTHS_M = (1.0, 0.8, 1.2)


def configuration(folder: Path, kind: int, name: str, **tables: Any) -> Path:
    """The configuration of a machine of one of three types, the rig's screw in another length."""
    table = tomllib.loads(RIG.read_text(encoding="utf-8"))
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


def simulated(config: Path, log: Path, rows: int, step_s: float = 1.0, speed_rpm: float = 1500.0) -> Path:
    """A log of the machine: a standstill, then traverses at one speed."""
    time_s = step_s * np.arange(rows)
    speed = np.where(time_s > time_s[-1] / 10, speed_rpm, 0.0)
    low, high = load(config).source[0].stroke_m or (0.0, 1.0)
    phase = np.mod(np.cumsum(speed) * step_s / 60 * 0.01 / (high - low), 2.0)
    nut_m = low + (high - low) * (1 - np.abs(1 - phase))
    program = log.with_name("program.parquet")
    log.parent.mkdir(parents=True, exist_ok=True)
    columns = {"nut_position_m": nut_m, "screw_speed_rpm": speed, "ambient_degC": np.full(rows, 22.0)}
    write_log(program, time_s, columns)
    app.simulate(program, load(config), log, None, lambda _done, _total: None)
    program.unlink()
    log.with_name("overview.png").unlink()
    return log


def with_noise(log: Path, paths: Sequence[Path], seed: int) -> list[Path]:
    """Copies of a log, each with a noise of its own on its sensors."""
    rng = np.random.default_rng(seed)
    whole = read_log(log)
    sensors = [i for i, name in enumerate(whole.channels) if name.startswith("t") and name.endswith("_degC")]
    inputs = ["nut_position_m", "screw_speed_rpm", "ambient_degC"]
    kept = [whole.channels.index(name) for name in inputs] + sensors
    for path in paths:
        path.parent.mkdir(parents=True, exist_ok=True)
        values = whole.values.copy()
        values[:, sensors] += 0.05 * rng.normal(size=(len(whole), len(sensors)))
        write_log(path, whole.time_s, {whole.channels[i]: values[:, i] for i in kept})
    return list(paths)


def a_fleet(folder: Path, machines: int, logs: int, rows: int) -> Path:
    """Machines of the types in turn, each with some logs, and the table that says so."""
    lines = ["log,machine,config"]
    for kind, length_m in enumerate(LENGTHS_M[:machines]):
        config = configuration(folder, kind, f"type-{length_m:g}")
        whole = simulated(config, folder / f"whole-{kind}" / "run.parquet", rows)
        for number in range(kind, machines, len(LENGTHS_M)):
            paths = [folder / f"m{number:03}" / f"run-{i:03}.parquet" for i in range(logs)]
            with_noise(whole, paths, number)
            lines += [f"{p.relative_to(folder)},m{number:03},{config.name}" for p in paths]
    table = folder / "fleet.csv"
    table.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return table
