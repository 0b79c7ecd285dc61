"""What of a machine is only roughly known, as states beside its heats: learnt while it runs, or allowed for.

Each is a small change θ of the configuration. What it does to the plant is linear in θ,

    dx/dt = … + c(x, z, q) θ,        y_i = … + r_i(x, z) ρ,

with c the drive of a parameter of the machine, and r the row entry of one of a sensor: an offset adds 1, a
place ∂T/∂x, a lag −∂T/∂t. All wander as first-order Markov processes about nothing, in a day, so that none is
ever known for good. What is considered only (Schmidt 1966) keeps its value while its covariances are carried.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from observer.frames import FloatArray

WANDER_S = 86_400.0
"""In what time a parameter becomes another one, as films, clamps and laws do from day to day."""


class Kind(IntEnum):
    """What a state is of: the machine (up to `LAW`), or one of its sensors."""

    CONVECTION = 0
    CONDUCTIVITY = 1
    HEAT_CAPACITY = 2
    AMBIENT = 3
    END = 4
    LAW = 5
    OFFSET = 6
    PLACE = 7
    LAG = 8


class LearningArrays(NamedTuple):
    """What kernels need of L such states, the t of the machine before those of sensors; no state where L = 0.

    `kind` (L,) of each; `of` (L,) which end, estimated heat or sensor it is of; `sigma` (L,) its prior, in
    the unit of the state: relative to its value, or in K, W/K, m, s; `held` (h,) which are considered only.
    `film_1_s` is the rate of the base film; `uniform`, `decay_1_s` (n_x,) those of the modes, 0 beyond them;
    `ends_B`, `ends_C` (2, n_x) the column of 1 W into an end, and the row that reads its temperature;
    `slope_C` (s, n_x) the rows of ∂T/∂x at the sensors, K/m; `ambient` the column of z;
    `rest_P` (n_x, n_x), K², how far a screw is from the air's temperature after a night, where `rests` is 1.
    """

    machine: int
    kind: NDArray[np.int64]
    of: NDArray[np.int64]
    sigma: FloatArray
    held: NDArray[np.int64]
    film_1_s: float
    uniform: FloatArray
    decay_1_s: FloatArray
    ends_B: FloatArray
    ends_C: FloatArray
    slope_C: FloatArray
    ambient: int
    rests: int
    rest_P: FloatArray


@dataclass(frozen=True, slots=True)
class Learning:
    """The states, and what the learnt ones are called: `names` (l,), which `states` (l,) they are, and the
    `value` (l,) and `unit` (l,) in which they are told: value + unit · state.
    """

    arrays: LearningArrays
    names: tuple[str, ...]
    states: NDArray[np.int64]
    value: FloatArray
    unit: FloatArray

    def told(self, x: FloatArray, P: FloatArray) -> dict[str, tuple[float, float]]:
        """What is learnt, by name, with its σ: from the states (L,), the last of an estimator's, and their
        covariance (L, L).
        """
        value = self.value + self.unit * x[self.states]
        sigma = self.unit * np.sqrt(np.diag(P)[self.states])
        return dict(zip(self.names, zip(value.tolist(), sigma.tolist(), strict=True), strict=True))


def nothing_learnt(n_x: int, sensors: int) -> LearningArrays:
    """Return the arrays of a plant of which all is taken as the configuration says."""
    none = np.zeros(0, np.int64)
    return LearningArrays(
        0, none, none, np.zeros(0), none, 0.0, np.zeros(n_x), np.zeros(n_x), np.zeros((2, n_x)),
        np.zeros((2, n_x)), np.zeros((sensors, n_x)), 0, 0, np.zeros((n_x, n_x)),
    )  # fmt: skip
