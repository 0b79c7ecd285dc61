"""What the reduced observer does when something goes wrong, by its reference in Python."""

from __future__ import annotations

import copy
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from observer.config.mounting import Compensation
from observer.estimators.design.gains import everything
from observer.estimators.design.steady import standing_growth_1_s, steady_kalman
from observer.export.data import Exportable, observer_form
from observer.export.form import Form, FormRunner
from observer.export.gain_sets import gain_sets
from observer.installation import load
from tests.export.made import built, by_c, nut_machine
from tests.logs.machines import RIG

OF_THE_RIG = (*(f"t{i}_degC" for i in range(1, 6)), "nut_position_m", "screw_speed_rpm", "ambient_degC")
SENSORS = tuple(f"t{i}_degC" for i in range(1, 6))
WARM = dict.fromkeys((*SENSORS, "ambient_degC"), 5.0)
USUAL = {"nut_position_m": 0.46, "screw_speed_rpm": 0.0}
TRAVEL_M = np.linspace(0.15, 0.8, 7)
COMPENSATION = Compensation(points=7, rate_limit_um_s=0.3, gradient_limit_um_m=40.0)


class Stepped:
    """The rig, standing; `off` adds to 20 °C or what is usual, and what is in `gone` never comes."""

    def __init__(self, form: Form) -> None:
        self.runner = FormRunner(form)
        self.labels = next(slot.labels for slot in form.slots if slot.name == "reading")
        self.beat = 0
        self.out: dict[str, Any] = {}

    def step(
        self,
        count: int = 1,
        *,
        gone: tuple[str, ...] = (),
        alive: bool = True,
        enable: bool = True,
        **off: float,
    ) -> dict[str, Any]:
        for _ in range(count):
            self.beat += alive
            self.out = self.runner.step(
                {
                    "reading": [USUAL.get(name, 20.0) + off.get(name, 0.0) for name in self.labels],
                    "fresh": [name not in gone for name in self.labels],
                    "enable": enable,
                    "heartbeat": self.beat,
                }
            )
        return self.out


@pytest.fixture(scope="module")
def form() -> Form:
    config = load(RIG / "config.toml")
    return observer_form(config.model_copy(update={"compensation": COMPENSATION}))


@pytest.fixture(scope="module")
def settled(form: Form) -> Stepped:
    """Settled, warmer by 5 K than the reference, and armed."""
    made = Stepped(form)
    made.step(enable=False)
    made.step(3, enable=False, **WARM)  # all rises at once: the state is opened for it
    made.step(form.constants["SETTLED"] + 5, enable=False, **WARM)
    assert made.out["quality"] == 0
    made.step(**WARM)
    assert made.out["armed"]
    return made


@pytest.fixture
def machine(settled: Stepped) -> Stepped:
    """A copy of it, to do with as a test likes."""
    own = Stepped(settled.runner.form)
    own.beat, own.out, own.runner.v = settled.beat, settled.out, copy.deepcopy(settled.runner.v)
    return own


def test_the_compensation_follows_at_its_rate(form: Form, machine: Stepped) -> None:
    first = np.array(machine.out["compensation_um"])
    then = np.array(machine.step(**WARM)["compensation_um"])
    assert np.max(np.abs(then - first)) == pytest.approx(0.3 * form.period_s)
    machine.step(600, **WARM)
    error_um, table_um = machine.out["error_um"], machine.out["compensation_um"]
    growth_um = 11.8 * 5.0 * TRAVEL_M
    at_travel_um = np.interp(TRAVEL_M, np.linspace(0.0, 1.0, 21), error_um)
    np.testing.assert_allclose(at_travel_um, growth_um, atol=0.5)
    slopes_um_m = np.diff(table_um) / np.diff(TRAVEL_M)
    assert np.max(np.abs(slopes_um_m)) <= 40.0 * (1.0 + 1e-9), "the gradient limit"
    assert table_um[3] == pytest.approx(growth_um[3], abs=0.5), "the middle of the travel is kept"
    assert machine.out["compensation_nut_um"] == pytest.approx(np.interp(0.46, TRAVEL_M, table_um))


@pytest.mark.parametrize("lost", ["heartbeat", "sensor", "nut", "enable"])
def test_any_loss_takes_the_compensation_to_zero_until_it_is_armed_again(machine: Stepped, lost: str) -> None:
    machine.step(100, **WARM)
    held_um = np.array(machine.out["compensation_um"])
    given: dict[str, Any] = {
        "heartbeat": {"alive": False}, "sensor": {"gone": ("t1_degC",)}, "nut": {"gone": ("nut_position_m",)},
        "enable": {"enable": False},
    }[lost]  # fmt: skip
    machine.step(12, **given, **WARM)
    assert not machine.out["armed"]
    assert np.all(np.array(machine.out["compensation_um"]) < held_um)
    machine.step(300, **given, **WARM)
    assert machine.out["compensation_um"] == [0.0] * 7
    machine.step(20, **WARM)
    if lost != "enable":
        assert not machine.out["armed"], "all is well again, but nobody has armed"
        machine.step(enable=False, **WARM)
        machine.step(**WARM)
    assert machine.out["armed"]


def test_a_single_sensor_that_is_off_stays_rejected(machine: Stepped) -> None:
    before = list(machine.out["field_degC"])
    found = machine.step(50, **(WARM | {"t1_degC": 25.0}))
    assert found["sensor_quality"] == [3, 0, 0, 0, 0]
    assert found["quality"] == 2
    # beside the sensor nobody knows; farther on the others hold the field, within what their gain makes of it
    np.testing.assert_allclose(found["field_degC"][6:], before[6:], atol=0.2)
    assert machine.step(**WARM)["sensor_quality"] == [0, 0, 0, 0, 0]


def test_most_sensors_off_for_three_steps_are_right(machine: Stepped) -> None:
    moved = dict.fromkeys(WARM, 13.0)
    assert machine.step(2, **moved)["sensor_quality"] == [3, 3, 3, 3, 3]
    found = machine.step(1, **moved)
    assert found["sensor_quality"] == [0, 0, 0, 0, 0]
    assert found["quality"] == 1, "it starts anew"
    np.testing.assert_allclose(machine.step(**moved)["innovation_K"], 0.0, atol=0.05)


def test_with_too_few_sensors_it_predicts(form: Form, machine: Stepped) -> None:
    found = machine.step(5, gone=SENSORS[:3], **(WARM | {"t5_degC": 5.3}))
    assert machine.runner.v.chosen == form.constants["NONE"]
    assert found["quality"] == 2
    assert found["age_s"][0] == 2.5
    assert machine.step(5, gone=SENSORS)["quality"] == 3


def test_a_nut_that_is_lost_is_everywhere(form: Form, machine: Stepped) -> None:
    machine.step(2, gone=("nut_position_m",), **WARM)
    here = form.constants["NUT_B"][0]
    np.testing.assert_allclose(machine.runner.v.B[0], here[round(0.46 * form.constants["PLACES_1_M"])])
    machine.step(1, gone=("nut_position_m",), **WARM)
    np.testing.assert_allclose(machine.runner.v.B[0], here[-1])


def test_values_that_are_none_and_values_beyond_limits_do_not_count(machine: Stepped) -> None:
    for value in (np.nan, np.inf, 500.0):
        found = machine.step(3, **(WARM | {"t2_degC": value}))
        assert found["sensor_quality"] == [0, 2, 0, 0, 0]
        assert np.isfinite(found["field_degC"]).all()
        machine.step(**WARM)


def test_gains_are_those_of_the_estimator_for_each_set_of_sensors() -> None:
    config = nut_machine()
    own = Exportable(config)
    sets = gain_sets(config, own.plant, own.step)
    for i in range(-1, 4):
        present = everything(own.plant)
        if i >= 0:
            present[i] = False
        number = sets.number[i if i >= 0 else 4, 4]
        if number == len(sets.K) - 1:
            assert config.sensor[i].name in sets.refused
            continue
        doubtful = [
            replace(own.plant, noise_R_K2=times * own.plant.noise_R_K2) for times in 10.0 ** np.arange(5)
        ]
        gains = [steady_kalman(plant, own.step, present) for plant in doubtful]
        equal = [np.array_equal(sets.K[number].T, K) for K in gains]
        assert sum(equal) == 1
        assert standing_growth_1_s(own.plant, own.step, sets.K[number].T) <= 1e-5
        assert all(standing_growth_1_s(own.plant, own.step, K) > 1e-5 for K in gains[: equal.index(True)])
        assert not sets.K[number][~present].any()
        assert np.all(sets.gate_K2[number] < sets.gate_K2[number + len(sets.K) // 2])
    assert not sets.K[-1].any()


@pytest.mark.parametrize("gone", range(5))
def test_without_a_sensor_nothing_diverges_while_the_nut_stands(
    form: Form, tmp_path: Path, gone: int
) -> None:
    """The others say what no model does, for hours: the estimate settles, and does not grow without end."""
    steps, lost = 4 * 7200, 1800
    inputs = [
        {
            "reading": [USUAL.get(name, 28.0 if name in SENSORS else 25.0) for name in OF_THE_RIG],
            "fresh": [not (i == gone and k >= lost) for i in range(len(OF_THE_RIG))],
            "enable": False,
            "heartbeat": k % 1000,
        }
        for k in range(steps)
    ]
    error_um = by_c(form, built(form, tmp_path, "gcc", "-O2"), inputs)["error_um"][:, -1]
    before, later, last = error_um[[lost - 1, steps // 2, -1]]
    assert abs(last - later) < 0.1 * before
    # what the lost one would have said against it is gone, and no more than that
    assert abs(last - before) < 0.5 * before
