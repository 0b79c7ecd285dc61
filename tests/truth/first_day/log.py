"""A shift of a machine as the service records it, ten rows a second, and the truth, a row a second.

The position is in each row, temperatures only where the module has converted them.
"""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np

from tests.truth.first_day.machine import FirstDayMachine, FloatArray, SensorError, sensor_stream
from tests.truth.first_day.thermal import (
    AIR,
    BRACKET,
    LEFT,
    LOOKS,
    RIGHT,
    STEP_s,
    Thermal,
    Work,
    averaged,
    error_um,
    field_degC,
)  # fmt: skip
from tests.truth.machine.logs import write_log

SENSORS = ("nut_body", "left_housing", "right_housing")
READ = (BRACKET, LEFT, RIGHT)
CONVERSION_s, COUNT_K = 0.5, 0.1
TRUTH_EVERY = 10
BLOCK = 600
FORMATS = {f"{name}_degC": "%.1f" for name in SENSORS} | {
    "nut_position_m": "%.6f",
    "screw_speed_rpm": "%.0f",
    "ambient_degC": "%.1f",
}


class Shift(NamedTuple):
    """A logged shift, and each second the truth."""

    time_s: FloatArray  # (K,)
    readings: FloatArray  # (K, 6) in the order of `FORMATS`
    true_time_s: FloatArray  # (k,)
    heat_W: FloatArray  # (k, 3) of nut, left and right bearing
    screw_degC: FloatArray  # (k, cells)
    body_degC: FloatArray  # (k, bodies)


class Readings:
    """The thermocouple module: lag, gain, offset, noise, and every half second a count of 0.1 °C."""

    def __init__(self, machine: FirstDayMachine, start_degC: FloatArray) -> None:
        """Begin with sensors as warm as what they sit on: bracket, left and right housing, air (4,)."""
        self._machine, self._rng = machine, sensor_stream(machine.number)
        errors: tuple[SensorError, ...] = (*machine.sensors, machine.air_sensor)
        offset_K, lag_s, gain = np.array(errors).T
        self._offset_K, self._lag_s, self._shown = offset_K, lag_s, 1.0 - gain
        self._sensor_degC = start_degC.copy()
        self._due_s = 0.0

    def after(self, time_s: float, at_degC: FloatArray) -> FloatArray:
        """Return the readings (4,) at a time, a step after the last, in °C; NaN between conversions."""
        self._sensor_degC += (at_degC - self._sensor_degC) * (STEP_s / np.maximum(self._lag_s, STEP_s))
        if time_s < self._due_s - STEP_s / 2.0:
            return np.full(len(at_degC), np.nan)
        self._due_s += CONVERSION_s
        air_degC = self._sensor_degC[-1]
        shown_degC = air_degC + self._shown * (self._sensor_degC - air_degC) + self._offset_K
        noisy_degC = shown_degC + self._machine.noise_K * self._rng.standard_normal(len(shown_degC))
        return np.asarray(np.round(noisy_degC / COUNT_K) * COUNT_K)


def shift_of(machine: FirstDayMachine, hours: float) -> Shift:
    """Simulate a shift from a cold start on."""
    steps = round(3600.0 * hours / STEP_s)
    programme, thermal = machine.programme(hours), Thermal(machine)
    sensed = np.array([*READ, AIR])
    module = Readings(machine, thermal.body_degC[sensed])
    counts_degC = np.empty((steps, len(sensed)))
    heats, screws, bodies = [], [], []
    looks_s = (np.arange(BLOCK * LOOKS) + 0.5) * STEP_s / LOOKS
    for begin in range(0, steps, BLOCK):
        work = averaged(machine, programme.at(begin * STEP_s + looks_s))
        for step, row in enumerate(zip(*work, strict=True), begin):
            if step == steps:
                break
            thermal.advance(STEP_s, Work(*row))
            counts_degC[step] = module.after(step * STEP_s, thermal.body_degC[sensed])
            if step % TRUTH_EVERY == 0:
                heats.append(thermal.heats)
                screws.append(thermal.screw_degC)
                bodies.append(thermal.body_degC)
    time_s = np.round((np.arange(steps) + 1) * STEP_s, 1)
    axis = programme.at(time_s)
    rpm = axis.velocity_m_s / machine.screw.lead_m * 60.0
    readings = np.column_stack([counts_degC[:, :3], axis.position_m, rpm, counts_degC[:, 3]])
    return Shift(time_s, readings, time_s[::TRUTH_EVERY], np.array(heats), np.array(screws), np.array(bodies))


def write_shift(folder: Path, machine: FirstDayMachine, shift: Shift, positions_m: FloatArray) -> None:
    """Write `log.csv.gz`, and `truth.csv.gz` with the columns of `estimates.csv` at the places (g,).

    The thermal error is 0 at the first logged temperature of the air, as the product's pages define it.
    `growth_…` is the growth since the start.
    """
    write_log(folder / "log.csv.gz", shift.time_s, shift.readings, FORMATS)
    zero_degC = float(np.round(shift.readings[0, -1], 1))
    columns = {
        "heat_{}_W": (("nut", "left_bearing", "right_bearing"), shift.heat_W),
        "field_{}_degC": (_millimetres(positions_m), field_degC(machine, shift.screw_degC, positions_m)),
        "error_{}_um": (
            _millimetres(positions_m),
            error_um(machine, shift.screw_degC, positions_m, zero_degC),
        ),
        "growth_{}_um": (
            _millimetres(positions_m),
            error_um(machine, shift.screw_degC, positions_m, shift.screw_degC[0]),
        ),
    }
    formats = {pattern.format(name): "%.3f" for pattern, (names, _) in columns.items() for name in names}
    write_log(
        folder / "truth.csv.gz", shift.true_time_s, np.hstack([v for _, v in columns.values()]), formats
    )


def _millimetres(positions_m: FloatArray) -> list[str]:
    return [f"{1000.0 * x_m:g}" for x_m in positions_m]
