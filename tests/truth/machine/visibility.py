"""How far a hidden effect moves the sensors once everything that may be fitted has been fitted to it."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import numpy as np

from tests.truth.machine.cycles import RUNS
from tests.truth.machine.generate import Case, machine_of, trace
from tests.truth.machine.machine import Machine
from tests.truth.machine.physics import FloatArray

EVERY = 60
"""Steps between the rows looked at: half a minute."""
NUDGE = 0.02
"""Part by which a free parameter is changed for its derivative."""


ROUNDS, LEAST = 4, 0.05


def hidden_K(case: Case, runs: tuple[str, ...] = RUNS) -> FloatArray:
    """What is left at the sensors of the effects of a case after what the user may fit is refitted, (n, 5).

    Runs after each other, without noise. Gauss-Newton, derivatives those of the machine without effects.
    """
    plain = replace(case, effects=(), unknown=case.unmodelled)
    machine, wanted = machine_of(plain), _readings(case, machine_of(case), runs)
    reading, derivatives = _free(plain, runs)
    inverse = np.linalg.pinv(derivatives.reshape(-1, derivatives.shape[-1]))
    factors = np.ones(len(inverse))
    for _ in range(ROUNDS):
        factors = np.maximum(factors + inverse @ (wanted - reading).ravel(), LEAST)
        reading = _readings(plain, _scaled(machine, factors), runs)
    left = wanted - reading
    return np.asarray(left - derivatives @ (inverse @ left.ravel()))


def hidden_rms_K(case: Case, runs: tuple[str, ...] = RUNS) -> float:
    """Its root mean square over time and sensors."""
    return float(np.sqrt(np.mean(hidden_K(case, runs) ** 2)))


@lru_cache(maxsize=4)
def _free(case: Case, runs: tuple[str, ...]) -> tuple[FloatArray, FloatArray]:
    """The readings (n, 5) of a case and their derivatives (n, 5, p) by what its user may fit."""
    machine = machine_of(case)
    plain = _readings(case, machine, runs)
    free = int(machine.physics.film_W_m2K.any()) + np.count_nonzero(machine.physics.friction_W_rpm)
    nudged = [_scaled(machine, row) for row in 1.0 + NUDGE * np.eye(int(free))]
    return plain, np.stack([(_readings(case, m, runs) - plain) / NUDGE for m in nudged], axis=-1)


def _scaled(machine: Machine, factors: FloatArray) -> Machine:
    """The machine with what may be fitted times factors (p,): film and frictions, those that it has."""
    physics, rest = machine.physics, list(factors)
    film = physics.film_W_m2K * rest.pop(0) if physics.film_W_m2K.any() else physics.film_W_m2K
    friction = np.array([f * rest.pop(0) if f else 0.0 for f in physics.friction_W_rpm])
    return replace(machine, physics=physics._replace(film_W_m2K=film, friction_W_rpm=friction))


def _readings(case: Case, machine: Machine, runs: tuple[str, ...]) -> FloatArray:
    return np.vstack([trace(case, run, machine).reading_degC[::EVERY] for run in runs])
