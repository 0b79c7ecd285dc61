"""The plant as one matrix against the compiled steps it stands for."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.linalg import expm

from observer.config.machine import Config
from observer.estimators.design.steady import steady_kalman
from observer.frames import FloatArray, Inputs
from observer.installation import parse
from observer.kernels.coupling import see_under
from observer.model.build import build_plant
from observer.model.discretise import augmented, step_matrices
from observer.model.generator import augmented_step, design_step, generator, on_the_screw
from observer.model.plant import Plant
from observer.model.simulate import simulate
from tests.logs.machines import table
from tests.reference.cases import known
from tests.reference.node_cases import by_speed, config, on_nodes


def machine(*more: dict[str, Any]) -> Config:
    """A block under a band, a housing behind it, a film along a stretch and a sensor that lags."""
    made = table(
        node=[{"name": "block", "capacity_J_K": 300.0}, {"name": "housing", "capacity_J_K": 900.0}],
        link=[
            {"between": ["block", "heater"], "conductance_W_K": 2.0},
            {"between": ["block", "housing"], "conductance_W_K": 1.0},
            {"between": ["housing", "ambient"], "conductance_W_K": 0.5},
        ],
        effect=[
            {"kind": "uneven_convection", "from_m": 0.2, "to_m": 0.3, "extra_W_m2K": 40.0},
            {"kind": "sensor_lag", "target": "b", "time_constant_s": 20.0},
            *more,
        ],
    )
    made["source"][0]["nodes"] = {"block": 0.3}
    return parse(made)


def stepped(plant: Plant, x: FloatArray, dt_s: float, steps: int, loss_1_s: float = 0.0) -> FloatArray:
    """The state after steps of the compiled loop without heat, in air at 0 °C."""

    m, s, M, R = len(plant.source_names), plant.rows.sensors, len(plant.moving), len(plant.rows.C)
    z = np.tile(known(plant, 1, ambient=0.0, reference=0.0), (steps, 1))
    inputs = Inputs(
        time_s=dt_s * np.arange(1.0, steps + 1), dt_s=np.full(steps, dt_s), y_degC=np.zeros((steps, s)),
        usable=np.zeros((steps, s), dtype=bool), quality=np.zeros((steps, s), dtype=np.int8),
        law_W=np.zeros((steps, m)), law_jump_W=np.zeros((steps, m)), z_start=z, z_end=z,
        moving_B=np.array([[plant.B[:, q.index] for q in plant.moving]] * steps).reshape(steps, M, len(x)),
        moving_C=np.array([[q.table.mean_C for q in plant.moving]] * steps).reshape(steps, M, R),
        degraded=np.zeros(steps, dtype=bool), loss_1_s=np.full(steps, loss_1_s), loss_degC=np.zeros(steps),
    )  # fmt: skip
    return simulate(plant, x.copy(), inputs)[0]


def uneven(plant: Plant) -> FloatArray:
    """A state that is not at rest anywhere."""
    return plant.uniform * 5.0 + 0.3 * np.sqrt(np.diag(plant.prior_P)) * np.sin(np.arange(len(plant.uniform)))


def test_what_couples_states_for_good_is_in_a_step_of_any_length() -> None:
    plant = build_plant(machine())
    x = uneven(plant)
    wanted = plant.rows.C @ expm(generator(plant) * 600.0) @ x
    for n in (1, 60):
        after = plant.rows.C @ stepped(plant, x, 600.0 / n, n)
        np.testing.assert_allclose(after, wanted, rtol=0, atol=1e-9 * np.abs(plant.rows.C @ x).max())


TURNS = {"kind": "speed_convection", "gain": 1.0}


@pytest.mark.parametrize(
    ("made", "loss_1_s"),
    [(config(True, on_nodes(0.05), by_speed(1.0)), 0.0), (machine(TURNS), 3e-3)],
    ids=["a nut that moves", "a film of speed"],
)
def test_the_compiled_step_is_the_matrix_to_second_order(made: Config, loss_1_s: float) -> None:
    plant = build_plant(made)
    x = uneven(plant)
    wanted = plant.rows.C @ expm((generator(plant) - loss_1_s * on_the_screw(plant)) * 40.0) @ x
    errors = [
        np.abs(plant.rows.C @ stepped(plant, x, 40.0 / n, n, loss_1_s) - wanted)[
            : plant.rows.sensors + plant.rows.grid
        ].max()
        for n in (80, 160, 320)
    ]
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    np.testing.assert_allclose(orders, 2.0, atol=0.1)


def test_the_compiled_step_approaches_the_matrix_where_a_nut_covers_the_film() -> None:
    """Its shapes lose less than the screw does around it."""
    nut = {"name": "nut", "shape": "nut", "length_m": 0.08, "stroke_m": [0.1, 0.3], "heat_W": 3.0}
    covering = nut | {"position_channel": "nut_m", "covers_film": True}
    plant = build_plant(parse(table(surface={"convection_W_m2K": 30.0}, source=[covering])))
    x = uneven(plant)
    wanted = (plant.rows.C @ expm(generator(plant) * 40.0) @ x)[: plant.rows.sensors + plant.rows.grid]
    errors = [
        np.abs((plant.rows.C @ stepped(plant, x, 40.0 / n, n))[: len(wanted)] - wanted).max()
        for n in (20, 320)
    ]
    assert errors[1] < errors[0] / 16.0  # at least of first order: the air in the gap is faster than a step
    assert errors[1] < 1e-4 * np.abs(wanted).max()


def test_without_nodes_the_whole_exponential_is_the_plants_own_step() -> None:
    # noise on the field itself is added once a step by the one, and fades on the way in the other
    plant = build_plant(parse(table(estimator={"field_noise_K_sqrt_s": 0.0})))
    step = step_matrices(plant, 5.0)
    own_A, own_Q = augmented(plant, step)
    whole_A, whole_Q = augmented_step(plant, 5.0)
    np.testing.assert_allclose(whole_A, own_A, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(whole_Q, own_Q, rtol=1e-6, atol=1e-8 * own_Q.max())


def test_a_sensor_on_a_node_sees_what_the_node_comes_to_rest_at() -> None:
    """Of 1 W at the heater 0.3 W enter the block, which 2 W/K tie to the screw there; 1 W/K and 0.5 W/K in a
    row lead on to the air.
    """
    made = machine().model_copy(update={"effect": ()})
    on = made.sensor[0].model_copy(update={"position_m": None, "on": "block"})
    plant = build_plant(made.model_copy(update={"sensor": (on, *made.sensor[1:])}))
    link = np.zeros((3, len(plant.uniform)))
    see_under(plant.coupling, 0, np.ascontiguousarray(plant.B.T), link)
    under_degC, block_degC = np.array([link[0], plant.rows.C[0]]) @ (plant.B[:, 0] / plant.decay_1_s)
    np.testing.assert_allclose(block_degC, (2.0 * under_degC + 0.3) / (2.0 + 1.0 / 3.0), rtol=1e-6)


def test_a_design_knows_nodes() -> None:
    """Sensors on nodes alone make a gain that keeps the whole loop stable."""
    names = ("left_housing", "right_housing", "nut_body")
    plant = build_plant(config(True, on_nodes(0.05, names), by_speed(1.0)))
    step = step_matrices(plant, 1.0)
    gain = steady_kalman(plant, step, np.ones(3, dtype=bool))
    assert isinstance(gain, np.ndarray)
    Ad, _ = design_step(plant, step)
    C = np.hstack([plant.rows.C[:3], np.zeros((3, 3))])
    assert np.abs(np.linalg.eigvals((np.eye(len(Ad)) - gain @ C) @ Ad)).max() < 1.0
