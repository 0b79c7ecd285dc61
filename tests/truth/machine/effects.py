"""The hidden effects, each as a change of the machine itself."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from tests.truth.machine.grid import point_share, stretch_share
from tests.truth.machine.machine import ENDS, SENSORS, SOURCES, Machine
from tests.truth.machine.physics import LEFT, NUT, FloatArray


@dataclass(frozen=True)
class Effect:
    """An effect by its kind, where it stands, and its parameters in SI units."""

    kind: str
    target: str | None = None
    parameters: dict[str, float] = field(default_factory=dict)

    def __getitem__(self, key: str) -> float:
        return self.parameters[key]

    def with_parameter(self, key: str, value: float) -> Effect:
        """The same effect with one parameter changed."""
        return dataclasses.replace(self, parameters={**self.parameters, key: value})


def apply(machine: Machine, effect: Effect) -> Machine:
    """The machine with one more effect of the library."""
    return LIBRARY[effect.kind](machine, effect)


def _physics(machine: Machine, **changes: Any) -> Machine:
    return dataclasses.replace(machine, physics=machine.physics._replace(**changes))


def _at(old: FloatArray, index: int, value: float) -> FloatArray:
    new = old.copy()
    new[index] = value
    return new


def _end(effect: Effect) -> int:
    return ENDS.index(str(effect.target))


def _source(effect: Effect) -> int:
    return SOURCES.index(str(effect.target))


def _sensor(effect: Effect) -> int:
    return SENSORS.index(str(effect.target))


def _surface_convection(machine: Machine, effect: Effect) -> Machine:
    """All the film there is: the configuration says that there is none."""
    film = machine.physics.film_W_m2K
    return _physics(machine, film_W_m2K=effect["coefficient_W_m2K"] * film / film.mean())


def _speed_convection(machine: Machine, effect: Effect) -> Machine:
    return _physics(machine, rotation_gain=effect["gain"])


def _uneven_convection(machine: Machine, effect: Effect) -> Machine:
    extra = effect["extra_W_m2K"] * stretch_share(machine.grid, effect["from_m"], effect["to_m"])
    return _physics(machine, extra_film_W_m2K=machine.physics.extra_film_W_m2K + extra)


def _radiation(machine: Machine, effect: Effect) -> Machine:
    return _physics(machine, emissivity=effect["emissivity"])


def _end_conduction(machine: Machine, effect: Effect) -> Machine:
    return _physics(machine, end_W_K=_at(machine.physics.end_W_K, _end(effect), effect["conductance_W_K"]))


def _attached_mass(machine: Machine, effect: Effect) -> Machine:
    """A body on the nut or on an end; it exchanges heat with the screw, and the nut's with the air as well.

    Half of the nut's friction enters the screw at once; the nut's body takes `heat_share` of the other half.
    """
    where = NUT if effect.target == "nut" else LEFT + _end(effect)
    return _physics(
        machine,
        nut_body_share=effect.parameters.get("heat_share", 0.0),
        nut_body_air_W_K=effect.parameters.get("loss_W_K", 0.0),
        body_J_K=_at(machine.physics.body_J_K, where, effect["capacity_J_K"]),
        body_W_K=_at(machine.physics.body_W_K, where, effect["conductance_W_K"]),
    )


def _end_heat(machine: Machine, effect: Effect) -> Machine:
    """All the heat of a bearing: the configuration does not know that it makes any."""
    physics, end = machine.physics, _end(effect)
    return _physics(
        machine,
        friction_W_rpm=_at(physics.friction_W_rpm, LEFT + end, 0.0),
        end_heat_W_rpm=_at(physics.end_heat_W_rpm, end, effect["heat_W_rpm"]),
    )


def _motor_heat(machine: Machine, effect: Effect) -> Machine:
    return _physics(machine, motor_W=_at(machine.physics.motor_W, _end(effect), effect["heat_W"]))


def _friction_fade(machine: Machine, effect: Effect) -> Machine:
    return _physics(machine, fade_1_K=_at(machine.physics.fade_1_K, _source(effect), effect["per_K"]))


def _friction_speed(machine: Machine, effect: Effect) -> Machine:
    return _physics(machine, exponent=_at(machine.physics.exponent, _source(effect), effect["exponent"]))


def _run_in(machine: Machine, effect: Effect) -> Machine:
    which = _source(effect)
    return _physics(
        machine,
        run_in=_at(machine.physics.run_in, which, effect["fraction"]),
        run_in_s=_at(machine.physics.run_in_s, which, effect["time_s"]),
    )


def _dwell(machine: Machine, effect: Effect) -> Machine:
    return _physics(machine, dwell=effect["fraction"])


def _local_heat(machine: Machine, effect: Effect) -> Machine:
    """A heat on the surface from the first row to the last."""
    return _physics(machine, local_W=effect["heat_W"] * point_share(machine.grid, effect["position_m"]))


def _ambient_drift(machine: Machine, effect: Effect) -> Machine:
    return dataclasses.replace(machine, air_drift_K_h=effect["rate_K_h"])


def _coolant(machine: Machine, effect: Effect) -> Machine:
    return _physics(machine, coolant_W_K=effect["conductance_W_K"], inlet_degC=effect["inlet_degC"])


def _sensor_lag(machine: Machine, effect: Effect) -> Machine:
    return dataclasses.replace(machine, lag_s=_at(machine.lag_s, _sensor(effect), effect["time_constant_s"]))


def _sensor_bias(machine: Machine, effect: Effect) -> Machine:
    return dataclasses.replace(machine, offset_K=_at(machine.offset_K, _sensor(effect), effect["offset_K"]))


def _sensor_drift(machine: Machine, effect: Effect) -> Machine:
    return dataclasses.replace(machine, drift_K_h=_at(machine.drift_K_h, _sensor(effect), effect["rate_K_h"]))


LIBRARY: dict[str, Callable[[Machine, Effect], Machine]] = {
    "surface_convection": _surface_convection,
    "speed_convection": _speed_convection,
    "uneven_convection": _uneven_convection,
    "radiation": _radiation,
    "end_conduction": _end_conduction,
    "attached_mass": _attached_mass,
    "end_heat": _end_heat,
    "motor_heat": _motor_heat,
    "friction_fade": _friction_fade,
    "friction_speed": _friction_speed,
    "run_in": _run_in,
    "dwell": _dwell,
    "local_heat": _local_heat,
    "ambient_drift": _ambient_drift,
    "coolant": _coolant,
    "sensor_lag": _sensor_lag,
    "sensor_bias": _sensor_bias,
    "sensor_drift": _sensor_drift,
}
