"""Effects of the sensors themselves."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from observer.config.effects.base import EffectTable, Fitted, Target, named_sensor
from observer.config.effects.terms import Lag, SensorOffset, Term
from observer.config.quantities import Finite
from observer.config.sections import Description


class SensorLag(EffectTable):
    """A sensor that follows with a first-order lag: τ dT_s/dt = T − T_s."""

    kind: Literal["sensor_lag"]
    target: Target  #: a sensor’s name
    time_constant_s: Annotated[Finite, Field(ge=0, le=3600)]  #: time constant, s

    parameters = {  # a lag of less than 10 s is within tolerance
        "time_constant_s": Fitted("s", 20.0, starts=(20.0, 60.0, 150.0, 400.0), low=10.0, high=3600.0)
    }
    targets = "sensor"
    missing_physics = "a lag of sensor {target}"
    excitation = "heating and cooling that are fast against the lag"
    source = "a first-order instrument"

    def terms(self, machine: Description) -> tuple[Term, ...]:
        """Return a first-order lag of the sensor.

        Raises:
            ConfigError: If the target is no sensor.
        """
        return (Lag(named_sensor(machine, self.target, self.kind), self.time_constant_s),)


class SensorBias(EffectTable):
    """A sensor that reads a constant too much."""

    kind: Literal["sensor_bias"]
    target: Target  #: a sensor’s name
    offset_K: Annotated[Finite, Field(ge=-50, le=50)]  #: what the sensor reads too much, K

    parameters = {"offset_K": Fitted("K", 0.3)}
    targets = "sensor"
    missing_physics = "a constant error of sensor {target}"
    excitation = "a screw that starts at the temperature of the air"
    source = "an additive error"

    def terms(self, machine: Description) -> tuple[Term, ...]:
        """Return a constant offset of the sensor.

        Raises:
            ConfigError: If the target is no sensor.
        """
        return (SensorOffset(named_sensor(machine, self.target, self.kind), self.offset_K, 0.0),)


class SensorDrift(EffectTable):
    """A sensor whose offset grows from the start on."""

    kind: Literal["sensor_drift"]
    target: Target  #: a sensor’s name
    rate_K_h: Annotated[Finite, Field(ge=-50, le=50)]  #: K per hour since the start

    parameters = {"rate_K_h": Fitted("K/h", 0.2)}
    targets = "sensor"
    missing_physics = "a drift of sensor {target}"
    excitation = "a log of an hour or more"
    source = "an additive error that grows"

    def terms(self, machine: Description) -> tuple[Term, ...]:
        """Return an offset of the sensor that grows linearly from 0 at the start.

        Raises:
            ConfigError: If the target is no sensor.
        """
        return (SensorOffset(named_sensor(machine, self.target, self.kind), 0.0, self.rate_K_h),)
