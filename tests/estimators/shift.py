"""The standard shift of a machine with one nut as a log: what an estimator takes over it."""

from __future__ import annotations

import numpy as np

from observer.config import Config
from observer.discovery.experiment import Habits, Phase, frames_of
from observer.estimate.machine import Machine
from observer.frames import Inputs
from observer.model import simulate
from observer.model.cycle import SHIFT, SPEED_RPM

LOW_m, HIGH_m, AIR_degC = 0.15, 0.80, 22.0


def simulated(config: Config) -> tuple[Machine, Inputs]:
    """A machine that is as configured, and its inputs, a step a second, with the noise of its sensors."""
    machine = Machine.of(config, learns=True)
    middle_m = (LOW_m + HIGH_m) / 2
    phases = [
        Phase(duration_s, SPEED_RPM * works, *((LOW_m, HIGH_m) if works else (middle_m, middle_m + 1e-4)))
        for duration_s, works in SHIFT
    ]
    frames = frames_of(config, phases, Habits(SPEED_RPM, SPEED_RPM, LOW_m, HIGH_m, 0.01, AIR_degC))
    _, u = machine.drive.run(machine.drive.initial(), frames)
    plant, s = machine.plant, machine.plant.rows.sensors
    _, rows = simulate.simulate(plant, simulate.start(plant, AIR_degC, u.law_W[0]), u)
    noise_K = np.random.default_rng(1).standard_normal((len(u), s)) * np.sqrt(plant.noise_R_K2)
    return machine, u._replace(y_degC=rows[:, :s] + noise_K)
