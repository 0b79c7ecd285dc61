"""Each effect of the machine against what its physics says in closed form."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from tests.truth.machine.effects import Effect, apply
from tests.truth.machine.exchange import (
    COOLANT,
    ENDS,
    FILM,
    FRICTION,
    RADIATION,
    STEADY_HEAT,
    friction_W,
    rotating_film_W_m2K,
)
from tests.truth.machine.generate import Case, logged, machine_of, trace
from tests.truth.machine.machine import plain_machine
from tests.truth.machine.physics import LEFT, NUT
from tests.truth.machine.sensing import lagged, true_readings
from tests.truth.machine_cases import SLICES, at, bare, even, ran

CAPACITY_J_K = 7800.0 * 460.0 * math.pi * 0.018**2
SURFACE_m2 = math.pi * 0.036


def hidden(kind: str, target: str | None = None, **parameters: float) -> Effect:
    return Effect(kind, target, parameters)


def test_end_conduction_at_rest() -> None:
    """What goes in on the right leaves on the left: T = T_air + Q/G + Q x/(kA)."""
    physics = bare(motor_W=np.array([0.0, 5.0]), end_W_K=np.array([2.0, 0.0]))
    result = ran(physics, 20_000, 30.0, [0.25, 0.75])
    rise_K = 5.0 / 2.0 + 5.0 * np.array([0.25, 0.75]) / (50.0 * math.pi * 0.018**2)
    np.testing.assert_allclose(result.section_degC[-1] - 20.0, rise_K, rtol=1e-6)
    assert result.book_J[-1, ENDS] == pytest.approx(-5.0 * 30.0, rel=1e-6)


def test_coolant_at_rest() -> None:
    """All heat leaves through the bore, and only while the screw turns: Q = G (mean of the core − inlet)."""
    physics = bare(friction_W_rpm=at(LEFT, 0.006), coolant_W_K=1.5, inlet_degC=12.0)
    result = ran(physics, 12_000, 5.0, speed_rpm=1000.0)
    assert result.field_degC[:, 0].mean() == pytest.approx(12.0 + 6.0 / 1.5, abs=1e-6)
    assert np.all(ran(physics, 100).book_J[:, COOLANT] == 0.0)


def test_radiation_at_rest() -> None:
    """εσA(T⁴ − T_air⁴) = Q for a screw of one temperature."""
    result = ran(even(motor_W=np.array([20.0, 0.0]), emissivity=0.8), 40_000, 5.0, [0.5])
    area = 5.670374419e-8 * 0.8 * SURFACE_m2
    expected = (293.15**4 + 20.0 / area) ** 0.25 - 273.15
    # the heated end is 0.02 K warmer than the other
    assert result.section_degC[-1, 0] == pytest.approx(expected, abs=2e-3)
    assert result.book_J[-1, RADIATION] == pytest.approx(-100.0, rel=1e-5)


def test_film_of_rotation() -> None:
    """Re = 104.72·0.036²/15.5e-6 = 8756, Nu = 0.133·424.8·0.8963 = 50.6, h = 35.7 W/m²K at 1000 rpm."""
    assert rotating_film_W_m2K(1000.0, 0.036) == pytest.approx(35.73, abs=0.02)
    assert rotating_film_W_m2K(-2000.0, 0.036) == pytest.approx(35.73 * 2 ** (2 / 3), abs=0.05)
    assert rotating_film_W_m2K(0.0, 0.036) == 0.0


def test_a_turning_screw_cools_faster() -> None:
    """A warm screw of one temperature: exp(−h t·4/(ρcd)) with h the base and the gain's part of rotation."""
    physics = even(film_W_m2K=np.full(SLICES, 15.0), rotation_gain=0.2)
    result = ran(physics, 2400, 0.5, [0.5], start_degC=40.0, speed_rpm=1000.0)
    film_W_m2K = 15.0 + 0.2 * 35.73
    left = math.exp(-film_W_m2K * SURFACE_m2 * 1200.0 / CAPACITY_J_K)
    assert result.section_degC[-1, 0] == pytest.approx(20.0 + 20.0 * left, abs=2e-3)


def test_uneven_film_acts_on_its_stretch() -> None:
    machine = apply(plain_machine(), hidden("uneven_convection", from_m=0.205, to_m=0.405, extra_W_m2K=7.0))
    extra = machine.physics.extra_film_W_m2K
    assert extra.sum() / 100 == pytest.approx(7.0 * 0.2)
    assert extra[20] == pytest.approx(3.5)
    assert extra[30] == pytest.approx(7.0)
    assert extra[41:].max() == 0.0
    warm = ran(machine.physics._replace(film_W_m2K=np.zeros(100)), 2, start_degC=30.0)
    assert warm.book_J[0, FILM] == pytest.approx(-7.0 * 0.2 * SURFACE_m2 * 10.0 * 0.5, rel=1e-3)


def test_a_hidden_film_is_all_the_film_there_is() -> None:
    """It keeps the machine's unevenness, also in a case, whose configuration knows of no film."""
    effect = hidden("surface_convection", coefficient_W_m2K=8.0)
    physics = machine_of(Case("film", (effect,), 5)).physics
    assert physics.film_W_m2K.mean() == pytest.approx(8.0)
    assert 0.0 < np.ptp(physics.film_W_m2K) < 0.2
    assert not machine_of(Case("film", (), 5, unknown=("film",))).physics.film_W_m2K.any()


def test_friction_laws() -> None:
    physics = bare(
        friction_W_rpm=np.array([0.01, 0.006, 0.006]),
        exponent=np.array([1.5, 1.0, 1.0]),
        fade_1_K=at(LEFT, 0.02),
        run_in=at(2, 0.5),
        run_in_s=np.full(3, 900.0),
    )
    assert friction_W(physics, NUT, 1000.0, 0.0, 35.0) == pytest.approx(10.0)
    assert friction_W(physics, NUT, 4000.0, 0.0, 35.0) == pytest.approx(80.0)
    assert friction_W(physics, LEFT, 1000.0, 0.0, 20.0) == pytest.approx(6.0)
    assert friction_W(physics, LEFT, -500.0, 0.0, 70.0) == pytest.approx(3.0 * math.exp(-1.0))
    assert friction_W(physics, 2, 1000.0, 900.0, 20.0) == pytest.approx(6.0 * (1 + 0.5 * math.exp(-1.0)))
    assert friction_W(physics, NUT, 0.0, 0.0, 20.0) == 0.0


def test_running_in_waits_while_the_screw_rests() -> None:
    physics = bare(friction_W_rpm=at(LEFT, 0.006), run_in=at(LEFT, 1.0), run_in_s=np.full(3, 100.0))
    speed = np.repeat([0.0, 1000.0, 0.0, 1000.0], 200)
    power_W = ran(physics, 800, 0.5, speed_rpm=speed).book_J[:, FRICTION] / 0.5
    assert power_W[200] == pytest.approx(12.0, abs=0.02)
    assert power_W[600] == pytest.approx(power_W[399], rel=0.01)
    assert power_W[600] == pytest.approx(6.0 * (1 + math.exp(-1.0)), abs=0.02)


def test_fading_follows_the_screw_where_the_heat_enters() -> None:
    """The nut rubs by the temperature under it, a bearing by that of its end face."""
    nut = bare(friction_W_rpm=at(NUT, 0.02), fade_1_K=at(NUT, 0.05))
    assert ran(nut, 2, start_degC=40.0, speed_rpm=1000.0).book_J[0, FRICTION] == pytest.approx(
        10.0 * math.exp(-1.0), rel=1e-9
    )
    end = bare(friction_W_rpm=at(LEFT, 0.02), fade_1_K=at(LEFT, 0.02), motor_W=np.array([0.0, 30.0]))
    far = ran(end, 60, speed_rpm=1000.0).book_J[:, FRICTION]
    assert far[0] == pytest.approx(10.0, rel=1e-9)
    assert far[-1] < 0.95 * 10.0  # its own heat warms it; the other end's has not come


def test_what_dwells_enters_at_both_ends_of_the_stroke() -> None:
    """Without conduction heat lies where it entered: half of the fraction over a nut's length at each end."""
    physics = bare(conductivity_W_mK=1e-3, friction_W_rpm=at(NUT, 0.01), dwell=1.0)
    result = ran(physics, 100, 0.5, speed_rpm=1500.0)
    warmth = (result.field_degC - 20.0).mean(axis=1)
    middle_m = (np.arange(SLICES) + 0.5) / SLICES
    low, high = np.abs(middle_m - 0.2) < 0.05, np.abs(middle_m - 0.8) < 0.05
    assert warmth[~low & ~high].max() < 1e-4 * warmth.max()  # a little is conducted
    assert warmth[low].sum() == pytest.approx(warmth[high].sum())


@pytest.mark.parametrize(
    ("place", "where_m"), [("nut", np.linspace(0.165, 0.235, 8)), ("left", [0.0]), ("right", [1.0])]
)
def test_a_body_trails_the_screw_where_it_sits(place: str, where_m: list[float]) -> None:
    """C dT/dt = G (T_screw − T): a first-order lag C/G behind the nut's footprint or the end."""
    effect = hidden("attached_mass", place, capacity_J_K=150.0, conductance_W_K=2.0)
    body = ("nut", "left", "right").index(place)
    physics = apply(replace(plain_machine(), physics=bare()), effect).physics
    physics = physics._replace(motor_W=np.array([20.0, 20.0]), local_W=np.full(SLICES, 40.0 / SLICES))
    result = ran(physics, 400, 0.5, where_m)
    # the nut touches the surface, which a heat flux q'' makes q'' R/4k warmer than the section's mean
    skin_K = 40.0 / SURFACE_m2 * 0.018 / (4 * 50.0) if place == "nut" else 0.0
    touched = result.section_degC.mean(axis=1, keepdims=True) + skin_K * (np.arange(401)[:, None] > 0)
    trailing = lagged(touched, 0.5, np.array([75.0]))[:, 0]
    # 2 %: in the first seconds the gradient at a face is steeper than slices of 2 cm can resolve
    np.testing.assert_allclose(result.body_degC[:, body], trailing, atol=0.02 * np.ptp(trailing))
    assert np.ptp(np.delete(result.body_degC, body, axis=1)) == 0.0


def test_a_nuts_body_takes_its_part_of_the_friction_and_loses_to_the_air() -> None:
    """C dT/dt = share Q − G (T − T_air), next to without a contact: 1 − exp in closed form."""
    effect = hidden(
        "attached_mass", "nut", capacity_J_K=300.0, conductance_W_K=1e-6, heat_share=0.8, loss_W_K=1.5
    )
    physics = apply(replace(plain_machine(), physics=bare(friction_W_rpm=at(NUT, 0.02))), effect).physics
    body = ran(physics, 400, 0.5, speed_rpm=1000.0).body_degC[-1, NUT]
    rise_K = 0.8 * 20.0 / 1.5 * (1 - math.exp(-200.0 * 1.5 / 300.0))
    assert body - 20.0 == pytest.approx(rise_K, rel=2e-3)  # steps of Euler, C/G = 200 s, of 0.5 s


def test_a_sensor_that_reads_toward_the_air_shows_less_of_the_rise() -> None:
    section, air = np.full((3, 5), 40.0), np.full(3, 20.0)
    machine = replace(plain_machine(), toward_air=np.full(5, 0.03))
    shown = true_readings(machine, section, air, np.ones((3, 5)), 0.5)
    np.testing.assert_allclose(shown, 39.4)


def test_torque_differs_between_runs_and_rows_come_every_minute() -> None:
    case = Case("rough", (), 1, faults=("minutes",), torque=0.1)
    traced = [trace(case, run) for run in "ab"]
    factors = [t.scene.schedule.nut_factor[0] for t in traced]
    assert abs(factors[0] - factors[1]) > 0.01
    np.testing.assert_allclose(np.diff(logged(case, "a", traced[0]).time_s), 60.0)


def test_steady_heats() -> None:
    """What a motor, an end and a place make, in J; nothing else warms the screw."""
    physics = bare(motor_W=np.array([3.0, 0.0]), end_heat_W_rpm=np.array([0.0, 2e-3]))
    speed = np.repeat([0.0, 1500.0], 100)
    book = ran(physics, 200, 0.5, speed_rpm=speed).book_J
    np.testing.assert_allclose(book[:100, STEADY_HEAT], 3.0 * 0.5, rtol=1e-12)
    np.testing.assert_allclose(book[100:, STEADY_HEAT], (3.0 + 2e-3 * 1500.0) * 0.5, rtol=1e-12)
    spot = apply(plain_machine(), hidden("local_heat", position_m=0.383, heat_W=6.0)).physics
    middle_m = (np.arange(100) + 0.5) / 100
    assert spot.local_W.sum() == pytest.approx(6.0)
    assert spot.local_W @ middle_m / 6.0 == pytest.approx(0.383)


def test_the_air_drifts_from_the_logged_one() -> None:
    traced = trace(Case("air", (hidden("ambient_drift", rate_K_h=-2.0),), 5), "a")
    felt, recorded_degC = traced.scene.schedule.air_degC, 0.5 * (traced.air_degC[1:] + traced.air_degC[:-1])
    time_h = (np.arange(len(felt)) + 0.5) * 0.5 / 3600.0
    np.testing.assert_allclose(felt - recorded_degC, -2.0 * time_h, atol=1e-12)


def test_a_lag_follows_a_step_and_trails_a_ramp() -> None:
    value = np.ones((601, 2))
    value[0] = 0.0
    value[:, 1] = np.arange(601) * 0.5 * 0.01
    out = lagged(value, 0.5, np.array([60.0, 60.0]))
    # the step is a ramp over the first half second
    assert out[120, 0] == pytest.approx(1 - math.exp(-(60.0 - 0.25) / 60.0), abs=1e-5)
    assert value[600, 1] - out[600, 1] == pytest.approx(0.6 * (1 - math.exp(-5.0)), abs=1e-9)


def test_what_sensors_add() -> None:
    machine = apply(plain_machine(), hidden("sensor_bias", "t2", offset_K=0.7))
    machine = apply(machine, hidden("sensor_drift", "t5", rate_K_h=1.8))
    flat = np.full((3601, 5), 30.0)
    shown = true_readings(machine, flat, np.full(3601, 20.0), np.ones_like(flat), 0.5)
    np.testing.assert_allclose(shown[-1], [30.0, 30.7, 30.0, 30.0, 30.9])
    np.testing.assert_allclose(shown[0], [30.0, 30.7, 30.0, 30.0, 30.0])
