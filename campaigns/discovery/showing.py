"""Where and when a hidden thing shows: by the machine itself, not by the workflow."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tests.truth.machine.cycles import RUNS
from tests.truth.machine.generate import Case, trace
from tests.truth.machine.machine import SENSORS
from tests.truth.machine.sensing import NOISE_K
from tests.truth.machine.visibility import EVERY, hidden_K

MUCH = 0.6
"""A sensor or phase with this part of the strongest's rms is a right answer to "where?"."""
RUNNING, RESTING = ("heat_up", "steady"), ("isothermal", "dwell", "cool_down")


@dataclass(frozen=True)
class Showing:
    """What is left at the sensors after the user's parameters are refitted: how much, at which, when."""

    rms_K: float
    sensors: tuple[str, ...]
    phases: tuple[str, ...]

    @property
    def sigma(self) -> float:
        """In standard deviations of a sample's noise."""
        return self.rms_K / NOISE_K


def showing_of(case: Case) -> Showing:
    """Find it out by running the machine with and without what is hidden."""
    left_K = hidden_K(case)
    by_sensor = np.sqrt(np.mean(left_K**2, axis=0))
    sensors = tuple(s for s, rms in zip(SENSORS, by_sensor, strict=False) if rms >= MUCH * by_sensor.max())
    turning = _turning(case)
    phases = {
        phases: float(np.sqrt(np.mean(left_K[rows] ** 2))) if rows.any() else 0.0
        for phases, rows in ((RUNNING, turning), (RESTING, ~turning))
    }
    strong = [name for group, rms in phases.items() if rms >= MUCH * max(phases.values()) for name in group]
    return Showing(float(np.sqrt(np.mean(left_K**2))), sensors, tuple(strong))


def _turning(case: Case) -> np.ndarray:
    """Whether the screw turns at each of the rows of `hidden_K`, (n,)."""
    parts = []
    for run in RUNS:
        speed_rpm = trace(case, run).scene.schedule.speed_rpm
        parts.append(np.append(speed_rpm, speed_rpm[-1])[::EVERY] != 0.0)
    return np.concatenate(parts)
