"""A further parameter that is only roughly known is one entry: a link's conductance, a body's capacity."""

from __future__ import annotations

import numpy as np
import pytest

from observer.config.estimator import EstimatorSettings
from observer.config.machine import Config
from observer.estimators.kalman import KalmanEstimator
from observer.frames import FloatArray
from observer.installation import parse
from observer.model.build import build_plant
from observer.model.drive import Drive
from observer.model.extend import with_parameters
from observer.model.learning import Change, Nuisance, Parameter, no_change
from observer.model.plant import Plant
from observer.model.rod.modes import held_s
from tests.logs.machines import table
from tests.logs.simulated import made_log
from tests.model.unturned import unturned

LINK_W_K, CAPACITY_J_K = 2.0, 300.0


def machine(link_W_K: float = LINK_W_K, capacity_J_K: float = CAPACITY_J_K) -> Config:
    """A block under a band, which takes a part of its heat and loses some to the air, with its own sensor."""
    made = table(
        node=[{"name": "block", "capacity_J_K": capacity_J_K}],
        link=[
            {"between": ["block", "heater"], "conductance_W_K": link_W_K},
            {"between": ["block", "ambient"], "conductance_W_K": 0.5},
        ],
    )
    made["source"][0]["nodes"] = {"block": 0.8}
    made["sensor"].append({"name": "block", "channel": "d_degC", "on": "block", "noise_K": 0.05})
    return parse(made)


def of_link() -> Change:
    """What 1 W/K of the link does: it moves heat to the screw, by how much warmer the block is."""
    plant, constant, *_ = unturned(machine())
    block, per_W_K = plant.lag_slice.stop, constant.A / LINK_W_K
    none = no_change(len(plant.decay_1_s), len(plant.known_names))
    return none._replace(into=per_W_K[:, block], feedback_row=per_W_K[block] / per_W_K[block, block])


def of_capacity() -> Change:
    """What the whole capacity of the block once more does: all that warms or cools it does so more slowly."""
    plant, constant, *_ = unturned(machine())
    n_x, number = len(plant.decay_1_s), plant.lag_slice.stop
    block = (np.arange(n_x) == number).astype(float)
    return no_change(n_x, len(plant.known_names))._replace(
        rate_1_s=block * plant.decay_1_s,
        into=-block * constant.A[number, number],
        feedback_row=of_link().feedback_row,
        heats=-block,
        inputs=-block * plant.E.T,
    )


def of_division() -> Change:
    """What the screw's part of the heater's heat does in the block instead: it warms it by its capacity."""
    plant, *_ = unturned(machine())
    block = (np.arange(len(plant.decay_1_s)) == plant.lag_slice.stop).astype(float)
    none = no_change(len(plant.decay_1_s), len(plant.known_names))
    return none._replace(into=block / CAPACITY_J_K, divided=0)


CHANGES = {"link": of_link, "capacity": of_capacity, "division": of_division}


def with_parameter(plant: Plant, change: Change, sigma: float, value: float, unit: float) -> Plant:
    """The plant with one parameter, which is learnt."""
    entry = Parameter(Nuisance.END, 0, sigma, change, "extra", value, unit)
    return with_parameters(plant, [entry], {Nuisance.END.key})


def rates(config: Config, x: FloatArray, q: FloatArray, z: FloatArray) -> FloatArray:
    """dx/dt of the plant of a configuration, x its modes, lags and nodes."""
    plant, constant, *_ = unturned(config)
    A = constant.A - np.diag(plant.decay_1_s)
    return np.asarray(A @ x + plant.B @ q + (plant.E + constant.E) @ z)


@pytest.mark.parametrize("what", ["link", "capacity"])
def test_its_column_is_the_finite_difference_of_the_plant(what: str) -> None:
    (plant, *_), rng, h = unturned(machine()), np.random.default_rng(5), 1e-4
    x = plant.uniform * 20.0 + 5.0 * np.sqrt(np.diag(plant.prior_P)) * rng.standard_normal(len(plant.uniform))
    q, z = np.array([15.0, 4.0]), np.full(len(plant.known_names), 21.0)
    if what == "link":
        change, more, less = of_link(), machine(LINK_W_K + h), machine(LINK_W_K - h)
    else:
        change = of_capacity()
        more, less = (machine(capacity_J_K=CAPACITY_J_K * (1.0 + sign * h)) for sign in (1, -1))
    arrays = with_parameter(plant, change, 0.3, 0.0, 1.0).parameters
    c = arrays.drives(x, plant.B, q, q, z)[:, 0]
    wanted = (rates(more, x, q, z) - rates(less, x, q, z)) / (2.0 * h)
    np.testing.assert_allclose(c, wanted, rtol=0, atol=1e-6 * np.abs(wanted).max())  # 1/C: h² of itself
    step = (rates(machine(), x + h, q, z) - rates(machine(), x - h, q, z)) / (2.0 * h)
    assert np.abs(wanted).max() > 1e-3 * np.abs(step).max()


@pytest.mark.parametrize("what", list(CHANGES))
def test_the_compiled_filter_takes_the_same_column(what: str) -> None:
    """A step of 0.01 s without a reading: it leaves hold c σ² between states and parameter."""
    config, plant, sigma = machine(), build_plant(machine()), 0.3
    plant = with_parameter(plant, CHANGES[what](), sigma, 0.0, 1.0)
    drive, dt_s, n_x = Drive(config, plant), 0.01, len(plant.decay_1_s)
    u = drive.run(drive.initial(), made_log(config, 3))[1].part(900, 902)  # the heater is on
    u = u._replace(dt_s=np.array([0.0, dt_s]), usable=u.usable & np.array([[True], [False]]))
    estimator = KalmanEstimator(plant, EstimatorSettings())
    first, _ = estimator.run(estimator.initial(), u.part(0, 1))
    after, _ = estimator.run(first, u.part(1))
    around, q = first.around, u.law_W[1].copy()
    q[plant.estimated] += around[n_x : n_x + int(plant.estimated.sum())]
    c = plant.parameters.drives(around[:n_x], plant.B, u.law_W[1], q, u.z_start[1])[:, 0]
    wanted = held_s(plant.decay_1_s, dt_s) * c * sigma**2
    before = first.P[:n_x, -1]
    moved = after.P[:n_x, -1] - np.exp(-plant.decay_1_s * dt_s) * before
    # what is roughly known is held over a step, which is of its order
    np.testing.assert_allclose(moved, wanted, rtol=0, atol=0.01 * np.abs(wanted).max())


@pytest.mark.parametrize("what", ["link", "capacity"])
def test_the_filter_learns_it(what: str) -> None:
    """A machine whose link, or block, has 30 % more than its configuration says; nothing else is in doubt."""
    config, plant = machine(), build_plant(machine())
    if what == "link":
        truth, change, sigma, value, unit = machine(1.3 * LINK_W_K), of_link(), 0.8, LINK_W_K, 1.0
    else:
        truth, change, sigma = machine(capacity_J_K=1.3 * CAPACITY_J_K), of_capacity(), 0.4
        value = unit = CAPACITY_J_K
    plant = with_parameter(plant, change, sigma, value, unit)
    drive = Drive(config, plant)
    _, u = drive.run(drive.initial(), made_log(truth, 3))
    estimator = KalmanEstimator(plant, EstimatorSettings())
    _, block = estimator.run(estimator.initial(), u)
    learned, learned_sigma = block.learned[-1, 0], block.learned_sigma[-1, 0]
    assert abs(learned - 1.3 * value) < min(3.0 * learned_sigma, abs(learned - value))
    assert learned_sigma < 0.3 * sigma * unit
