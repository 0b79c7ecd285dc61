"""The hidden effects, each as a change of the machine itself, and how strongly the campaign hides it.

Strengths are in SI units. The first of a ladder moves the sensors by 0.05 to 0.1 K rms once what the user may
fit has been refitted (`visibility.py`), every next one about twice as much, up to 1 or 2 K or as far as the
physics goes: no surface glows with an emissivity beyond 1, and friction that has faded cannot fade again.
"""

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


@dataclass(frozen=True)
class Ladder:
    """One effect at one place in five strengths of one of its parameters, the others fixed."""

    target: str | None
    key: str
    strengths: tuple[float, float, float, float, float]
    fixed: dict[str, float] = field(default_factory=dict)
    cycle: str = "standard"
    kind: str = ""  # by `hidden`

    @property
    def label(self) -> str:
        """What distinguishes it from the other ladders."""
        target = [] if self.target is None else [self.target]
        return ".".join([self.kind, *target, *(f"{value:g}" for value in self.fixed.values())])

    def effect(self, rung: int) -> Effect:
        """The effect in one of its strengths, 0 … 4."""
        return Effect(self.kind, self.target, {**self.fixed, self.key: self.strengths[rung]})


Change = Callable[[Machine, Effect], Machine]
LIBRARY: dict[str, Change] = {}
LADDERS: list[Ladder] = []


def hidden(*ladders: Ladder) -> Callable[[Change], Change]:
    """Have the campaign hide an effect, the change of the machine `_<kind>`, in some ladders of it."""

    def known(change: Change) -> Change:
        kind = getattr(change, "__name__", "").removeprefix("_")
        LIBRARY[kind] = change
        LADDERS.extend(dataclasses.replace(ladder, kind=kind) for ladder in ladders)
        return change

    return known


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


@hidden(Ladder(None, "coefficient_W_m2K", (0.05, 0.12, 0.3, 0.8, 2.0)))
def _surface_convection(machine: Machine, effect: Effect) -> Machine:
    """All the film there is: the configuration says that there is none."""
    film = machine.physics.film_W_m2K
    return _physics(machine, film_W_m2K=effect["coefficient_W_m2K"] * film / film.mean())


@hidden(Ladder(None, "gain", (0.014, 0.03, 0.07, 0.18, 0.6)))
def _speed_convection(machine: Machine, effect: Effect) -> Machine:
    return _physics(machine, rotation_gain=effect["gain"])


@hidden(
    Ladder(None, "extra_W_m2K", (0.8, 2.0, 4.0, 9.0, 20.0), {"from_m": 0.25, "to_m": 0.5}),
    Ladder(None, "extra_W_m2K", (-0.6, -1.3, -2.8, -6.0, -9.0), {"from_m": 0.6, "to_m": 0.9}),
)
def _uneven_convection(machine: Machine, effect: Effect) -> Machine:
    extra = effect["extra_W_m2K"] * stretch_share(machine.grid, effect["from_m"], effect["to_m"])
    return _physics(machine, extra_film_W_m2K=machine.physics.extra_film_W_m2K + extra)


@hidden(Ladder(None, "emissivity", (0.15, 0.3, 0.5, 0.7, 0.95), cycle="hot"))
def _radiation(machine: Machine, effect: Effect) -> Machine:
    return _physics(machine, emissivity=effect["emissivity"])


@hidden(Ladder(None, "coefficient_W_m2K", (0.5, 1.2, 3.0, 6.0, 12.0), cycle="hot"))
def _natural_convection(machine: Machine, effect: Effect) -> Machine:
    return _physics(machine, still_W_m2K=effect["coefficient_W_m2K"])


@hidden(
    Ladder("left", "conductance_W_K", (0.01, 0.025, 0.06, 0.15, 0.4)),
    Ladder("right", "conductance_W_K", (0.01, 0.025, 0.06, 0.15, 0.4)),
)
def _end_conduction(machine: Machine, effect: Effect) -> Machine:
    return _physics(machine, end_W_K=_at(machine.physics.end_W_K, _end(effect), effect["conductance_W_K"]))


@hidden(
    Ladder("nut", "conductance_W_K", (0.03, 0.07, 0.2, 0.7, 5.0), {"capacity_J_K": 4000.0}),
    Ladder("left", "capacity_J_K", (10.0, 25.0, 60.0, 150.0, 400.0), {"conductance_W_K": 3.0}),
)
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


@hidden(
    Ladder("left", "heat_W_rpm", (6e-5, 1.5e-4, 3e-4, 7e-4, 1.5e-3)),
    Ladder("right", "heat_W_rpm", (6e-5, 1.5e-4, 3e-4, 7e-4, 1.5e-3)),
)
def _end_heat(machine: Machine, effect: Effect) -> Machine:
    """All the heat of a bearing: the configuration does not know that it makes any."""
    physics, end = machine.physics, _end(effect)
    return _physics(
        machine,
        friction_W_rpm=_at(physics.friction_W_rpm, LEFT + end, 0.0),
        end_heat_W_rpm=_at(physics.end_heat_W_rpm, end, effect["heat_W_rpm"]),
    )


@hidden(
    Ladder("left", "heat_W", (0.2, 0.5, 1.0, 2.0, 5.0)), Ladder("right", "heat_W", (0.2, 0.5, 1.0, 2.0, 5.0))
)
def _motor_heat(machine: Machine, effect: Effect) -> Machine:
    return _physics(machine, motor_W=_at(machine.physics.motor_W, _end(effect), effect["heat_W"]))


@hidden(
    Ladder("nut", "per_K", (0.002, 0.005, 0.012, 0.03, 0.08)),
    Ladder("left_bearing", "per_K", (0.0015, 0.004, 0.01, 0.025, 0.07)),
)
def _friction_fade(machine: Machine, effect: Effect) -> Machine:
    return _physics(machine, fade_1_K=_at(machine.physics.fade_1_K, _source(effect), effect["per_K"]))


@hidden(
    Ladder("nut", "exponent", (1.05, 1.1, 1.2, 1.4, 1.8)),
    Ladder("right_bearing", "exponent", (0.95, 0.9, 0.8, 0.6, 0.3)),
)
def _friction_speed(machine: Machine, effect: Effect) -> Machine:
    return _physics(machine, exponent=_at(machine.physics.exponent, _source(effect), effect["exponent"]))


@hidden(
    Ladder("nut", "fraction", (0.05, 0.1, 0.25, 0.5, 1.0), {"time_s": 1200.0}),
    Ladder("left_bearing", "fraction", (0.05, 0.1, 0.25, 0.5, 1.0), {"time_s": 1800.0}),
)
def _run_in(machine: Machine, effect: Effect) -> Machine:
    which = _source(effect)
    return _physics(
        machine,
        run_in=_at(machine.physics.run_in, which, effect["fraction"]),
        run_in_s=_at(machine.physics.run_in_s, which, effect["time_s"]),
    )


@hidden(Ladder("nut", "fraction", (0.025, 0.05, 0.1, 0.2, 0.5)))
def _dwell(machine: Machine, effect: Effect) -> Machine:
    return _physics(machine, dwell=effect["fraction"])


@hidden(
    Ladder(None, "heat_W", (0.3, 0.7, 1.5, 3.0, 7.0), {"position_m": 0.38}),
    Ladder(None, "heat_W", (0.3, 0.7, 1.5, 3.0, 7.0), {"position_m": 0.84}),
)
def _local_heat(machine: Machine, effect: Effect) -> Machine:
    """A heat on the surface from the first row to the last."""
    return _physics(machine, local_W=effect["heat_W"] * point_share(machine.grid, effect["position_m"]))


@hidden(
    Ladder(None, "rate_K_h", (0.3, 0.7, 1.5, 3.0, 7.0)),
    Ladder(None, "rate_K_h", (-0.3, -0.7, -1.5, -3.0, -7.0)),
)
def _ambient_drift(machine: Machine, effect: Effect) -> Machine:
    return dataclasses.replace(machine, air_drift_K_h=effect["rate_K_h"])


@hidden(
    Ladder(None, "conductance_W_K", (0.06, 0.15, 0.35, 0.8, 2.0), {"inlet_degC": 15.0}),
    Ladder(None, "conductance_W_K", (0.08, 0.2, 0.45, 1.0, 2.5), {"inlet_degC": 24.0}),
)
def _coolant(machine: Machine, effect: Effect) -> Machine:
    return _physics(machine, coolant_W_K=effect["conductance_W_K"], inlet_degC=effect["inlet_degC"])


@hidden(
    Ladder("t1", "time_constant_s", (20.0, 40.0, 90.0, 200.0, 450.0)),
    Ladder("t3", "time_constant_s", (25.0, 50.0, 100.0, 200.0, 500.0)),
)
def _sensor_lag(machine: Machine, effect: Effect) -> Machine:
    return dataclasses.replace(machine, lag_s=_at(machine.lag_s, _sensor(effect), effect["time_constant_s"]))


@hidden(
    Ladder("t2", "offset_K", (0.2, 0.4, 0.8, 1.6, 4.0)),
    Ladder("t5", "offset_K", (-0.3, -0.6, -1.2, -2.4, -5.0)),
)
def _sensor_bias(machine: Machine, effect: Effect) -> Machine:
    return dataclasses.replace(machine, offset_K=_at(machine.offset_K, _sensor(effect), effect["offset_K"]))


@hidden(
    Ladder("t4", "rate_K_h", (0.15, 0.3, 0.6, 1.3, 3.0)),
    Ladder("t1", "rate_K_h", (-0.15, -0.3, -0.6, -1.3, -3.0)),
)
def _sensor_drift(machine: Machine, effect: Effect) -> Machine:
    return dataclasses.replace(machine, drift_K_h=_at(machine.drift_K_h, _sensor(effect), effect["rate_K_h"]))
