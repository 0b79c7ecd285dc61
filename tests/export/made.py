"""Machines, faulty recordings and compiled code for the tests of exports."""

from __future__ import annotations

import ctypes
import shutil
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from observer.config.machine import Config
from observer.export.c99 import c99_files
from observer.export.form import Form, FormRunner
from tests.logs.machines import machine, table

WARNINGS = ["-std=c99", "-Wall", "-Wextra", "-Wpedantic", "-Wconversion", "-Werror"]
SCALE = {
    "heat_W": 100.0,
    "field_degC": 100.0,
    "error_um": 100.0,
    "compensation_um": 100.0,
    "innovation_K": 1.0,
    "force_N": 1000.0,
}
"""What 1e-12 is relative to: the size of each output, as the numbers that are summed up to it have it."""


FOURTH = {"name": "d", "channel": "d_degC", "position_m": 0.28}


def nut_machine(**changes: Any) -> Config:
    """The small bar with a nut that moves, a law of two speeds, air by a channel, and a
    thermal error and an axial force between two supports."""
    given = table()
    given["screw"] |= {"expansion_1_K": 11.8e-6}
    return machine(
        **{
            "screw": given["screw"],
            "ambient": {"channel": "air_degC"},
            "source": [
                {
                    "name": "nut", "shape": "nut", "length_m": 0.05, "stroke_m": [0.08, 0.32],
                    "position_channel": "nut_m", "lead_m": 0.01, "speed_channel": "n_rpm", "torque_Nm": 0.3,
                    "share": 0.5,
                },
                {**given["source"][0], "from_m": 0.0, "to_m": 0.03},
                given["source"][1],
                {"name": "motor", "shape": "point", "position_m": 0.0, "heat_W": 2.0, "drive_channel": "on",
                 "estimate": False},
            ],
            "sensor": [*given["sensor"], given["sensor"][0] | FOURTH],
            "tolerance": {"offset_K": 0.3},
            "supports": {"mounting": "L-III", "preload_N": 2000.0, "stiffness_second_N_m": 2e8},
            "compensation": {"points": 7, "rate_limit_um_s": 0.3, "gradient_limit_um_m": 40.0},
        }
        | changes
    )  # fmt: skip


def faulty(form: Form, steps: int, seed: int = 1) -> list[dict[str, Any]]:
    """Inputs with everything that goes wrong: gaps, stale inputs, outliers, a dead position, no heartbeat."""
    rng, inputs = np.random.default_rng(seed), []
    labels = next(slot.labels for slot in form.slots if slot.name == "reading")
    part = steps // 10
    for k in range(steps):
        warm = 20.0 + 4.0 * (1.0 - np.exp(-k / 80.0))
        usual = {"air_degC": 20.0 + 0.3 * np.sin(k / 50), "nut_m": 0.2 + 0.1 * np.sin(k / 7),
                 "n_rpm": 1500.0 * np.sign(np.sin(k / 7)), "heater_W": 20.0,
                 "on": float(k % 90 < 60)}  # fmt: skip
        values = {name: usual.get(name, warm + 0.05 * rng.normal()) for name in labels}
        fresh = {name: bool(rng.random() > 0.03) for name in labels}
        sensors = [name for name in labels if name not in usual]
        if k < 3:
            fresh = dict.fromkeys(labels, False)  # nothing has come yet
        if k == 3 * part:
            values[sensors[0]] += 8.0  # a single outlier
        if 4 * part <= k < 5 * part:
            fresh[sensors[-1]] = False  # a sensor that is gone …
        if 5 * part <= k < 6 * part:
            values[sensors[0]] = 300.0  # … one beyond its limits, and one that is no number
            values[sensors[-1]] = np.nan
        if 6 * part <= k < 7 * part and "nut_m" in fresh:
            fresh["nut_m"] = False
        if 7 * part <= k < 8 * part:
            for name in sensors:
                values[name] += 15.0  # all of them: the observer was wrong
        if 9 * part <= k:
            fresh = dict.fromkeys(labels, False)
        inputs.append(
            {
                "reading": [float(values[name]) for name in labels],
                "fresh": [fresh[name] for name in labels],
                "enable": k % (2 * part) > part // 2,
                "heartbeat": min(k, 8 * part) + (k > 8.3 * part) * k,
            }
        )
    known = {slot.name for slot in form.of("input")}
    return [{name: value for name, value in row.items() if name in known} for row in inputs]


def by_python(form: Form, inputs: list[dict[str, Any]]) -> dict[str, np.ndarray]:
    runner = FormRunner(form)
    rows = [runner.step(row) for row in inputs]
    return {name: np.array([row[name] for row in rows], float) for name in rows[0]}


def structure(form: Form, role: Any, real: Any) -> type[ctypes.Structure]:
    """The layout of a role in memory, as a C compiler has it."""
    kinds = {"real": real, "int": ctypes.c_int, "bool": ctypes.c_bool}

    class Layout(ctypes.Structure):
        _fields_ = [(slot.name, _array(kinds[slot.kind], slot.shape)) for slot in form.of(role)]

    return Layout


def _array(kind: Any, shape: tuple[int, ...]) -> Any:
    for n in reversed(shape):
        kind = kind * n
    return kind


DRIVER = """#include <stdio.h>
#include "{0}.h"
int main(void)
{{
    {0}_state state;
    {0}_in in;
    {0}_out out;
    {0}_init(&state);
    while (fread(&in, sizeof in, 1, stdin) == 1) {{
        {0}_step(&state, &in, &out);
        if (fwrite(&out, sizeof out, 1, stdout) != 1) return 1;
    }}
    return 0;
}}
"""


def compiler(name: str) -> str:
    path = shutil.which(name)
    if path is None:
        pytest.skip(f"{name} is not installed: apt-get install {name}")
    return path


def built(form: Form, folder: Path, name: str, *flags: str) -> Path:
    """A program that steps what comes on its input, made by a compiler."""
    for file, text in (c99_files(form) | {"driver.c": DRIVER.format(form.name)}).items():
        (folder / file).write_text(text, encoding="utf-8")
    made = folder / "stepped"
    sources = [str(folder / f"{form.name}.c"), str(folder / "driver.c")]
    subprocess.run(
        [compiler(name), *WARNINGS, *flags, "-I", str(folder), *sources, "-o", str(made)], check=True
    )
    return made


def by_c(
    form: Form, program: Path, inputs: list[dict[str, Any]], real: Any = ctypes.c_double
) -> dict[str, np.ndarray]:
    """The outputs of a program."""
    In, Out = structure(form, "input", real), structure(form, "output", real)
    data = b"".join(bytes(_filled(In(), row)) for row in inputs)
    done = subprocess.run([str(program)], input=data, capture_output=True, check=False)
    assert done.returncode == 0, done.stderr.decode()
    size = ctypes.sizeof(Out)
    rows = [Out.from_buffer_copy(done.stdout, at) for at in range(0, len(done.stdout), size)]
    assert len(rows) == len(inputs)
    return {
        slot.name: np.array([np.array(getattr(row, slot.name)) for row in rows], float)
        for slot in form.of("output")
    }


def _filled(record: ctypes.Structure, row: dict[str, Any]) -> ctypes.Structure:
    for name, value in row.items():
        field = getattr(record, name)
        if isinstance(value, list):
            field[:] = value
        else:
            setattr(record, name, value)
    return record


def apart(one: dict[str, np.ndarray], other: dict[str, np.ndarray]) -> dict[str, float]:
    """How far two runs are apart in each output, relative to its scale, where that is more than 1e-12."""
    assert one.keys() == other.keys()
    found = {k: float(np.max(np.abs(one[k] - other[k]), initial=0.0)) / SCALE.get(k, 1.0) for k in one}
    return {k: value for k, value in found.items() if not value <= 1e-12}
