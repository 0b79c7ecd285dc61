"""The lumped machines of the first day: conserved heat, steady states by hand, possible motion."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from tests.truth.bar import Bar, End
from tests.truth.closed_forms import steady_fin
from tests.truth.first_day.log import BLOCK, shift_of
from tests.truth.first_day.machine import EXPANSION_1_K, FirstDayMachine, Room, draw_machine
from tests.truth.first_day.programme import Programme
from tests.truth.first_day.thermal import (
    AIR,
    AIR_ROOM_W_K,
    BODIES,
    COLUMN,
    HEAD,
    LEFT,
    LOOKS,
    MOTOR,
    MOTOR_AIR_W_K,
    MOTOR_IDLE_W,
    MOTOR_LOSS,
    NUT,
    RIGHT,
    STEP_s,
    Thermal,
    Work,
    averaged,
    error_um,
    field_degC,
)

CALM = Room(20.0, 0.0, 0.0, np.array([[0.0], [1.0], [0.0]]))
SPEED_rpm = 1000.0


def turning_only(machine: FirstDayMachine) -> Work:
    """Return a step in which the screw turns at `SPEED_rpm` and the nut covers no cell."""
    return Work(np.zeros(machine.cells), *np.array([SPEED_rpm, 300.0, 1.0]))


def one_bearing(machine: FirstDayMachine, share: float) -> FirstDayMachine:
    """Return the machine in a calm room, where only the left bearing rubs, exactly by its law.

    `share` of its heat enters the screw; nothing is bolted to column, head or motor.
    """
    law = machine.nut._replace(load_part=0.0, fade_1_K=0.0, run_in=0.0, exponent=0.0, share=share)
    return replace(
        machine,
        room=CALM,
        nut=law._replace(scale=0.0),
        bearings=(law._replace(scale=1.0), law._replace(scale=0.0)),
        housing_column_W_K=np.zeros(2),
        motor_housing_W_K=0.0,
        coupling_W_K=0.0,
        spindle_W=0.0,
        air_rise_K_m=0.0,
        start_K=0.0,
    )


@pytest.mark.parametrize("number", [1, 2])
def test_heat_that_entered_is_stored_or_has_left(number: int) -> None:
    machine = draw_machine(number)
    thermal = Thermal(machine)
    before_J = thermal.stored_J
    looks_s = 300.0 + (np.arange(BLOCK * LOOKS) + 0.5) * STEP_s / LOOKS
    for row in zip(*averaged(machine, machine.programme(0.2).at(looks_s)), strict=True):
        thermal.advance(STEP_s, Work(*row))
    assert thermal.entered_J > 500.0
    stored_J = thermal.stored_J - before_J
    assert stored_J == pytest.approx(thermal.entered_J - thermal.left_J, rel=1e-6, abs=1e-6)


def test_the_steady_state_of_two_housings_and_a_screw_without_film_is_the_one_by_hand() -> None:
    share = 0.4
    machine = replace(one_bearing(draw_machine(1), share), still_W_m2K=0.0, turning_W_m2K=0.0)
    heat_W = machine.screw.bearing_W_rpm * SPEED_rpm
    motor_W = MOTOR_IDLE_W + MOTOR_LOSS * heat_W
    air_degC = 20.0 + (heat_W + motor_W) / AIR_ROOM_W_K
    left_W_K, right_W_K = machine.housing_air_W_K
    between_m = machine.nameplate.length_m * (1.0 - 1.0 / machine.cells)
    screw_K_W = between_m / (machine.conductivity_W_mK * math.pi * machine.screw.root_m**2 / 4.0)
    out_at_left_K_W = 1.0 / machine.bearing_W_K[0]
    way_right_K_W = screw_K_W + 1.0 / machine.bearing_W_K[1] + 1.0 / right_W_K
    # Of a heat in the left housing this part takes the way through the screw to the right housing …
    through = 1.0 / left_W_K / (1.0 / left_W_K + out_at_left_K_W + way_right_K_W)
    # … and of one in the screw's left end this one.
    along = (1.0 / left_W_K + out_at_left_K_W) / (1.0 / left_W_K + out_at_left_K_W + way_right_K_W)
    right_W = heat_W * ((1.0 - share) * through + share * along)
    thermal = Thermal(machine)
    ends_degC = air_degC + right_W * np.array([way_right_K_W, way_right_K_W - screw_K_W])
    thermal.screw_degC = np.linspace(*ends_degC, machine.cells)
    thermal.body_degC = np.full(len(BODIES), air_degC)
    thermal.body_degC[LEFT] += (heat_W - right_W) / left_W_K
    thermal.body_degC[RIGHT] += right_W / right_W_K
    thermal.body_degC[MOTOR] += motor_W / MOTOR_AIR_W_K
    screw_degC, body_degC = thermal.screw_degC, thermal.body_degC
    for _ in range(1000):
        thermal.advance(STEP_s, turning_only(machine))
    assert thermal.screw_degC == pytest.approx(screw_degC, abs=1e-9)
    assert thermal.body_degC == pytest.approx(body_degC, abs=1e-9)
    assert body_degC[[NUT, HEAD, COLUMN, AIR]] == pytest.approx(air_degC)


def test_a_screw_in_air_heated_at_its_end_settles_like_the_fin_of_the_textbook() -> None:
    machine = replace(
        one_bearing(draw_machine(1), share=1.0),
        still_W_m2K=150.0,
        turning_W_m2K=0.0,
        bearing_W_K=np.zeros(2),
    )
    thermal = Thermal(machine)
    for _ in range(16_000):
        thermal.advance(STEP_s, turning_only(machine))
    cell_m = machine.nameplate.length_m / machine.cells
    middle_m = (np.arange(machine.cells) + 0.5) * cell_m
    bar = Bar(
        length_m=machine.nameplate.length_m,
        diameter_m=machine.screw.root_m,
        conductivity_W_mK=machine.conductivity_W_mK,
        convection_W_m2K=150.0,
    )
    insulated = (End("insulated"), End("insulated"))
    rise_K = steady_fin(bar, insulated, 0.0, machine.screw.bearing_W_rpm * SPEED_rpm, middle_m)
    found_K = thermal.screw_degC - thermal.body_degC[AIR]
    assert found_K == pytest.approx(rise_K, abs=0.01 * rise_K[0])


@pytest.mark.parametrize("number", range(1, 5))
def test_the_nut_moves_as_its_axis_can(number: int) -> None:
    machine = draw_machine(number)
    time_s = np.arange(0.0, 600.0, 0.002)
    motion = machine.programme(0.25).at(time_s)
    low_m, high_m = machine.nameplate.stroke_m
    assert low_m - 1e-9 <= motion.position_m.min() < motion.position_m.max() <= high_m + 1e-9
    assert np.abs(motion.velocity_m_s).max() == pytest.approx(machine.axis.rapid_m_s, rel=1e-2)
    assert np.abs(np.diff(motion.velocity_m_s)).max() <= 0.002 * machine.axis.acceleration_m_s2 * 2.001
    way_m = np.cumsum((motion.velocity_m_s[1:] + motion.velocity_m_s[:-1]) / 2.0) * 0.002
    assert motion.position_m[1:] - motion.position_m[0] == pytest.approx(way_m, abs=2e-3)


def test_a_longer_shift_begins_like_a_shorter_one() -> None:
    machine = draw_machine(2)
    short, long = shift_of(machine, 0.02), shift_of(machine, 0.03)
    assert np.array_equal(short.readings, long.readings[: len(short.readings)], equal_nan=True)


def test_temperatures_come_every_half_second_in_counts_of_a_tenth() -> None:
    readings = shift_of(draw_machine(1), 0.01).readings
    degC = readings[:, [0, 1, 2, 5]]
    assert np.array_equal(np.isfinite(degC).all(axis=1), np.arange(len(degC)) % 5 == 0)
    assert degC[::5] * 10.0 == pytest.approx(np.round(degC[::5] * 10.0), abs=1e-9)
    assert np.isfinite(readings[:, 3:5]).all()


def test_the_work_of_a_machine_does_not_depend_on_how_it_is_asked_for() -> None:
    machine = draw_machine(3)
    time_s = np.arange(0.0, 60.0, 0.37)
    programme: Programme = machine.programme(0.1)
    one_by_one = [float(programme.at(np.array([t])).position_m[0]) for t in time_s]
    assert programme.at(time_s).position_m == pytest.approx(one_by_one)


def test_a_uniform_rise_moves_each_place_by_its_distance_from_the_fixed_bearing() -> None:
    for number in range(1, 9):
        machine = draw_machine(number)
        length_m = machine.nameplate.length_m
        places_m = np.linspace(0.0, length_m, 21)
        warm_degC = np.full(machine.cells, 25.0)
        fixed_m = 0.0 if machine.nameplate.fixed == "left" else length_m
        expected_um = 1e6 * EXPANSION_1_K * 5.0 * (places_m - fixed_m)
        assert error_um(machine, warm_degC, places_m, 20.0) == pytest.approx(expected_um, abs=1e-9)
        assert field_degC(machine, warm_degC, places_m) == pytest.approx(25.0)
