"""Writes what the truth says as files: a log in the project's format, and the truth beside it."""

from __future__ import annotations

import csv
import math
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from tests.truth.bar import Bar, FloatArray
from tests.truth.rod import History


def write_columns(path: Path, time_s: FloatArray, columns: Mapping[str, FloatArray]) -> Path:
    """Write `time_s` and named columns (n,) as CSV; NaN becomes an empty cell, every digit is kept."""
    table = np.column_stack([time_s, *columns.values()]).tolist()
    with path.open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(["time_s", *columns])
        writer.writerows([["" if math.isnan(value) else repr(value) for value in row] for row in table])
    return path


def truth_columns(
    bar: Bar, history: History, heats_W: Mapping[str, FloatArray], reference_degC: float, run: int = 0
) -> dict[str, FloatArray]:
    """The truth of one run under the names that estimates carry: heats, field, thermal error."""
    columns = {f"heat_{name}_W": heat_W for name, heat_W in heats_W.items()}
    error_um = history.error_um(bar, reference_degC)
    for i, x_m in enumerate(history.position_m):
        columns[f"field_{1000.0 * x_m:g}_degC"] = history.temperature_degC[:, i, run]
    for i, x_m in enumerate(history.position_m):
        columns[f"error_{1000.0 * x_m:g}_um"] = error_um[:, i, run]
    return columns


def measured(
    temperature_degC: FloatArray, noise_K: float, rng: np.random.Generator, step_K: float = 0.0
) -> FloatArray:
    """What a thermocouple shows: white noise, then rounding to the module's step."""
    shown = temperature_degC + noise_K * rng.standard_normal(temperature_degC.shape)
    return np.round(shown / step_K) * step_K if step_K else shown
