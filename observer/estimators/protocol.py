"""Interface of estimators: designed once, then a pure step over blocks of inputs."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from observer.frames import EstimateBlock, FloatArray, Inputs, Layout
from observer.kernels.layout import Records, state_type

SENSOR_GUARD, SCREENING_VERDICT = state_type("SensorGuard"), state_type("ScreeningVerdict")


@dataclass(frozen=True, slots=True)
class EstimatorState:
    """The state of an estimator after a step.

    The n = n_x + m_e + L states are the plant's, the estimated heats' deviations from their laws, and the
    parameters. Their estimate is `x_hat` (n,), with the covariance `P` (n, n).

    | Field | Meaning |
    |---|---|
    | `started` | false until the first usable measurement |
    | `suspect` (s,), `refused_s` (s,) | steps and time for which a sensor has been rejected in a row |
    | `opened_K` (s,) | a sensor's innovation when the covariance was last opened for it |
    | `silent` | steps in a row without a good sensor |
    | `lost_s` | time for which the position of a nut has been unknown |
    | `gain_sensors` | sensors, as bits, of the designed gain in use |
    | `around` (n_x + m_e + 2 s,) | linearisation point of the parameters; empty if nothing is learnt |
    | `guard` (s,), `verdict` (1,) | memory of the screening (`kernels/states.pxd`); `guard` may be empty |
    | `bank` | bytes of the bank of filters (`observer.estimators.bank`), or empty |

    The linearisation point ends with each sensor's reading there, without and with a lag.
    """

    x_hat: FloatArray
    P: FloatArray
    started: bool
    suspect: FloatArray
    refused_s: FloatArray
    opened_K: FloatArray
    time_s: float
    silent: int = 0
    lost_s: float = 0.0
    gain_sensors: int = 0
    around: FloatArray = field(default_factory=lambda: np.zeros(0))
    guard: Records = field(default_factory=lambda: np.zeros(0, SENSOR_GUARD))
    verdict: Records = field(default_factory=lambda: np.zeros(1, SCREENING_VERDICT))
    bank: NDArray[np.uint8] = field(default_factory=lambda: np.zeros(0, np.uint8))


class Estimator(Protocol):
    """Turns inputs into estimates; holds no state of its own."""

    @property
    def layout(self) -> Layout:
        """The columns of the estimates."""

    def initial(self) -> EstimatorState:
        """Return the state before the first measurement."""

    def run(self, state: EstimatorState, inputs: Inputs) -> tuple[EstimatorState, EstimateBlock]:
        """Take K steps; a run of K is, to the last bit, K runs of one."""


@runtime_checkable
class CarriesOver(Estimator, Protocol):
    """An estimator whose `x_hat` and `P` are those of the plant and can be carried into another model."""

    def at(
        self, state: EstimatorState, x_hat: FloatArray, P: FloatArray, linearisation_point: FloatArray
    ) -> EstimatorState:
        """Return a state with field, heats and learnt parameters replaced."""
