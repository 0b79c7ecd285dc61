"""What is hidden in the campaign's machines: which effects, where, how strong, and on which cycle.

Strengths are in SI units. The first of a ladder moves the sensors by 0.05 to 0.1 K rms once what the user may
fit has been refitted (`visibility.py`), every next one about twice as much, up to 1 or 2 K or as far as the
physics goes: no surface glows with an emissivity beyond 1, and friction that has faded cannot fade again.
"""

from __future__ import annotations

from dataclasses import dataclass, field

from tests.truth.machine.effects import Effect


@dataclass(frozen=True)
class Ladder:
    """One effect at one place in five strengths of one of its parameters, the others fixed."""

    kind: str
    target: str | None
    key: str
    strengths: tuple[float, float, float, float, float]
    fixed: dict[str, float] = field(default_factory=dict)
    cycle: str = "standard"

    @property
    def label(self) -> str:
        """What tells it from the other ladders."""
        target = [] if self.target is None else [self.target]
        return ".".join([self.kind, *target, *(f"{value:g}" for value in self.fixed.values())])

    def effect(self, rung: int) -> Effect:
        """The effect in one of its strengths, 0 … 4."""
        return Effect(self.kind, self.target, {**self.fixed, self.key: self.strengths[rung]})


LADDER: tuple[Ladder, ...] = (
    Ladder("surface_convection", None, "coefficient_W_m2K", (0.05, 0.12, 0.3, 0.8, 2.0)),
    Ladder("speed_convection", None, "gain", (0.014, 0.03, 0.07, 0.18, 0.6)),
    Ladder(
        "uneven_convection", None, "extra_W_m2K", (0.8, 2.0, 4.0, 9.0, 20.0), {"from_m": 0.25, "to_m": 0.5}
    ),
    Ladder(
        "uneven_convection", None, "extra_W_m2K", (-0.6, -1.3, -2.8, -6.0, -9.0), {"from_m": 0.6, "to_m": 0.9}
    ),
    Ladder("radiation", None, "emissivity", (0.15, 0.3, 0.5, 0.7, 0.95), cycle="hot"),
    Ladder("end_conduction", "left", "conductance_W_K", (0.01, 0.025, 0.06, 0.15, 0.4)),
    Ladder("end_conduction", "right", "conductance_W_K", (0.01, 0.025, 0.06, 0.15, 0.4)),
    Ladder("attached_mass", "nut", "conductance_W_K", (0.03, 0.07, 0.2, 0.7, 5.0), {"capacity_J_K": 4000.0}),
    Ladder(
        "attached_mass", "left", "capacity_J_K", (10.0, 25.0, 60.0, 150.0, 400.0), {"conductance_W_K": 3.0}
    ),
    Ladder("end_heat", "left", "heat_W_rpm", (6e-5, 1.5e-4, 3e-4, 7e-4, 1.5e-3)),
    Ladder("end_heat", "right", "heat_W_rpm", (6e-5, 1.5e-4, 3e-4, 7e-4, 1.5e-3)),
    Ladder("motor_heat", "left", "heat_W", (0.2, 0.5, 1.0, 2.0, 5.0)),
    Ladder("motor_heat", "right", "heat_W", (0.2, 0.5, 1.0, 2.0, 5.0)),
    Ladder("friction_fade", "nut", "per_K", (0.002, 0.005, 0.012, 0.03, 0.08)),
    Ladder("friction_fade", "left_bearing", "per_K", (0.0015, 0.004, 0.01, 0.025, 0.07)),
    Ladder("friction_speed", "nut", "exponent", (1.05, 1.1, 1.2, 1.4, 1.8)),
    Ladder("friction_speed", "right_bearing", "exponent", (0.95, 0.9, 0.8, 0.6, 0.3)),
    Ladder("run_in", "nut", "fraction", (0.05, 0.1, 0.25, 0.5, 1.0), {"time_s": 1200.0}),
    Ladder("run_in", "left_bearing", "fraction", (0.05, 0.1, 0.25, 0.5, 1.0), {"time_s": 1800.0}),
    Ladder("dwell", "nut", "fraction", (0.025, 0.05, 0.1, 0.2, 0.5)),
    Ladder("local_heat", None, "heat_W", (0.3, 0.7, 1.5, 3.0, 7.0), {"position_m": 0.38}),
    Ladder("local_heat", None, "heat_W", (0.3, 0.7, 1.5, 3.0, 7.0), {"position_m": 0.84}),
    Ladder("ambient_drift", None, "rate_K_h", (0.3, 0.7, 1.5, 3.0, 7.0)),
    Ladder("ambient_drift", None, "rate_K_h", (-0.3, -0.7, -1.5, -3.0, -7.0)),
    Ladder("coolant", None, "conductance_W_K", (0.06, 0.15, 0.35, 0.8, 2.0), {"inlet_degC": 15.0}),
    Ladder("coolant", None, "conductance_W_K", (0.08, 0.2, 0.45, 1.0, 2.5), {"inlet_degC": 24.0}),
    Ladder("sensor_lag", "t1", "time_constant_s", (20.0, 40.0, 90.0, 200.0, 450.0)),
    Ladder("sensor_lag", "t3", "time_constant_s", (25.0, 50.0, 100.0, 200.0, 500.0)),
    Ladder("sensor_bias", "t2", "offset_K", (0.2, 0.4, 0.8, 1.6, 4.0)),
    Ladder("sensor_bias", "t5", "offset_K", (-0.3, -0.6, -1.2, -2.4, -5.0)),
    Ladder("sensor_drift", "t4", "rate_K_h", (0.15, 0.3, 0.6, 1.3, 3.0)),
    Ladder("sensor_drift", "t1", "rate_K_h", (-0.15, -0.3, -0.6, -1.3, -3.0)),
)

OUTSIDE: tuple[Effect, ...] = (
    Effect("film_hour", None, {"factor": 1.3}),
    Effect("film_hour", None, {"factor": 1.8}),
    Effect("heat_burst", None, {"position_m": 0.6, "heat_W": 40.0}),
    Effect("heat_burst", None, {"position_m": 0.35, "heat_W": 80.0}),
    Effect("stick_slip", None, {"factor": 2.0}),
    Effect("stick_slip", None, {"factor": 3.0}),
    Effect("grease_step", None, {"factor": 0.7}),
    Effect("grease_step", None, {"factor": 0.5}),
    Effect("loose_sensor", "t3", {"contact": 0.8}),
    Effect("loose_sensor", "t2", {"contact": 0.6}),
)
"""What no effect of the library explains, each strong enough that its residual is plain to see."""

PAIRS: tuple[tuple[Effect, Effect], ...] = (
    (Effect("speed_convection", None, {"gain": 0.15}), Effect("sensor_bias", "t2", {"offset_K": 1.0})),
    (Effect("end_conduction", "left", {"conductance_W_K": 0.12}), Effect("dwell", "nut", {"fraction": 0.15})),
    (
        Effect("motor_heat", "left", {"heat_W": 2.0}),
        Effect("friction_speed", "nut", {"exponent": 1.3}),
    ),
    (
        Effect("local_heat", None, {"position_m": 0.84, "heat_W": 3.0}),
        Effect("sensor_lag", "t1", {"time_constant_s": 150.0}),
    ),
    (
        Effect("ambient_drift", None, {"rate_K_h": 2.0}),
        Effect("run_in", "nut", {"fraction": 0.4, "time_s": 1200.0}),
    ),
    (
        Effect("coolant", None, {"conductance_W_K": 0.6, "inlet_degC": 15.0}),
        Effect("end_conduction", "right", {"conductance_W_K": 0.15}),
    ),
    (
        Effect("attached_mass", "left", {"capacity_J_K": 150.0, "conductance_W_K": 3.0}),
        Effect("sensor_drift", "t4", {"rate_K_h": 0.8}),
    ),
    (
        Effect("uneven_convection", None, {"from_m": 0.25, "to_m": 0.5, "extra_W_m2K": 8.0}),
        Effect("end_heat", "right", {"heat_W_rpm": 7e-4}),
    ),
    (
        Effect("friction_speed", "right_bearing", {"exponent": 0.7}),
        Effect("sensor_bias", "t3", {"offset_K": -1.0}),
    ),
    (
        Effect("surface_convection", None, {"coefficient_W_m2K": 12.0}),
        Effect("motor_heat", "right", {"heat_W": 2.5}),
    ),
)
"""Two effects at once, of different classes."""


@dataclass(frozen=True)
class Doubtful:
    """A machine on which names cannot be told apart, or nothing can be seen: what an honest answer is.

    `alike`: the names, as (kind, target), whose signatures agree within the noise; the true one is first.
    `same`: whether they are one and the same physics, so that either name is right; `tellable`: whether the
    weather may tell them apart after all.
    `unseen`: whether the free parameters explain the effect entirely, so that "none" is right too.
    """

    label: str
    effects: tuple[Effect, ...]
    cycle: str
    alike: tuple[tuple[str, str | None], ...]
    unknown: tuple[str, ...] = ()
    unseen: bool = False
    same: bool = False
    tellable: bool = False


AMBIGUOUS: tuple[Doubtful, ...] = (
    Doubtful(
        "motor_or_bearing",
        (Effect("motor_heat", "left", {"heat_W": 4.0}),),
        "always_on",
        (("motor_heat", "left"), ("end_heat", "left"), ("local_heat", None)),
        unknown=("left_bearing",),
    ),
    Doubtful(
        "bearing_or_motor",
        (Effect("end_heat", "right", {"heat_W_rpm": 3e-3}),),
        "always_on",
        (("end_heat", "right"), ("motor_heat", "right"), ("local_heat", None)),
    ),
    Doubtful(
        "air_or_coolant",
        (Effect("speed_convection", None, {"gain": 0.3}),),
        "single_speed",
        (("speed_convection", None), ("coolant", None)),
        tellable=True,
    ),
    Doubtful(
        "housing_or_blast_at_end",
        (Effect("uneven_convection", None, {"from_m": 0.0, "to_m": 0.02, "extra_W_m2K": 80.0}),),
        "standard",
        (("uneven_convection", None), ("end_conduction", "left")),
        same=True,
    ),
    Doubtful(
        "spot_at_end_or_motor",
        (Effect("local_heat", None, {"position_m": 0.0, "heat_W": 3.0}),),
        "standard",
        (("local_heat", None), ("motor_heat", "left")),
        same=True,
    ),
)
"""The same effect under two names."""

POOR: tuple[Doubtful, ...] = (
    Doubtful(
        "exponent",
        (Effect("friction_speed", "nut", {"exponent": 1.4}),),
        "single_speed",
        (("friction_speed", "nut"),),
        unseen=True,
    ),
    Doubtful(
        "exponent_of_bearing",
        (Effect("friction_speed", "left_bearing", {"exponent": 0.6}),),
        "single_speed",
        (("friction_speed", "left_bearing"),),
        unseen=True,
    ),
    Doubtful(
        "motor_always_on",
        (Effect("motor_heat", "left", {"heat_W": 3.0}),),
        "always_on",
        (("motor_heat", "left"),),
        unseen=True,
    ),
    Doubtful(
        "air_always_on",
        (Effect("speed_convection", None, {"gain": 0.2}),),
        "always_on",
        (("speed_convection", None),),
        unseen=True,
    ),
    Doubtful(
        "radiation",
        (Effect("radiation", None, {"emissivity": 0.8}),),
        "standard",
        (("radiation", None),),
        unseen=True,
    ),
)
"""One speed only, or a screw that gets too little warm: the free parameters take the effect up."""

FAULTY: tuple[tuple[str, ...], ...] = (("gaps",), ("uneven",), ("stuck",), ("missing",), ("gaps", "missing"))
"""Logs as they come."""

ALIKE: dict[str, tuple[str, ...]] = {
    "surface_convection": ("uneven_convection", "radiation"),
    "motor_heat": ("local_heat",),
    "end_conduction": ("uneven_convection",),
}
"""What leaves the library with an effect, because with the right stretch or place it is the same physics."""
