"""What is hidden in the campaign's machines beside the ladders of single effects (`effects.py`)."""

from __future__ import annotations

from dataclasses import dataclass

from tests.truth.machine.effects import Effect

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
    """A machine whose effects cannot be distinguished or cannot be seen, with the honest answer.

    `alike`: the names, as (kind, target), whose signatures agree within the noise; the true one is first.
    `same`: whether they are one and the same physics, so that either name is right; `distinguishable`:
    whether the weather may distinguish them after all.
    `unseen`: whether the free parameters explain the effect entirely, so that "none" is right too.
    """

    label: str
    effects: tuple[Effect, ...]
    cycle: str
    alike: tuple[tuple[str, str | None], ...]
    unknown: tuple[str, ...] = ()
    unseen: bool = False
    same: bool = False
    distinguishable: bool = False


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
        distinguishable=True,
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
    "surface_convection": ("uneven_convection", "radiation", "natural_convection"),
    "motor_heat": ("local_heat",),
    "end_conduction": ("uneven_convection",),
}
"""What leaves the library with an effect, because with the right stretch or place it is the same physics."""
