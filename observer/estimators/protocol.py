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
    """The state of an estimator after a step, which `Estimator.run` takes and returns.

    The n = n_x + m_e + L states are the plant's, the estimated heats' deviations from their laws, and the
    parameters. With s sensors.

    Attributes:
        x_hat: Estimate of the states, (n,).
        P: Its covariance, (n, n).
        started: False until the first usable measurement.
        suspect: Steps for which a sensor has been rejected in a row, (s,).
        refused_s: Time for which it has been rejected in a row, s, (s,).
        opened_K: A sensor's innovation when the covariance was last opened for it, K, (s,).
        time_s: Time of the step, s since the epoch; NaN before the first one.
        silent: Steps in a row without a good sensor.
        lost_s: Time for which the position of a nut has been unknown, s.
        gain_sensors: Sensors, as bits, of the designed gain in use.
        around: Linearisation point of the parameters, (n_x + m_e + 2 s,), empty if nothing is learnt. It ends
            with each sensor's reading there, without and with a lag.
        guard: Memory of the screening by sensor, (s,), as in `kernels/states.pxd`. It is empty without
            screening.
        verdict: Memory of the screening of all sensors, (1,).
        bank: Bytes of the bank of filters (`observer.estimators.bank`), or empty.
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
    """Turns inputs into estimates; holds no state of its own.

    A class of the user needs these three members, and `__init__(self, plant, settings)`.
    """

    @property
    def layout(self) -> Layout:
        """Names and places of the estimates' columns."""

    def initial(self) -> EstimatorState:
        """Return the state before the first measurement, with `started` false."""

    def run(self, state: EstimatorState, inputs: Inputs) -> tuple[EstimatorState, EstimateBlock]:
        """Take K steps; a run of K is, to the last bit, K runs of one.

        Args:
            state: The state after the step before, which stays unchanged.
            inputs: K steps of heats, known inputs and readings.

        Returns:
            The state after the last step, and K estimates with the columns of `layout`.
        """


@runtime_checkable
class CarriesOver(Estimator, Protocol):
    """An estimator whose `x_hat` and `P` are those of the plant and can be carried into another model."""

    def at(
        self, state: EstimatorState, x_hat: FloatArray, P: FloatArray, linearisation_point: FloatArray
    ) -> EstimatorState:
        """Return a state with field, heats and learnt parameters replaced.

        Args:
            state: The state that gives everything else.
            x_hat: New states, (n,).
            P: Their covariance, (n, n).
            linearisation_point: As in `EstimatorState.around`.
        """
