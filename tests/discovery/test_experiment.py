"""Which test would distinguish two answers."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache

import pytest

from observer.config.effects.base import EffectTable
from observer.config.effects.heat import EndHeat, MotorHeat
from observer.config.machine import Config
from observer.discovery import experiment
from observer.discovery.experiment import SEPARATES, Phase, habits_of, menu, propose
from observer.fit.problem import Problem
from tests.discovery.small import problem_of
from tests.logs.machines import machine
from tests.logs.simulated import made_log

CONFIG = machine()
SPEED_RPM, HEAT_W = 1000.0, 2.0
REST, WORK = Phase(3600.0, 0.0, 0.0, 0.4), Phase(3600.0, SPEED_RPM, 0.0, 0.4)


@cache
def problem() -> Problem:
    """Logs at one speed, at which a motor's heat and that of a bearing are alike while it turns."""
    return problem_of(
        CONFIG, [made_log(CONFIG, seed, minutes=60.0, speed_rpm=SPEED_RPM) for seed in range(2)]
    )


def lacking(*effects: EffectTable) -> Config:
    return CONFIG.model_copy(update={"effect": effects})


def motor(heat_W: float = HEAT_W) -> EffectTable:
    return MotorHeat(kind="motor_heat", target="right", heat_W=heat_W)


BEARING = EndHeat(kind="end_heat", target="right", heat_W_rpm=HEAT_W / SPEED_RPM)


def separation(of: Problem, answers: Sequence[Config], phases: Sequence[Phase]) -> float:
    return experiment.separation(of, answers, phases, habits_of(of))


def test_habits_are_those_of_the_logs() -> None:
    habits = habits_of(problem())
    assert (habits.usual_rpm, habits.fastest_rpm) == (SPEED_RPM, SPEED_RPM)
    assert habits.ambient_degC == 20.0


@pytest.mark.slow
def test_a_standstill_distinguishes_a_motor_from_a_bearing() -> None:
    """It is heat that stays when nothing turns; every other cycle of the menu takes longer or shows less."""
    proposed = propose(problem(), [lacking(BEARING), lacking(motor())])
    assert proposed.name == "standstill"
    assert proposed.duration_s == 5400.0
    assert proposed.separation_sigma > SEPARATES
    assert "drive on" in proposed.description


def test_what_a_cycle_cannot_show_it_does_not_separate() -> None:
    at_rest = separation(problem(), [lacking(), lacking(BEARING)], [REST])
    assert at_rest == pytest.approx(0.0, abs=1e-6)  # a bearing that does not turn makes no heat
    same = separation(problem(), [lacking(motor()), lacking(motor())], [WORK])
    assert same == 0.0
    free = separation(problem(), [lacking(), lacking(BEARING)], [REST, WORK, REST])
    assert free < 1.0  # the bearing's scale is free, and makes up for it


def test_a_heat_twice_as_large_is_twice_as_far() -> None:
    one, two = (separation(problem(), [lacking(), lacking(motor(heat_W))], [REST]) for heat_W in (0.5, 1.0))
    assert two == pytest.approx(2 * one, rel=1e-6)  # the screw is linear


def test_of_three_answers_the_nearest_two_count() -> None:
    answers = [lacking(), lacking(motor(0.5)), lacking(motor(2.0))]
    pair = separation(problem(), answers[:2], [REST])
    assert separation(problem(), answers, [REST]) == pytest.approx(pair, rel=1e-9)


def test_every_cycle_of_the_menu_can_be_run() -> None:
    habits = habits_of(problem())
    for name, text, phases in menu(habits):
        assert text, name
        assert all(p.duration_s > 0 and 0 <= p.speed_rpm <= habits.fastest_rpm for p in phases)
        assert all(habits.low_m <= p.low_m < p.high_m <= habits.high_m for p in phases)
