"""What goes wrong in values that look like values: each fault changes what a log says from one time on.

A fault is in the reading as the log has it, after noise and rounding, except where it is one of either.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from tests.truth.machine.machine import SENSORS
from tests.truth.machine.physics import FloatArray
from tests.truth.machine.sensing import NOISE_K

STEP_K = 0.01
"""In which readings are written."""


class Readings(NamedTuple):
    """What a log says from the fault on: rows (n,), sensors (n, 5); `since_s` counts from the fault."""

    since_s: FloatArray
    sensor_degC: FloatArray
    nut_m: FloatArray
    air_degC: FloatArray


Change = Callable[[Readings, np.random.Generator], Readings]


@dataclass(frozen=True)
class Fault:
    """A fault: its name, its group, the sensors that are at fault, and what it does to readings."""

    name: str
    group: str
    sensors: tuple[str, ...]
    change: Change


def written(degC: FloatArray) -> FloatArray:
    """Readings in the steps of a log."""
    return np.asarray(np.round(degC / STEP_K) * STEP_K)


def _of(sensors: tuple[str, ...]) -> list[int]:
    return [SENSORS.index(name) for name in sensors]


def _sensors(sensors: tuple[str, ...], to: Callable[[FloatArray, Readings], FloatArray]) -> Change:
    """A change of the columns (n, s) of some sensors."""

    def change(readings: Readings, rng: np.random.Generator) -> Readings:
        value = readings.sensor_degC.copy()
        value[:, _of(sensors)] = written(to(value[:, _of(sensors)], readings))
        return readings._replace(sensor_degC=value)

    return change


def offset(sensors: tuple[str, ...], *size_K: float) -> Change:
    """Sensors read more by one size, or each by its own."""
    return _sensors(sensors, lambda value, _: value + np.array(size_K))


def drift(sensors: tuple[str, ...], rate_K_h: float, most_K: float = np.inf) -> Change:
    """Sensors read more by so much an hour, up to a size."""

    def to(value: FloatArray, readings: Readings) -> FloatArray:
        return value + np.minimum(rate_K_h * readings.since_s[:, None] / 3600.0, most_K)

    return _sensors(sensors, to)


def gain(sensors: tuple[str, ...], factor: float) -> Change:
    """Sensors show a part of their rise above the air."""

    def to(value: FloatArray, readings: Readings) -> FloatArray:
        air_degC = readings.air_degC[:, None]
        return air_degC + factor * (value - air_degC)

    return _sensors(sensors, to)


def coarse(sensors: tuple[str, ...], step_K: float) -> Change:
    """Sensors are read in coarse steps."""
    return _sensors(sensors, lambda value, _: np.round(value / step_K) * step_K)


def spikes(sensors: tuple[str, ...], size_K: float, every_s: float) -> Change:
    """One row in a while is off."""

    def to(value: FloatArray, readings: Readings) -> FloatArray:
        return value + np.where(readings.since_s[:, None] % every_s < 1.0, size_K, 0.0)

    return _sensors(sensors, to)


def now_and_then(sensors: tuple[str, ...], size_K: float, on_s: float, off_s: float) -> Change:
    """An offset that comes and goes."""

    def to(value: FloatArray, readings: Readings) -> FloatArray:
        return value + np.where(readings.since_s[:, None] % (on_s + off_s) < on_s, size_K, 0.0)

    return _sensors(sensors, to)


def exchanged(of: Mapping[str, str]) -> Change:
    """Each sensor named shows another's reading."""

    def change(readings: Readings, rng: np.random.Generator) -> Readings:
        value = readings.sensor_degC.copy()
        value[:, _of(tuple(of))] = readings.sensor_degC[:, _of(tuple(of.values()))]
        return readings._replace(sensor_degC=value)

    return change


def held(sensors: tuple[str, ...]) -> Change:
    """Sensors stay at the value they have, with the noise of a healthy one."""

    def change(readings: Readings, rng: np.random.Generator) -> Readings:
        value, columns = readings.sensor_degC.copy(), _of(sensors)
        noise_K = NOISE_K * rng.standard_normal((len(value), len(columns)))
        value[:, columns] = written(value[:10, columns].mean(axis=0) + noise_K)
        return readings._replace(sensor_degC=value)

    return change


def noisy(sensors: tuple[str, ...], times: float) -> Change:
    """Noise of so many times the usual."""

    def change(readings: Readings, rng: np.random.Generator) -> Readings:
        value, columns = readings.sensor_degC.copy(), _of(sensors)
        more_K = NOISE_K * np.sqrt(times**2 - 1.0)
        value[:, columns] = written(
            value[:, columns] + more_K * rng.standard_normal((len(value), len(columns)))
        )
        return readings._replace(sensor_degC=value)

    return change


def nut_off(by_m: float) -> Change:
    """The nut's position is off, as after a wrong homing."""
    return lambda readings, _: readings._replace(nut_m=readings.nut_m + by_m)


def nut_held(readings: Readings, rng: np.random.Generator) -> Readings:
    """The nut's position stays where it is."""
    return readings._replace(nut_m=np.full_like(readings.nut_m, readings.nut_m[0]))


def air_off(size_K: float, within_s: float = 0.0) -> Change:
    """What the ambient sensor reads is off: at once, or as a heater beside it warms it up."""

    def change(readings: Readings, rng: np.random.Generator) -> Readings:
        share = 1.0 - np.exp(-readings.since_s / within_s) if within_s else 1.0
        return readings._replace(air_degC=np.round(readings.air_degC + size_K * share, 2))

    return change


def nothing(readings: Readings, rng: np.random.Generator) -> Readings:
    """Nothing is wrong."""
    return readings
