"""The plant as one matrix against the compiled couplings it stands for."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import expm

from observer.config import Config
from observer.estimators.design.riccati import steady_kalman
from observer.frames import FloatArray, Inputs
from observer.installation import parse
from observer.model.build import build_plant
from observer.model.discretise import augmented, step_matrices
from observer.model.generator import augmented_step, design_step, generator, settled_rows
from observer.model.plant import Plant
from observer.model.simulate import SimulationState, simulate
from tests.discovery.cases import table
from tests.reference.cases import known
from tests.reference.node_cases import by_speed, config, on_nodes


def machine() -> Config:
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
        ],
    )
    made["source"][0]["nodes"] = {"block": 0.3}
    return parse(made)


def stepped(plant: Plant, x: FloatArray, dt_s: float, steps: int) -> FloatArray:
    """The state after steps of the compiled loop without heat, in air at 0 °C."""

    m, s, M, R = len(plant.source_names), plant.rows.sensors, len(plant.moving), len(plant.rows.C)
    z = np.tile(known(plant, 1, ambient=0.0, reference=0.0), (steps, 1))
    inputs = Inputs(
        time_s=dt_s * np.arange(1.0, steps + 1), dt_s=np.full(steps, dt_s), y_degC=np.zeros((steps, s)),
        usable=np.zeros((steps, s), dtype=bool), quality=np.zeros((steps, s), dtype=np.int8),
        law_W=np.zeros((steps, m)), law_jump_W=np.zeros((steps, m)), z_start=z, z_end=z,
        moving_B=np.array([[q.table.mean_B for q in plant.moving]] * steps).reshape(steps, M, len(x)),
        moving_C=np.array([[q.table.mean_C for q in plant.moving]] * steps).reshape(steps, M, R),
        degraded=np.zeros(steps, dtype=bool), loss_1_s=np.zeros(steps), loss_degC=np.zeros(steps),
    )  # fmt: skip
    return simulate(plant, SimulationState(x.copy()), inputs)[0].x


@pytest.mark.parametrize("made", [machine(), config(True, on_nodes(0.05), by_speed(1.0))])
def test_the_compiled_step_is_the_matrix_to_second_order(made: Config) -> None:
    plant = build_plant(made)
    x = plant.uniform * 5.0 + 0.3 * np.sqrt(np.diag(plant.prior_P)) * np.sin(np.arange(len(plant.uniform)))
    x[plant.lag_slice] = 0.0
    wanted = plant.rows.C @ expm(generator(plant) * 40.0) @ x
    errors = [
        np.abs(plant.rows.C @ stepped(plant, x, 40.0 / n, n) - wanted)[
            : plant.rows.sensors + plant.rows.grid
        ].max()
        for n in (80, 160, 320)
    ]
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    np.testing.assert_allclose(orders, 2.0, atol=0.1)


def test_without_nodes_the_whole_exponential_is_the_plants_own_step() -> None:
    # noise on the field itself is added once a step by the one, and fades on the way in the other
    plant = build_plant(parse(table(estimator={"field_noise_K_sqrt_s": 0.0})))
    step = step_matrices(plant, 5.0)
    own_A, own_Q = augmented(plant, step)
    whole_A, whole_Q = augmented_step(plant, 5.0)
    np.testing.assert_allclose(whole_A, own_A, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(whole_Q, own_Q, rtol=1e-6, atol=1e-8 * own_Q.max())


def test_a_sensor_on_a_node_sees_what_the_node_comes_to_rest_at() -> None:
    """Held at 1 °C where the block touches it, the screw warms the block by 2/(2 + 1/3) of that: through it
    1 W/K and 0.5 W/K in a row lead to the air.
    """
    made = machine().model_copy(update={"effect": ()})
    on = made.sensor[0].model_copy(update={"position_m": None, "on": "block"})
    plant = build_plant(made.model_copy(update={"sensor": (on, *made.sensor[1:])}))
    under = plant.coupling.conductance_W_m * plant.coupling.place_gain[0] * plant.B[: plant.modes, 0]
    np.testing.assert_allclose(settled_rows(plant)[0, : plant.modes], 2.0 / (2.0 + 1.0 / 3.0) * under)


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
