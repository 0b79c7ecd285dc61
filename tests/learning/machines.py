"""Machines off their configuration as real ones are, from the independent truth, with what no log shows."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from observer.config.machine import Config
from tests.truth.machine.cycles import (
    RUNS,
    Phase,
    START_m,
    STEP_s,
    build_schedule,
    draw_air,
    programme,
    steps_of,
)
from tests.truth.machine.logs import configuration
from tests.truth.machine.machine import SENSOR_M, SLICES, Machine, stream
from tests.truth.machine.physics import FloatArray, Physics, plain_physics
from tests.truth.machine.run import run_machine
from tests.truth.machine.sensing import shown, true_readings

GRID_M = np.linspace(0.0, 1.0, 21)
FINE_M = np.linspace(0.0, 1.0, 201)
"""Where the truth is integrated: heat that enters an end makes the field steep there."""
EXPANSION_um_K_m = 11.8
CONFIG = configuration(())
PERIOD_STEPS = 2
"""Rows of a log, in steps of the truth: one a second."""
WARM_S = 2700.0
"""How long a machine has run before the log of a warm start begins."""


@dataclass(frozen=True)
class Rough:
    """How far machines are from their configuration: relative to what it says, or in K, W/K and m."""

    film: float = 0.30
    material: float = 0.03
    laws: float = 0.25
    run_in: float = 0.3
    offset_K: float = 0.3
    place_m: float = 0.002
    ambient_K: float = 0.5
    end_W_K: float = 0.1
    run_in_power: float = 1.0


AS_CONFIGURED = Rough(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


class Day(NamedTuple):
    """A log of one machine with its truth: rows (n,), channels as the truth's logs, heats (n, 3) in W, the
    field (n, 21) at `GRID_M`, and the thermal error (n, 21) in µm from the air at the start of the log.
    """

    time_s: FloatArray
    sensor_degC: FloatArray
    nut_m: FloatArray
    speed_rpm: FloatArray
    air_degC: FloatArray
    heat_W: FloatArray
    field_degC: FloatArray
    error_um: FloatArray


@dataclass(frozen=True)
class Specimen:
    """One machine, where its sensors really sit, and by how much its air is warmer than the log says.

    With `on_bodies` the sensors are three, on the nut and on both housings, and none is on the screw.
    """

    machine: Machine
    sensor_m: FloatArray
    ambient_K: float
    on_bodies: bool = False


def draw(seed: int, number: int, rough: Rough) -> Specimen:
    """Draw a machine; sensors lag by 2 to 4 s on all but those that are as configured."""
    rng = stream(seed, "rough", str(number))
    plain = plain_physics(SLICES)
    physics = plain._replace(
        conductivity_W_mK=plain.conductivity_W_mK * (1.0 + rng.uniform(-1.0, 1.0) * rough.material),
        capacity_J_m3K=plain.capacity_J_m3K * (1.0 + rng.uniform(-1.0, 1.0) * rough.material),
        film_W_m2K=plain.film_W_m2K * (1.0 + rng.choice([-1.0, 1.0]) * rough.film),
        end_W_K=rng.uniform(0.0, 1.0, 2) * rough.end_W_K,
        friction_W_rpm=plain.friction_W_rpm * (1.0 + rng.choice([-1.0, 1.0], 3) * rough.laws),
        run_in=rng.uniform(0.0, 1.0, 3) * rough.run_in,
        run_in_s=rng.uniform(900.0, 3600.0, 3),
        run_in_power=rough.run_in_power,
    )
    lag_s = rng.uniform(2.0, 4.0, 5) if rough.place_m else np.zeros(5)
    offset_K = rough.offset_K * rng.standard_normal(5)
    sensor_m = SENSOR_M + rough.place_m * rng.standard_normal(5)
    ambient_K = rough.ambient_K * rng.standard_normal()
    return Specimen(Machine(physics, lag_s, offset_K, np.zeros(5)), sensor_m, float(ambient_K))


def day(specimen: Specimen, seed: int, number: int, run: str, *, warm: bool = False) -> Day:
    """Run it through one of the programmes "a", "b", "c"; a warm start begins in the middle of it."""
    if run not in RUNS:
        raise ValueError(f"run {run}: there are {RUNS}")
    rng = stream(seed, "day", str(number), run)
    return work(specimen, programme("standard", run, rng), START_m[run], rng, WARM_S if warm else 0.0)


def work(
    specimen: Specimen,
    phases: tuple[Phase, ...],
    start_m: float,
    rng: np.random.Generator,
    from_s: float,
    twice_from_s: float = np.inf,
    inlet_K: Callable[[FloatArray], FloatArray] = np.zeros_like,
) -> Day:
    """Run it through phases of work, from one temperature on; the log begins `from_s` later.

    The nut makes twice its heat from `twice_from_s` on; a coolant is warmer by `inlet_K` of the time in s.
    """
    felt = draw_air(float(rng.uniform(18.0, 25.0)), steps_of(phases), rng)
    schedule = build_schedule(phases, start_m, felt)
    begin_s = np.arange(len(schedule.speed_rpm)) * STEP_s
    nut_factor = 1.0 + (begin_s >= twice_from_s)
    schedule = schedule._replace(nut_factor=nut_factor, inlet_K=inlet_K(begin_s + 0.5 * STEP_s))
    physics = specimen.machine.physics
    result = run_machine(physics, schedule, np.concatenate([specimen.sensor_m, FINE_M]))
    section, fine = result.section_degC[:, :5], result.section_degC[:, 5:]
    seen = result.body_degC if specimen.on_bodies else section
    reading = true_readings(specimen.machine, seen, felt, np.ones_like(seen), STEP_s)
    rows = np.arange(int(from_s / STEP_s), len(felt), PERIOD_STEPS)
    step = np.minimum(rows, len(schedule.speed_rpm) - 1)
    speed_rpm = schedule.speed_rpm
    air_degC = np.round(felt - specimen.ambient_K, 2)[rows]
    return Day(
        time_s=rows * STEP_s,
        sensor_degC=shown(reading[rows], rng),
        nut_m=np.round(result.nut_m[rows], 4),
        speed_rpm=speed_rpm[step],
        air_degC=air_degC,
        heat_W=(_friction_W(physics, speed_rpm) * np.where([True, False, False], nut_factor[:, None], 1.0))[
            step
        ],
        field_degC=fine[rows][:, ::10],
        error_um=_growth_um(fine[rows] - air_degC[0])[:, ::10],
    )


def _friction_W(physics: Physics, speed_rpm: FloatArray) -> FloatArray:
    """The heats (K, 3) over each step, the nut's with what its body takes: with speed, and larger while the
    machine runs in.
    """
    turned_s = np.cumsum(np.where(speed_rpm != 0.0, STEP_s, 0.0)) - 0.5 * STEP_s
    run_in = (np.maximum(turned_s, 0.0)[:, None] / physics.run_in_s) ** physics.run_in_power
    more = 1.0 + physics.run_in * np.exp(-run_in)
    whole = np.array([1.0 + physics.nut_body_share, 1.0, 1.0])
    return np.asarray(whole * physics.friction_W_rpm * np.abs(speed_rpm)[:, None] * more)


def _growth_um(rise_K: FloatArray) -> FloatArray:
    """The growth (n, 201) of a free screw from its left end, by the trapezoids of the fine grid."""
    mean = 0.5 * (rise_K[:, 1:] + rise_K[:, :-1]) * np.diff(FINE_M)
    return np.asarray(EXPANSION_um_K_m * np.hstack([np.zeros((len(mean), 1)), np.cumsum(mean, axis=1)]))


def config_of(text: str = CONFIG, more: str = "") -> Config:
    """The configuration that the machine's user has, with more tables."""
    import tomllib

    return Config.model_validate(tomllib.loads(text + more))
