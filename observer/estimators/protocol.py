"""What every estimator is: designed once, then a pure step over blocks of inputs."""

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
    """Where an estimator stands after a step.

    Shapes, with n = n_x + m_e + L (plant states, then the estimated heats' deviations from their laws, then
    what is learnt or considered): `x_hat` (n,), `P` (n, n). `started` is false until the first usable
    measurement. `suspect` (s,) counts the steps for which each sensor has been refused in a row, `refused_s`
    (s,) for how long, and `opened_K` (s,) how far off it was when the state was last opened for it; `silent`
    counts the steps in a row in which no sensor was good; for `lost_s` the place of a nut has not been known.
    `gain_sensors` are the sensors, as bits, of the given gain in use. `around` (n_x + m_e + 2 s,) is where
    the effects of what is learnt are taken, with what each sensor would read there without and with a lag;
    empty where nothing is learnt. `guard` (s,) and `verdict` (1,) are
    what the screening of readings remembers (`kernels/states.pxd`), `bank` where the filters beside it stand
    (`observer.estimators.bank`), as octets; without screening they are empty.
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
        """What the columns of the estimates are."""

    def initial(self) -> EstimatorState:
        """The state before the first measurement."""

    def run(self, state: EstimatorState, inputs: Inputs) -> tuple[EstimatorState, EstimateBlock]:
        """K steps; a run of K is, to the last bit, K runs of one."""


@runtime_checkable
class CarriesOver(Estimator, Protocol):
    """One whose `x_hat` and `P` are those of the plant, so that they can be carried into another model."""

    def at(
        self, state: EstimatorState, x_hat: FloatArray, P: FloatArray, around: FloatArray
    ) -> EstimatorState:
        """Return a state with field, heats and what is learnt replaced."""
