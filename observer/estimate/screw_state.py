"""The state of the screw independent of its model, to continue in a configuration with another model."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from observer.estimate.pipeline import MachineModel
from observer.estimators.carry import Carried, carry_from, carry_into
from observer.estimators.protocol import CarriesOver, EstimatorState
from observer.frames import BoolArray, EstimateBlock, FloatArray, FrameBlock, Inputs, NutPath


@dataclass(frozen=True, slots=True)
class ScrewState:
    """Field and heats with their covariance, as in `Carried`, and the frame that the step followed.

    Attributes:
        position_m: The places of the field on the screw, in m.
        heats: The names of the heats in `value`.
        lags: The names of the sources whose lags follow.
        value: Temperatures in °C, heats and lags in W.
        covariance: Their covariance.
        channels: The c channels of the frame.
        dt_s: The length of the frame, (1,).
        values: Its values, (1, c).
        fresh: Which channels had a new value, (1, c).
        quality: The qualities of the channels, (1, c).
        age_s: The ages of the values, (1, c).
    """

    position_m: FloatArray
    heats: tuple[str, ...]
    lags: tuple[str, ...]
    value: FloatArray
    covariance: FloatArray
    channels: tuple[str, ...]
    dt_s: FloatArray
    values: FloatArray
    fresh: BoolArray
    quality: NDArray[np.int8]
    age_s: FloatArray

    @classmethod
    def of(
        cls, machine: MachineModel, state: EstimatorState, inputs: Inputs, estimate: EstimateBlock,
        frame: FrameBlock,
    ) -> ScrewState | None:  # fmt: skip
        """Return the state after a step.

        Args:
            machine: The machine with its estimator.
            state: The estimator's state after the step.
            inputs: What drove the step.
            estimate: Its estimate.
            frame: Its frame.

        Returns:
            None before the first estimate, or if the estimator's states are not those of the plant.

        Raises:
            UserError: If the machine's estimator cannot be designed.
        """
        if not isinstance(machine.estimator(), CarriesOver):
            return None
        carried = carry_from(machine.plant, state, inputs, estimate)
        if carried is None:
            return None
        return cls(
            *carried, frame.channels, frame.dt_s, frame.values, frame.fresh, frame.quality, frame.age_s
        )

    def continued(self, machine: MachineModel, tick_s: float) -> tuple[Any, EstimatorState] | None:
        """Return the states of drive and estimator of another model with this field and these heats.

        Learnt parameters and counters start again.

        Args:
            machine: The machine with the other model.
            tick_s: The time of the step.

        Returns:
            None if the two models have nothing in common, or if the states of the estimator are not the
            plant's.
        """
        estimator = machine.estimator()
        if not isinstance(estimator, CarriesOver) or not set(machine.config.channels) <= set(self.channels):
            return None
        columns = self.dt_s, self.values, self.fresh, self.quality, self.age_s
        paths = {nut.channel: self._place(nut.channel, tick_s) for nut in machine.plant.moving}
        frame = FrameBlock(self.channels, np.array([tick_s]), *columns, paths)
        drive, inputs = machine.drive.run(machine.drive.initial(), frame)
        carried = Carried(self.position_m, self.heats, self.lags, self.value, self.covariance)
        state = carry_into(machine.plant, estimator, carried, inputs)
        if state is None or not (np.isfinite(state.x_hat).all() and np.isfinite(state.P).all()):
            return None
        return drive, state

    def _place(self, channel: str, tick_s: float) -> NutPath:
        """Return the path of a nut in the frame: its last position, empty if that is unknown."""
        position_m = self.values[0, [self.channels.index(channel)]]
        position_m = position_m[np.isfinite(position_m)]
        unknown = np.full(len(position_m), np.nan)
        offset = np.array([0, len(position_m)])
        return NutPath(np.full(len(position_m), tick_s), position_m, offset, unknown, unknown)
