"""Open-loop prediction by the heat laws alone, and the residual of readings to it."""

from __future__ import annotations

import math

import numpy as np

from observer.config.machine import Config
from observer.frames import FloatArray, FrameBlock, Inputs
from observer.model.beginning import Beginning, beginning
from observer.model.drive import Drive
from observer.model.plant import Plant
from observer.model.simulate import simulate, start_from_sensors


class OpenLoop:
    """A prediction by the heat laws alone, from the first frame on at which every input is known.

    Args:
        plant: The plant.
        drive: Turns frames into its inputs.
        start_degC: The screw's temperature at the start, in °C; None takes it from the sensors, or from the
            air if no sensor has a value.
        config: With it, the response to ends and air at other temperatures is that of a screw of many modes;
            None takes that of the plant's modes.
    """

    def __init__(
        self, plant: Plant, drive: Drive, start_degC: float | None = None, config: Config | None = None
    ) -> None:
        self._plant, self._drive, self._start_degC, self._config = plant, drive, start_degC, config
        self._drive_state = drive.initial()
        self._state: FloatArray | None = None
        self._begun: Beginning | None = None

    def run(self, frames: FrameBlock) -> tuple[Inputs, FloatArray] | None:
        """Predict over the next frames.

        Returns:
            Inputs, and output rows (K, R) in °C and µm, from the first complete frame on; None before all
            inputs are known.
        """
        self._drive_state, inputs = self._drive.run(self._drive_state, frames)
        if self._state is None:
            complete = np.flatnonzero(np.isfinite(inputs.z_end).all(axis=1))
            if not len(complete):
                return None
            inputs = inputs.part(int(complete[0]))
            at_start = np.arange(len(inputs)) == 0  # the first row is the start itself
            inputs = inputs._replace(dt_s=np.where(at_start, 0.0, inputs.dt_s))
            self._state = self._begin(inputs)
        self._state, rows = simulate(self._plant, self._state, inputs)
        if self._begun is not None:
            self._begun.add_to(rows, inputs.time_s)
        return inputs, rows

    def _begin(self, inputs: Inputs) -> FloatArray:
        plant, law_W, z = self._plant, inputs.law_W[0], inputs.z_end[0]
        y = np.where(inputs.usable[0] & plant.thermal, inputs.y_degC[0], np.nan)
        if self._start_degC is None and np.isfinite(y).any():
            return start_from_sensors(plant, y, plant.noise_R_K2, law_W, z)
        temperature_degC = float(z[plant.known.ambient]) if self._start_degC is None else self._start_degC
        self._begun = beginning(plant, self._config, temperature_degC, z, float(inputs.time_s[0]))
        return self._begun.x


_OPPOSED = -0.5
"""With a lower correlation to its prediction, a displacement has the wrong sign."""
_MOVED = 3.0
"""The sign is tested only for predictions that vary by more than this times the noise."""


class OpenLoopGap:
    """The open-loop residual of each sensor over a log, and displacements with the wrong sign.

    Args:
        plant: The plant.
        drive: Turns frames into its inputs.
    """

    def __init__(self, plant: Plant, drive: Drive) -> None:
        self._plant, self._loop = plant, OpenLoop(plant, drive)
        self._squares_K2 = np.zeros(plant.rows.sensors)
        self._count = np.zeros(plant.rows.sensors)
        self._products = np.zeros((5, plant.rows.sensors))

    def take(self, frames: FrameBlock) -> None:
        """Take the next frames of the log, in order."""
        if (predicted := self._loop.run(frames)) is not None:
            inputs, rows = predicted
            prediction = rows[:, self._plant.rows.sensor_slice]
            gap = np.where(inputs.usable, inputs.y_degC - prediction, np.nan)
            self._squares_K2 += np.nansum(gap**2, axis=0)
            is_usable = np.isfinite(gap)
            self._count += is_usable.sum(axis=0)
            y = np.where(is_usable, inputs.y_degC, 0.0)
            p = np.where(is_usable, prediction, 0.0)
            self._products += [column.sum(axis=0) for column in (y, p, y * y, p * p, y * p)]

    @property
    def opposed(self) -> dict[str, float]:
        """The correlation with its prediction of each displacement sensor with the wrong sign, at most −0.5.

        A sensor whose prediction hardly varies is not judged.
        """
        y, p, yy, pp, yp = self._products / np.maximum(self._count, 1.0)
        moved = pp - p * p > _MOVED**2 * self._plant.noise_R_K2
        spread = np.sqrt(np.maximum((yy - y * y) * (pp - p * p), 1e-30))
        correlations = zip(
            self._plant.layout.sensors, self._plant.layout.units, moved, (yp - y * p) / spread, strict=True
        )
        return {
            name: float(r)
            for name, unit, has_moved, r in correlations
            if unit == "um" and has_moved and r <= _OPPOSED
        }

    @property
    def rms_K(self) -> dict[str, float | None]:
        """The rms residual by thermocouple so far, in K; None without a reading."""
        return self._rms("K")

    @property
    def rms_um(self) -> dict[str, float | None]:
        """The rms residual by displacement sensor so far, in µm; None without a reading."""
        return self._rms("um")

    def _rms(self, unit: str) -> dict[str, float | None]:
        layout = self._plant.layout
        sums = zip(layout.sensors, layout.units, self._squares_K2, self._count, strict=True)
        return {
            name: math.sqrt(s / n) if n else None for name, sensor_unit, s, n in sums if sensor_unit == unit
        }
