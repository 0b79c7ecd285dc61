"""A rough machine with a chiller's coolant in its bore, whose inlet the observer knows or not."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from observer.files.logs import Log
from observer.frames import EstimateBlock
from tests.learning.cover import estimates_of_log, log_of
from tests.learning.machines import CONFIG, Day, Rough, config_of, draw, work
from tests.truth.machine.cycles import START_m, programme
from tests.truth.machine.machine import stream
from tests.truth.machine.physics import FloatArray

INLET_DEGC, HYSTERESIS_K, WARMS_K_H = 20.0, 2.5, 1.0
"""Where the chiller is set, by how much it misses it to either side, and how fast its tank warms beside."""
CONDUCTANCE_W_K, FITTED = 2.5, 0.05
"""From screw to coolant as configured, and how far the true one is from that: as a calibration leaves it."""
CALIBRATED = Rough(0.05, 0.01, 0.05, 0.0, 0.1, 0.002, 0.2, 0.02)
"""A machine as a calibration leaves it; of one as rough as most, film and laws are off by more than that."""
SENSORS = ("t1", "t3", "t5")
EFFECT = f"""
[[effect]]
kind = "coolant"
conductance_W_K = {CONDUCTANCE_W_K}
"""
CONSTANT, MEASURED = f"inlet_degC = {INLET_DEGC}\n", 'inlet_channel = "coolant_degC"\n'


class Cooled(NamedTuple):
    """A day, and its log with the coolant's inlet (n,)."""

    day: Day
    log: Log
    inlet_degC: FloatArray


def chiller_K(time_s: FloatArray, period_s: float, phase: float) -> FloatArray:
    """How far a two-point chiller's outlet is from where it is set: it warms for two thirds of its cycle and
    cools for one, and its tank warms by and by.
    """
    part = np.mod(time_s / period_s + phase, 1.0)
    saw = np.where(part < 2 / 3, 3.0 * part - 1.0, 5.0 - 6.0 * part)
    return np.asarray(HYSTERESIS_K * saw + WARMS_K_H * time_s / 3600.0)


def cooled(seed: int, number: int, run: str, rough: Rough = CALIBRATED, fitted: float = FITTED) -> Cooled:
    """Run a machine whose bore a chiller cools while it turns."""
    specimen, rng = draw(seed, number, rough), stream(seed, "chiller", str(number))
    conductance_W_K = CONDUCTANCE_W_K * (1.0 + fitted * rng.uniform(-1.0, 1.0))
    period_s, phase = rng.uniform(900.0, 2400.0), rng.uniform()
    physics = specimen.machine.physics._replace(coolant_W_K=conductance_W_K, inlet_degC=INLET_DEGC)
    specimen = replace(specimen, machine=replace(specimen.machine, physics=physics))

    def inlet_K(time_s: FloatArray) -> FloatArray:
        return chiller_K(time_s, period_s, phase)

    own = stream(seed, "day", str(number), run)
    day = work(specimen, programme("standard", run, own), START_m[run], own, 0.0, inlet_K=inlet_K)
    inlet_degC = np.round(INLET_DEGC + inlet_K(day.time_s) + 0.05 * rng.standard_normal(len(day.time_s)), 1)
    log = log_of(day)
    values = np.column_stack([log.values, inlet_degC])
    return Cooled(
        day,
        replace(log, path=Path("cooled.csv"), channels=(*log.channels, "coolant_degC"), values=values),
        inlet_degC,
    )


def estimates(log: Log, inlet: str) -> EstimateBlock:
    """What the observer estimates with three sensors, where the coolant's inlet is given as `inlet`."""
    config = config_of(CONFIG, EFFECT + inlet)
    own = tuple(sensor for sensor in config.sensor if sensor.name in SENSORS)
    return estimates_of_log(config.model_copy(update={"sensor": own}), log)
