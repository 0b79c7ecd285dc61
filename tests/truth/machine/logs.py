"""Writes runs as logs, and the configuration that the machine's user has."""

from __future__ import annotations

import gzip
import json
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from tests.truth.machine.machine import SENSOR_M, SENSORS, SOURCES
from tests.truth.machine.physics import FloatArray

FORMATS = {f"{s}_degC": "%.2f" for s in SENSORS} | {
    "nut_position_m": "%.4f",
    "screw_speed_rpm": "%.0f",
    "ambient_degC": "%.2f",
}
CHANNELS = tuple(FORMATS)


def write_log(
    path: Path, time_s: FloatArray, values: FloatArray, formats: Mapping[str, str] = FORMATS
) -> None:
    """Write one run as gzipped CSV, the same bytes for the same values; NaN becomes an empty cell.

    `formats` says how each channel is printed, in the order of the values' columns.
    """
    clock = "%.1f" if np.allclose(time_s * 10.0 % 1.0, 0.0) else "%.3f"
    row = ",".join([clock, *formats.values()])
    table = np.column_stack([time_s, values]).tolist()
    text = "\n".join([",".join(["time_s", *formats]), *(row % tuple(cells) for cells in table), ""])
    path.write_bytes(gzip.compress(text.replace("nan", "").encode(), 5, mtime=0))


_HEAD = """\
[machine]
name = "rig"
axis = "x"

[screw]
length_m = 1.0
diameter_m = 0.036
conductivity_W_mK = 50.0
density_kg_m3 = 7800.0
specific_heat_J_kgK = 460.0
expansion_1_K = 11.8e-6

[surface]
convection_W_m2K = {film}

[ambient]
channel = "ambient_degC"

[boundary.left]
kind = "insulated"
[boundary.right]
kind = "insulated"
"""

_NUT = """
[[source]]
name = "nut"
shape = "nut"
length_m = 0.08
stroke_m = [0.15, 0.8]
position_channel = "nut_position_m"
speed_channel = "screw_speed_rpm"
torque_Nm = 0.3
share = 0.5
"""

_BEARING = """
[[source]]
name = "{name}"
shape = "point"
position_m = {position_m}
speed_channel = "screw_speed_rpm"
heat_W_rpm = 0.006
"""

_SENSOR = """
[[sensor]]
name = "{name}"
channel = "{name}_degC"
position_m = {position_m}
noise_K = 0.05
"""

FREE = {
    "nut": "source.nut.torque_Nm",
    "film": "surface.convection_W_m2K",
    "left_bearing": "source.left_bearing.heat_W_rpm",
    "right_bearing": "source.right_bearing.heat_W_rpm",
}


KNOWN = """
[tolerance]
conductivity = 0.02
heat_capacity = 0.02
position_m = 0.001
offset_K = 0.0
ambient_K = 0.0
gain = 0.0
heat_per_log = 0.0
"""
"""What is said of a machine whose sensors were compared with each other and with the air's, and whose
friction is the same from day to day.
"""


def configuration(unknown: tuple[str, ...], without: tuple[str, ...] = (), *, known: bool = False) -> str:
    """The user's configuration; `unknown`: what he does not know of: "film", "left_bearing", "right_bearing".

    What he knows of, he lets be fitted. `without`: effects that a search must not consider. `known`: his
    sensors are compared and in place.
    """
    parts = [_HEAD.format(film="0.0" if "film" in unknown else "15.0"), _NUT]
    parts += [
        _BEARING.format(name=name, position_m=position_m)
        for name, position_m in zip(SOURCES[1:], ("0.0", "1.0"), strict=True)
        if name not in unknown
    ]
    parts += [_SENSOR.format(name=n, position_m=x_m) for n, x_m in zip(SENSORS, SENSOR_M, strict=True)]
    free = ", ".join(f'"{key}"' for name, key in FREE.items() if name not in unknown)
    parts.append(f"\n[calibrate]\nfree = [{free}]\n")
    if known:
        parts.append(KNOWN)
    if without:
        parts.append(f"\n[discover]\nwithout = {json.dumps(without)}\n")
    return "".join(parts)
