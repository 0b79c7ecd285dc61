"""Short runs of the hidden-effect machine with sharp properties, for its tests."""

from __future__ import annotations

from typing import Any

import numpy as np

from tests.truth.machine.physics import FloatArray, Physics, plain_physics, steady_schedule
from tests.truth.machine.run import Result, run_machine

SLICES = 50


def bare(**changes: Any) -> Physics:
    """A screw that loses nothing and makes no heat."""
    still = {"film_W_m2K": np.zeros(SLICES), "friction_W_rpm": np.zeros(3)}
    return plain_physics(SLICES, **(still | changes))


def even(**changes: Any) -> Physics:
    """The same of a metal that conducts so well that it is nearly of one temperature."""
    return bare(conductivity_W_mK=1e6, **changes)


def at(index: int, value: float) -> FloatArray:
    """Three numbers of a friction or a body, all but one 0."""
    return np.where(np.arange(3) == index, value, 0.0)


def ran(
    physics: Physics, steps: int, step_s: float = 0.5, position_m: Any = (0.05, 0.5, 0.95), **changes: Any
) -> Result:
    """Run it; `changes` are of the schedule, a number is the same for all steps."""
    arrays = {
        key: np.full(steps, float(value))
        if np.isscalar(value) and key not in ("start_degC", "start_m")
        else value
        for key, value in changes.items()
    }
    return run_machine(physics, steady_schedule(steps, step_s, **arrays), np.array(position_m))
