from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from observer.model.build import build_plant
from observer.model.simulate import start_from_sensors
from tests.logs.machines import machine

PRESCRIBED = {"left": {"kind": "prescribed", "channel": "left_degC"}}


def _z(plant, temperature_degC):
    return np.where(np.array(plant.known_names) == "reference", 0.0, temperature_degC)


@pytest.mark.parametrize("boundary", [{}, PRESCRIBED])
def test_a_screw_at_one_temperature_starts_at_it_everywhere(boundary) -> None:
    plant = build_plant(machine(boundary=boundary))
    state = start_from_sensors(plant, np.full(3, 31.0), np.full(3, 1e-4), np.zeros(2), _z(plant, 31.0))
    rows = plant.rows.C @ state + plant.rows.F @ _z(plant, 31.0)
    np.testing.assert_allclose(rows, 31.0, atol=1e-6)  # the steady field's closed forms, rounded


def test_the_start_agrees_with_the_sensors_and_is_smooth_between_them() -> None:
    plant = build_plant(machine())
    y_degC = np.array([20.0, 26.0, 23.0])
    state = start_from_sensors(plant, y_degC, np.full(3, 1e-6), np.zeros(2), _z(plant, 20.0))
    rows = plant.rows.C @ state + plant.rows.F @ _z(plant, 20.0)
    np.testing.assert_allclose(rows[:3], y_degC, atol=1e-2)  # ten standard deviations of the noise given
    assert rows[3:].min() > 18.0
    assert rows[3:].max() < 28.0


def test_a_sensor_without_a_value_takes_no_part() -> None:
    plant = build_plant(machine())
    law_W, R = np.array([3.0, 1.0]), np.full(3, 1e-3)
    y_degC = np.array([20.0, 26.0, 23.0])
    rows = replace(plant.rows, C=plant.rows.C[[0, 2]], F=plant.rows.F[[0, 2]], sensors=2)
    two = replace(plant, rows=rows, thermal=plant.thermal[[0, 2]])
    masked = start_from_sensors(plant, np.where([1, 0, 1], y_degC, np.nan), R, law_W, _z(plant, 20.0))
    without = start_from_sensors(two, y_degC[[0, 2]], R[:2], law_W, _z(plant, 20.0))
    np.testing.assert_allclose(masked, without, rtol=1e-12)
    with pytest.raises(ValueError, match="no sensor"):
        start_from_sensors(plant, np.full(3, np.nan), R, law_W, _z(plant, 20.0))
