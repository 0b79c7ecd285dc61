"""A program through the model: the log of inputs it starts from, and the log of predictions it becomes."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from observer.config import Config
from observer.files.logs import Log, read_log
from observer.frames import FloatArray
from observer.model.plant import Plant


def read_program(path: Path, config: Config) -> Log:
    """Read a program; sensors that it does not hold count as missing."""
    sensors = {s.channel for s in config.sensor}
    log = read_log(path)
    needed = [c for c in config.channels if c not in sensors or c in log.channels]
    log = read_log(path, needed)
    values = {c: log.values[:, i] for i, c in enumerate(log.channels)}
    nothing = np.full(len(log), np.nan)
    return replace(
        log,
        channels=config.channels,
        values=np.column_stack([values.get(c, nothing) for c in config.channels]),
    )


def simulated_columns(
    config: Config, plant: Plant, log: Log, time_s: FloatArray, law_W: FloatArray, rows: FloatArray
) -> dict[str, FloatArray]:
    """Return the columns of a simulated log: sensors, inputs, heats, field, thermal error."""
    meaning, layout = plant.rows, plant.layout
    sensors = {s.channel for s in config.sensor}
    columns = {s.channel: rows[:, i] for i, s in enumerate(config.sensor)}
    at = np.searchsorted(log.time_s, time_s)
    columns |= {c: log.values[at, i] for i, c in enumerate(log.channels) if c not in sensors}
    columns |= {f"heat_{name}_W": law_W[:, j] for j, name in enumerate(plant.source_names)}
    places = [f"{1000 * x_m:.10g}" for x_m in layout.position_m]
    columns |= {f"field_{mm}_degC": rows[:, meaning.sensors + i] for i, mm in enumerate(places)}
    if layout.has_error:
        error_um = meaning.error_um(rows)
        columns |= {f"error_{mm}_um": error_um[:, i] for i, mm in enumerate(places)}
    return columns
