"""Every arrangement of predict and correct against the specification: plain, coupled, learning."""

from __future__ import annotations

import numpy as np
import pytest

from observer.config.estimator import EstimatorSettings
from observer.estimators import build_estimator
from observer.estimators.kalman import KalmanEstimator
from observer.estimators.specification import (
    Belief,
    Columns,
    columns_in_place,
    correct,
    laws,
    predict,
    transition,
)
from observer.model.learning import Nuisance
from tests.bits.shared import COUPLINGS, EVERY, coupled, learning

WIDE = EstimatorSettings(gate_sigma=1e9)
STEPS = 12


def filtered(plant, u, first, gain=None):
    """The specification's steps from the first state on: the last belief, and the heats (K, m_e)."""
    s, belief, heats = plant.rows.sensors, Belief(first.x_hat, first.P), []
    for k in range(1, len(u)):
        B, C = columns_in_place(plant, u, k)
        step = transition(plant, u, k, belief.x, Columns(B, np.zeros((len(B), 0))))
        belief = predict(belief, step.F, step.forced, step.Q)
        H = np.zeros((s, len(belief.x)))
        H[:, : C.shape[1]] = C[:s]
        good = u.usable[k]
        y = u.y_degC[k] - plant.rows.F[:s] @ u.z_end[k]
        K = None if gain is None else gain[:, good]
        belief = correct(belief, H[good], y[good], np.diag(plant.noise_R_K2[good]), K=K).belief
        n_x = len(plant.decay_1_s)
        heats.append(step.law_W[plant.estimated] + belief.x[n_x : n_x + int(plant.estimated.sum())])
    return belief, np.array(heats)


def assert_same(plant, u, estimator, gain=None, part=1e-9):
    """Last belief and heats are those of the specified steps, but for such a part of the prior."""
    first, _ = estimator.run(estimator.initial(), u.part(0, 1))
    last, block = estimator.run(first, u.part(1))
    belief, heats = filtered(plant, u, first, gain)
    # what modes, bodies and heats are of differs by orders: each against its own prior
    scale = np.sqrt(np.diag(first.P)) + 1e-9
    np.testing.assert_allclose(last.x_hat / scale, belief.x / scale, rtol=0, atol=part)
    np.testing.assert_allclose(
        last.P / np.outer(scale, scale), belief.P / np.outer(scale, scale), rtol=0, atol=part
    )
    np.testing.assert_allclose(
        block.heat_W / plant.initial_sigma_W, heats / plant.initial_sigma_W, rtol=0, atol=part
    )


@pytest.mark.parametrize("effects", ["plain", *COUPLINGS])
def test_the_filter_takes_the_specified_steps(effects):
    plant, u = coupled(COUPLINGS.get(effects, []), STEPS)
    assert plant.coupling.active or u.loss_1_s.any()
    assert_same(plant, u, KalmanEstimator(plant, WIDE))


@pytest.mark.parametrize("engine", ["compiled", "filterpy"])
def test_what_is_considered_keeps_value_and_variance(engine):
    _, plant, u = learning(EVERY[:3], steps=STEPS)
    estimator = build_estimator(plant, EstimatorSettings(engine=engine, gate_sigma=1e9, period_s=2.0))
    state, _ = estimator.run(estimator.initial(), u)
    own = len(state.x_hat) - plant.learnt
    held = own + plant.learning.arrays.considered
    assert len(held) > 0
    np.testing.assert_array_equal(state.x_hat[held], 0.0)
    np.testing.assert_allclose(
        np.diag(state.P)[held], plant.learning.arrays.sigma[held - own] ** 2, rtol=1e-9
    )


@pytest.mark.parametrize("resting", [False, True])
def test_filterpy_learns_the_same(resting):
    """The whole chain with the specification's matrices and filterpy's algebra, everything learnt."""
    law = {"speed_channel": "screw_speed_rpm", "heat_W_rpm": 0.006}
    stroke = {"shape": "nut", "length_m": 0.08, "stroke_m": [0.2, 0.8], "position_channel": "nut_position_m"}
    body = {
        "source": [
            {"name": "nut", "nodes": {"body": 0.5}} | stroke | law,
            {"name": "left", "shape": "point", "position_m": 0.0} | law,
            {"name": "right", "shape": "point", "position_m": 1.0} | law,
        ],
        "node": [{"name": "body", "capacity_J_K": 500.0}],
        "link": [{"between": ["body", "ambient"], "conductance_W_K": 1.0}],
        "sensor": [
            {"name": f"t{i}", "channel": f"t{i}_degC", "position_m": x, "noise_K": 0.1} | part
            for i, x, part in ((1, 0.05, {}), (2, 0.5, {"shows": 0.6, "shows_tolerance": 0.2}), (3, 0.95, {}))
        ],
    }
    _, plant, u = learning([*EVERY, "gain", "division"], resting=resting, steps=40, **body)
    assert set(Nuisance) == set(plant.learning.arrays.kind.tolist())
    runs = []
    for engine in ("compiled", "filterpy"):
        estimator = build_estimator(plant, EstimatorSettings(engine=engine, gate_sigma=6.0, period_s=2.0))
        runs.append(estimator.run(estimator.initial(), u))
    (state, ours), (other, theirs) = runs
    for name in ("heat_W", "heat_sigma_W", "field_degC", "field_sigma_K", "learned", "learned_sigma"):
        np.testing.assert_allclose(
            getattr(ours, name), getattr(theirs, name), rtol=1e-7, atol=1e-7, err_msg=name
        )
    np.testing.assert_array_equal(ours.sensor_quality, theirs.sensor_quality)
    scale = np.sqrt(np.diag(state.P)) + 1e-12
    np.testing.assert_allclose(
        state.P / np.outer(scale, scale), other.P / np.outer(scale, scale), rtol=0, atol=1e-7
    )


def test_laws_that_fade_are_those_of_the_temperature():
    plant, u = coupled(COUPLINGS["fading"], 2)
    u.law_W[1] = 10.0
    B, _ = columns_in_place(plant, u, 1)
    warm, cold = (laws(plant, u, 1, B, plant.uniform * T) for T in (40.0, 20.0))
    per_K = plant.coupling.fades.per_K
    assert per_K.any()
    np.testing.assert_allclose(warm, cold * np.exp(-per_K * 20.0), rtol=1e-2)  # but for the dropped modes
    np.testing.assert_array_equal(warm[per_K == 0.0], 10.0)
