"""The machine's own numerics: conservation, closed forms, order, and an older code on another scheme."""

from __future__ import annotations

import math

import numpy as np
import pytest

from tests.truth.bar import Bar, Mesh, nut_share, point_share, shuttle_m, substep_times
from tests.truth.machine.effects import LIBRARY, Effect
from tests.truth.machine.exchange import BODIES
from tests.truth.machine.generate import Case, machine_of
from tests.truth.machine.grid import build_grid
from tests.truth.machine.motion import positions_at
from tests.truth.machine.physics import LEFT, plain_physics, steady_schedule
from tests.truth.machine.run import run_machine
from tests.truth.machine_cases import at, bare, ran
from tests.truth.rod import Heat
from tests.truth.screw2d import simulate

TRY = {
    "uneven_convection": {"from_m": 0.2, "to_m": 0.55, "extra_W_m2K": 9.0},
    "attached_mass": {"capacity_J_K": 300.0, "conductance_W_K": 2.0},
    "run_in": {"fraction": 0.5, "time_s": 600.0},
    "local_heat": {"position_m": 0.38, "heat_W": 5.0},
    "coolant": {"conductance_W_K": 1.0, "inlet_degC": 12.0},
    "surface_convection": {"coefficient_W_m2K": 12.0},
    "speed_convection": {"gain": 0.3},
    "radiation": {"emissivity": 0.9},
    "natural_convection": {"coefficient_W_m2K": 8.0},
    "end_conduction": {"conductance_W_K": 0.3},
    "end_heat": {"heat_W_rpm": 2e-3},
    "motor_heat": {"heat_W": 4.0},
    "friction_fade": {"per_K": 0.02},
    "friction_speed": {"exponent": 1.4},
    "dwell": {"fraction": 0.3},
    "ambient_drift": {"rate_K_h": 3.0},
    "sensor_lag": {"time_constant_s": 60.0},
    "sensor_bias": {"offset_K": 1.0},
    "sensor_drift": {"rate_K_h": 1.0},
}
ENDS = ("end_conduction", "end_heat", "motor_heat")
HEATS = ("attached_mass", "friction_fade", "friction_speed", "run_in", "dwell")


def effect_of(kind: str) -> Effect:
    target = "right" if kind in ENDS else "nut" if kind in HEATS else "t3" if "sensor" in kind else None
    return Effect(kind, target, TRY[kind])


@pytest.mark.parametrize("kind", LIBRARY)
def test_no_heat_is_lost_or_won(kind: str) -> None:
    """What the book says went in is what the metal holds, to rounding."""
    physics = machine_of(Case("book", (effect_of(kind),), 3)).physics
    schedule = steady_schedule(600, 0.5, speed_rpm=np.full(600, 1490.0), air_degC=np.linspace(20, 22, 600))
    result = run_machine(physics, schedule, np.array([0.5]))
    grid = build_grid(physics, len(physics.film_W_m2K), result.field_degC.shape[1])
    held_J = float(((result.field_degC - 20.0) * grid.capacity_J_K).sum())
    # 600 steps of 400 cells, each good to 1e-16 of some 70 kJ/K · 20 K
    assert held_J == pytest.approx(float(result.book_J.sum()), abs=1e-6)
    assert abs(held_J) > 100.0
    bodies_J = float((physics.body_J_K * (result.body_degC[-1] - 20.0)).sum())
    assert bodies_J == pytest.approx(-float(result.book_J[:, BODIES].sum()), abs=1e-6)


def fin_error_K(slices: int) -> float:
    """Largest error at three places of the fin with 10 W into its left end, at rest."""
    position_m = np.array([0.1, 0.4, 0.8])
    physics = plain_physics(slices, motor_W=np.array([10.0, 0.0]))
    result = run_machine(physics, steady_schedule(6000, 5.0), position_m)
    radius_m, k = physics.diameter_m / 2, physics.conductivity_W_mK
    # a film on a thick bar: the surface is cooler than the section's mean by hR/4k of its rise
    film_W_m2K = 15.0 / (1 + 15.0 * radius_m / (4 * k))
    m_1_m = math.sqrt(2 * film_W_m2K / (k * radius_m))
    scale_K = 10.0 / (k * math.pi * radius_m**2 * m_1_m * math.sinh(m_1_m))
    return float(np.abs(result.section_degC[-1] - 20.0 - scale_K * np.cosh(m_1_m * (1 - position_m))).max())


def test_fin_at_rest() -> None:
    """Second order in the slices, down to what rings leave: 10 W warm the end by 70 K, 0.02 K is 3e-4."""
    coarse, fine = fin_error_K(25), fin_error_K(100)
    assert fine < 0.02
    assert coarse > 6.0 * fine


def test_second_order_in_time() -> None:
    """A quarter of the error with half the step, for losses by the temperature in the middle of a step."""
    hot = plain_physics(50, emissivity=0.9, friction_W_rpm=at(LEFT, 0.02), end_W_K=np.array([0.5, 0.0]))

    def settled_degC(step_s: float) -> float:
        return float(ran(hot, round(1200 / step_s), step_s, [0.1], speed_rpm=1490.0).section_degC[-1, 0])

    exact = settled_degC(0.5)
    coarse, fine = abs(settled_degC(20.0) - exact), abs(settled_degC(10.0) - exact)
    assert coarse < 0.3  # of 30 K, with steps forty times the machine's
    assert 3.0 * fine < coarse < 5.5 * fine


def test_moving_nut_as_the_older_code_has_it() -> None:
    """Rings × slices with Crank-Nicolson against `screw2d.py`; the nut's shares by sampling its path."""
    steps, step_s, speed_rpm = 240, 0.5, 1490.0
    physics, position_m = plain_physics(100), np.array([0.255, 0.505, 0.705])
    ours = ran(physics, steps, step_s, position_m, speed_rpm=speed_rpm).section_degC
    mesh, time_s = Mesh(1.0, 100), np.arange(steps + 1) * step_s
    path_m = shuttle_m(substep_times(time_s, 200), 0.2, 0.8, speed_rpm / 60 * physics.lead_m)
    nut = Heat(nut_share(mesh, 0.08, path_m), np.full(steps, physics.friction_W_rpm[0] * speed_rpm))
    bearing_W = np.full(steps, 0.006 * speed_rpm)
    ends = [
        Heat(point_share(mesh, 0.0), bearing_W, end="left"),
        Heat(point_share(mesh, 1.0), bearing_W, end="right"),
    ]
    theirs = simulate(Bar(), mesh, time_s, [nut], ends, position_m, rings=4).temperature_degC[:, :, 0]
    rise_K = float((theirs[-1] - 20.0).max())
    assert rise_K > 1.0
    # the older code takes no heat straight from the nut to the air: 0.1 % of it, and its steps lag by a half
    np.testing.assert_allclose(ours, theirs, rtol=0.0, atol=5e-3 * rise_K)


def test_nut_path() -> None:
    """A triangle between the ends of the stroke; a nut outside a new stroke first drives into it."""
    time_s = np.array([0.0, 1.0, 4.0, 6.0, 8.0, 9.0, 10.0])
    low_m = np.where(np.arange(20) < 16, 0.2, 0.5)
    path_m = positions_at(time_s, 0.5, 0.2, np.full(20, 0.1), low_m, np.full(20, 0.6))
    np.testing.assert_allclose(path_m, [0.2, 0.3, 0.6, 0.4, 0.2, 0.3, 0.4], atol=1e-12)


def test_a_screw_at_rest_stays_at_rest() -> None:
    result = ran(bare(film_W_m2K=np.full(50, 15.0)), 200)
    assert np.ptp(result.section_degC) < 1e-9
    assert np.all(result.nut_m == 0.2)
