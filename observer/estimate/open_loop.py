"""A log through the model alone: what the heat laws predict, how far the sensors are from that, and the log
that a prediction becomes.
"""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np

from observer.config import Config
from observer.files.logs import Log, read_log
from observer.frames import FloatArray, FrameBlock, Inputs
from observer.model.drive import Drive
from observer.model.plant import Plant
from observer.model.simulate import simulate, start, start_from_sensors


class OpenLoop:
    """A prediction by the heat laws alone, from the first frame on at which every input is known.

    The screw starts at `start_degC`, or as its sensors say.
    """

    def __init__(self, plant: Plant, drive: Drive, start_degC: float | None = None) -> None:
        self._plant, self._drive, self._start_degC = plant, drive, start_degC
        self._drive_state = drive.initial()
        self._state: FloatArray | None = None

    def run(self, frames: FrameBlock) -> tuple[Inputs, FloatArray] | None:
        """Give the inputs and the output rows (K, R) of the next frames, None before the first."""
        self._drive_state, inputs = self._drive.run(self._drive_state, frames)
        if self._state is None:
            known = np.flatnonzero(np.isfinite(inputs.z_end).all(axis=1))
            if not len(known):
                return None
            inputs = inputs.part(int(known[0]))
            self._state = self._begin(inputs)
        self._state, rows = simulate(self._plant, self._state, inputs)
        return inputs, rows

    def _begin(self, inputs: Inputs) -> FloatArray:
        plant, law_W, z = self._plant, inputs.law_W[0], inputs.z_end[0]
        y = np.where(inputs.usable[0], inputs.y_degC[0], np.nan)
        if self._start_degC is None and np.isfinite(y).any():
            return start_from_sensors(plant, y, plant.noise_R_K2, law_W, z)
        return start(plant, z[plant.known.ambient] if self._start_degC is None else self._start_degC, law_W)


def gap_K(plant: Plant, inputs: Inputs, rows: FloatArray) -> FloatArray:
    """How far each usable reading (K, s) is from its prediction, NaN where there is none."""
    return np.where(inputs.usable, inputs.y_degC - rows[:, plant.rows.sensor_slice], np.nan)


class OpenLoopGap:
    """How far the prediction by the heat laws alone is from each sensor over a log."""

    def __init__(self, plant: Plant, drive: Drive) -> None:
        self._plant, self._loop = plant, OpenLoop(plant, drive)
        self._squares_K2 = np.zeros(plant.rows.sensors)
        self._count = np.zeros(plant.rows.sensors)

    def take(self, frames: FrameBlock) -> None:
        """Take the next frames."""
        if (found := self._loop.run(frames)) is not None:
            gap = gap_K(self._plant, *found)
            self._squares_K2 += np.nansum(gap**2, axis=0)
            self._count += np.isfinite(gap).sum(axis=0)

    @property
    def rms_K(self) -> dict[str, float | None]:
        """The gap by sensor so far, None where there is none."""
        sums = zip(self._plant.layout.sensors, self._squares_K2, self._count, strict=True)
        return {name: math.sqrt(s / n) if n else None for name, s, n in sums}


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
    columns |= layout.along(field__degC=rows[:, meaning.field_slice])
    return columns | (layout.along(error__um=meaning.error_um(rows)) if layout.has_error else {})
