"""One machine with its sensors, drawn at random around what its configuration says."""

from __future__ import annotations

import zlib
from dataclasses import dataclass, field, replace

import numpy as np

from tests.truth.machine.grid import Grid, build_grid
from tests.truth.machine.physics import FloatArray, Physics, plain_physics
from tests.truth.machine.run import RINGS

SLICES = 100
SENSOR_M = np.array([0.05, 0.28, 0.5, 0.72, 0.95])
SENSORS = ("t1", "t2", "t3", "t4", "t5")
SOURCES = ("nut", "left_bearing", "right_bearing")
ENDS = ("left", "right")


@dataclass(frozen=True)
class Machine:
    """A screw, what its thermocouples add, and how far the air near it is from the logged one."""

    physics: Physics
    lag_s: FloatArray  # (5,)
    offset_K: FloatArray  # (5,)
    drift_K_h: FloatArray  # (5,)
    air_drift_K_h: float = 0.0
    sensor_m: FloatArray = field(default_factory=lambda: SENSOR_M)  # (5,) where they really sit
    step_K: float = 0.01  # the resolution of their module
    toward_air: FloatArray = field(default_factory=lambda: np.zeros(5))  # (5,) of their rise, not given

    @property
    def grid(self) -> Grid:
        """Its mesh."""
        return build_grid(self.physics, len(self.physics.film_W_m2K), RINGS)


def stream(seed: int, *names: str) -> np.random.Generator:
    """Random numbers that depend on a seed and on names only, each purpose its own."""
    return np.random.default_rng(np.random.SeedSequence([seed, *(zlib.crc32(n.encode()) for n in names)]))


def plain_machine() -> Machine:
    """The machine exactly as configured, with quick and true sensors."""
    return Machine(plain_physics(SLICES), np.zeros(5), np.zeros(5), np.zeros(5))


def draw_machine(seed: int, name: str) -> Machine:
    """A machine that differs from its configuration as machines do.

    k and ρc are off by 1–2 %, the film is 13.5–16 W/m²K in place of 15 and uneven by 1 %, torque and bearing
    heats are off by up to 15 %, the thermocouples lag by 2–4 s.
    """
    rng = stream(seed, name, "machine")
    plain = plain_physics(SLICES)
    off = 1.0 + rng.choice([-1.0, 1.0], 2) * rng.uniform(0.01, 0.02, 2)
    film = rng.uniform(13.5, 16.0) * _uneven(rng)
    physics = plain._replace(
        conductivity_W_mK=plain.conductivity_W_mK * off[0],
        capacity_J_m3K=plain.capacity_J_m3K * off[1],
        film_W_m2K=film,
        friction_W_rpm=plain.friction_W_rpm * rng.uniform(0.85, 1.15, 3),
    )
    return Machine(physics, rng.uniform(2.0, 4.0, 5), np.zeros(5), np.zeros(5))


def as_users_have_it(machine: Machine, seed: int, name: str) -> Machine:
    """A machine with the sensors of a typical user: off by 0.3 K and 2 mm, read in steps of 0.1 K, on a screw
    whose conductivity is 5 % off.
    """
    rng = stream(seed, name, "user")
    physics = machine.physics
    conductivity = plain_physics(SLICES).conductivity_W_mK * (1.0 + 0.05 * rng.choice([-1.0, 1.0]))
    return replace(
        machine,
        physics=physics._replace(conductivity_W_mK=conductivity),
        offset_K=0.3 * rng.standard_normal(5),
        sensor_m=SENSOR_M + 0.002 * rng.standard_normal(5),
        step_K=0.1,
    )


def _uneven(rng: np.random.Generator) -> FloatArray:
    """A smooth profile along the screw, mean 1, at most 1 % off, (SLICES,)."""
    x = (np.arange(SLICES) + 0.5) / SLICES
    wave = np.arange(1, 5)
    shape = rng.normal(size=4) / wave @ np.cos(np.pi * np.outer(wave, x))
    return np.asarray(1.0 + 0.01 * shape / np.abs(shape).max())
