"""The plant, its python-control twin and Kim's lifted form are the same system."""

from __future__ import annotations

import control
import numpy as np
import pytest
from scipy.linalg import expm

from observer.config.machine import Config
from observer.frames import FloatArray, Inputs
from observer.installation import parse
from observer.model.build import build_plant
from observer.model.generator import state_space
from observer.model.rod.modes import Stretch, solve_modes
from observer.model.rod.screw import rod_of
from observer.model.simulate import simulate
from tests.model.test_generator import machine
from tests.reference.printed import kim_form

DT_S = 5.0
STEPS = 200


def _config(film_W_m2K: float, right: str) -> Config:
    ends = {"left": {"kind": "prescribed", "channel": "left_degC"}}
    ends["right"] = {"kind": right} | ({"channel": "right_degC"} if right == "prescribed" else {})
    return parse(
        {
            "screw": {
                "length_m": 0.5, "diameter_m": 0.04, "conductivity_W_mK": 60.5, "density_kg_m3": 7800.0,
                "specific_heat_J_kgK": 464.0, "expansion_1_K": 11e-6,
            },
            "surface": {"convection_W_m2K": film_W_m2K},
            "ambient": {"temperature_degC": 0.0},
            "boundary": ends,
            "source": [{"name": "nut", "shape": "band", "from_m": 0.1, "to_m": 0.2}],
            "sensor": [{"name": "a", "channel": "a_degC", "position_m": 0.05},
                       {"name": "b", "channel": "b_degC", "position_m": 0.33}],
            "model": {"modes": 9},
            "output": {"reference_degC": 0.0},
        }
    )  # fmt: skip


def _ends(t_s: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Piecewise linear end temperatures, so that the plant's step is exact for them."""
    corners = np.array([0.0, 200.0, 300.0, 700.0, 1000.0])
    left = np.interp(t_s, corners, [0.0, 8.0, 5.0, 9.0, 2.0])
    right = np.interp(t_s, corners, [0.0, -3.0, 4.0, 4.0, 6.0])
    return left, right


def _ours(config: Config) -> tuple[FloatArray, FloatArray]:
    """Rows of our plant from rest under 20 W and moving ends, and the times of its steps."""
    plant = build_plant(config)
    t = np.arange(STEPS + 1) * DT_S
    left, right = _ends(t)
    z = np.zeros((STEPS + 1, len(plant.known_names)))
    z[:, plant.known_names.index("left")] = left
    if "right" in plant.known_names:
        z[:, plant.known_names.index("right")] = right
    s = plant.rows.sensors
    inputs = Inputs(
        time_s=t[1:], dt_s=np.full(STEPS, DT_S), y_degC=np.zeros((STEPS, s)),
        usable=np.zeros((STEPS, s), dtype=bool), quality=np.zeros((STEPS, s), dtype=np.int8),
        law_W=np.full((STEPS, 1), 20.0), law_jump_W=np.zeros((STEPS, 1)), z_start=z[:-1], z_end=z[1:],
        moving_B=np.zeros((STEPS, 0, len(plant.decay_1_s))), moving_C=np.zeros((STEPS, 0, len(plant.rows.C))),
        degraded=np.zeros(STEPS, dtype=bool),
        loss_1_s=np.zeros(STEPS),
        loss_degC=np.zeros(STEPS),
    )  # fmt: skip
    return simulate(plant, np.zeros(len(plant.decay_1_s)), inputs)[1], z


@pytest.mark.parametrize("right", ["prescribed", "insulated"])
@pytest.mark.parametrize("film_W_m2K", [0.0, 20.0])
def test_python_control_marches_the_same_system(film_W_m2K: float, right: str) -> None:
    config = _config(film_W_m2K, right)
    rows, z = _ours(config)
    system = state_space(build_plant(config))
    t = np.arange(STEPS + 1) * DT_S
    u = np.vstack([np.full((1, STEPS + 1), 20.0), z.T])
    response = control.forced_response(system, t, u)
    # both steps are exact for inputs linear in time, so only rounding is left
    np.testing.assert_allclose(response.outputs[:, 1:].T, rows, atol=1e-8)


@pytest.mark.parametrize("right", ["prescribed", "insulated"])
@pytest.mark.parametrize("film_W_m2K", [0.0, 20.0])
def test_kims_lifted_form_gives_the_same_temperatures(film_W_m2K: float, right: str) -> None:
    config = _config(film_W_m2K, right)
    config = config.model_copy(update={"model": config.model.model_copy(update={"static_correction": False})})
    rows, _ = _ours(config)
    sensors = np.array([s.position_m for s in config.sensor])
    form = kim_form(solve_modes(rod_of(config), 9), Stretch(0.1, 0.2), sensors)
    t = np.arange(STEPS + 1) * DT_S
    left, right_degC = _ends(t)
    step = expm(form.A * DT_S)
    hold = np.linalg.solve(form.A, step - np.eye(9))
    x = np.zeros(9)
    for k in range(STEPS):
        z = np.array(
            [
                left[k],
                (left[k + 1] - left[k]) / DT_S,
                right_degC[k],
                (right_degC[k + 1] - right_degC[k]) / DT_S,
            ]
        )
        x = step @ x + hold @ (form.B * 20.0 - form.D @ z)
        z[[0, 2]] = left[k + 1], right_degC[k + 1]
        np.testing.assert_allclose(form.C @ x + form.E @ z, rows[k, :2], atol=1e-8)


def test_python_control_marches_nodes_films_and_lagging_sensors_too() -> None:
    """A heat of 20 W from rest, in air at 0 °C: ten minutes of the coupled machine of `test_generator`."""
    plant = build_plant(machine())
    system, dt_s, steps = state_space(plant), 1.0, 600
    n_x, p, s = len(plant.decay_1_s), len(plant.known_names), plant.rows.sensors
    z, none = np.zeros((steps, p)), np.zeros((steps, 0))
    inputs = Inputs(
        time_s=dt_s * np.arange(1.0, steps + 1), dt_s=np.full(steps, dt_s), y_degC=np.zeros((steps, s)),
        usable=np.zeros((steps, s), dtype=bool), quality=np.zeros((steps, s), dtype=np.int8),
        law_W=np.full((steps, len(plant.source_names)), 20.0),
        law_jump_W=np.zeros((steps, len(plant.source_names))), z_start=z, z_end=z,
        moving_B=none.reshape(steps, 0, 1), moving_C=none.reshape(steps, 0, 1),
        degraded=np.zeros(steps, dtype=bool), loss_1_s=np.zeros(steps), loss_degC=np.zeros(steps),
    )  # fmt: skip
    rows = simulate(plant, np.zeros(n_x), inputs)[1]
    u = np.zeros((len(system.input_labels), steps + 1))
    u[: len(plant.source_names)] = 20.0
    response = control.forced_response(system, np.arange(steps + 1) * dt_s, u)
    # the product takes couplings by turns with the rest, of second order in the step
    np.testing.assert_allclose(response.outputs[:, 1:].T, rows, atol=1e-3 * np.abs(rows).max())
    assert system.nstates == n_x
