"""What an observer makes of a day, held against its truth."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from observer.align.aligner import AlignPlan, frames_of_log
from observer.config.machine import Config
from observer.estimate.pipeline import MachineModel
from observer.files.logs import Log
from observer.fit.calibrate import calibrate
from observer.fit.process_noise import fit_noise
from observer.frames import EstimateBlock, FloatArray
from observer.installation import write_back
from tests.learning.machines import Day, config_of
from tests.truth.machine.logs import CHANNELS

FROM_S = 600.0
"""Estimates are judged from ten minutes on."""
QUANTITIES = ("heats", "nut", "field", "error")
TWO_SIDED_95 = 1.96


def log_of(day: Day) -> Log:
    """A day as the log that its user has."""
    values = np.column_stack([day.sensor_degC, day.nut_m, day.speed_rpm, day.air_degC])
    sensors = CHANNELS[: day.sensor_degC.shape[1]]
    return Log(Path("day.csv"), day.time_s, (*sensors, *CHANNELS[-3:]), values)


def estimates(config: Config, day: Day) -> EstimateBlock:
    """What the observer of a configuration estimates over a day."""
    return estimates_of_log(config, log_of(day))


def estimates_of_log(config: Config, log: Log) -> EstimateBlock:
    """What the observer of a configuration estimates over a log."""
    machine = MachineModel.of(config, learns=True)
    pipeline = machine.pipeline(machine.estimator())
    pipeline.gap = None  # it watches beside, for as long again, without a word in an estimate
    return EstimateBlock.joined([pipeline.step(frames) for frames in frames_of_log(log, machine.plan)])


def calibrated(text: str, day: Day) -> str:
    """The text of a configuration with what a calibration by a day writes into it."""
    config = config_of(text)
    runs = [list(frames_of_log(log_of(day), AlignPlan.of(config)))]
    found = calibrate(config, runs)
    return write_back(text, found.values | found.left | fit_noise(found.config, runs))


def misses(
    block: EstimateBlock, day: Day, from_s: float = FROM_S
) -> dict[str, tuple[FloatArray, FloatArray]]:
    """Error and σ of each quantity from a time on, (n, …)."""
    late = day.time_s - day.time_s[0] >= from_s
    heat = (block.heat_W - day.heat_W)[late], block.heat_sigma_W[late]
    return {
        "heats": heat,
        "nut": (heat[0][:, :1], heat[1][:, :1]),
        "field": ((block.field_degC - day.field_degC)[late], block.field_sigma_K[late]),
        "error": ((block.error_um - day.error_um)[late, 1:], block.error_sigma_um[late, 1:]),
    }


def judged(config: Config, day: Day) -> dict[str, tuple[float, float, float]]:
    """The rms error of each quantity, the part of it that lies within the 95 % interval, and the mean σ."""
    return judged_estimates(estimates(config, day), day)


def judged_estimates(
    found: EstimateBlock, day: Day, from_s: float = FROM_S
) -> dict[str, tuple[float, float, float]]:
    """The same of estimates that are there already, from a time on."""
    return {
        name: (
            float(np.sqrt(np.mean(error**2))),
            float(np.mean(np.abs(error) <= TWO_SIDED_95 * sigma)),
            float(np.mean(sigma)),
        )
        for name, (error, sigma) in misses(found, day, from_s).items()
    }
