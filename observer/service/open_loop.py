"""A log through the model alone: what the heat laws predict, how far the sensors are from that, and the log
that a prediction becomes.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

from observer.config import Config
from observer.files.logs import Log, read_log
from observer.frames import FloatArray, FrameBlock, Inputs
from observer.model.drive import Drive
from observer.model.plant import Plant
from observer.model.simulate import simulate, start, start_from_sensors


def predicted(
    plant: Plant, drive: Drive, blocks: Iterable[FrameBlock], start_degC: float | None = None
) -> Iterator[tuple[Inputs, FloatArray]]:
    """Give the inputs and the output rows (K, R) of each block, from the first frame on at which every input
    is known; the screw starts at `start_degC`, or as its sensors say.
    """
    drive_state, state = drive.initial(), None
    for frames in blocks:
        drive_state, inputs = drive.run(drive_state, frames)
        if state is None:
            first = np.flatnonzero(np.isfinite(inputs.z_end).all(axis=1))
            if not len(first):
                continue
            k = int(first[0])
            inputs = inputs.part(k)
            y = np.where(inputs.usable[0], inputs.y_degC[0], np.nan)
            if start_degC is None and np.isfinite(y).any():
                state = start_from_sensors(plant, y, plant.noise_R_K2, inputs.law_W[0], inputs.z_end[0])
            else:
                level = inputs.z_end[0, plant.known.ambient] if start_degC is None else start_degC
                state = start(plant, level, inputs.law_W[0])
        state, rows = simulate(plant, state, inputs)
        yield inputs, rows


def open_loop_rms_K(plant: Plant, drive: Drive, blocks: Iterable[FrameBlock]) -> dict[str, float | None]:
    """Return how far the prediction by the heat laws alone is from each sensor, K rms."""
    squares = np.zeros(plant.rows.sensors)
    count = np.zeros(plant.rows.sensors)
    for inputs, rows in predicted(plant, drive, blocks):
        gap = np.where(inputs.usable, inputs.y_degC - rows[:, plant.rows.sensor_slice], np.nan)
        squares += np.nansum(gap**2, axis=0)
        count += np.isfinite(gap).sum(axis=0)
    return {
        name: math.sqrt(s / n) if n else None
        for name, s, n in zip(plant.layout.sensors, squares, count, strict=True)
    }


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
