"""A rod with sensors `t1`, `t2` … and no input channel, for files that hold temperatures alone."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import observer
from observer.installation import Installation, load
from tests.logs.machines import machine_text

_ROD = machine_text(
    "bearing",
    machine={"name": "rod", "axis": "x"},
    screw__length_m=1.0,
    surface__convection_W_m2K=10.0,
    ambient__temperature_degC=22.0,
    source=[{"name": "heater", "shape": "point", "position_m": 0.0, "heat_W": 5.0}],
    sensor=None,
)
_SENSOR = '[[sensor]]\nname = "t{0}"\nchannel = "t{0}_degC"\nposition_m = {1}\nnoise_K = 0.05\n'


def rod(folder: Path, log: Mapping[str, Any], columns: Mapping[str, str], sensors: int = 1) -> Installation:
    """The rod's configuration with a `[log]` table, written into a folder."""
    path = folder / "rod.toml"
    path.write_text(rod_text(log, columns, sensors), encoding="utf-8")
    return load(path)


def import_file(path: Path, config: Installation, **options: Any) -> observer.ImportedLog:
    """Import one file by a configuration."""
    return observer.import_log(path, observer.Machine(config, b""), **options)


def rod_text(log: Mapping[str, Any], columns: Mapping[str, str], sensors: int = 1) -> str:
    """The rod's configuration with a `[log]` table."""
    lines = [_ROD, *(_SENSOR.format(i, 0.2 * i) for i in range(1, sensors + 1)), "[log]"]
    lines += [f"{key} = {json.dumps(value, ensure_ascii=False)}" for key, value in log.items()]
    lines += ["[log.columns]"] if columns else []
    lines += [f"{key} = {json.dumps(value, ensure_ascii=False)}" for key, value in columns.items()]
    return "\n".join(lines) + "\n"
