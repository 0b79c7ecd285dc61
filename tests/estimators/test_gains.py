"""Poles reached on the measured rows, for all sensors and for every set that can be left."""

import itertools

import numpy as np
import pytest

from observer.config.estimator import EstimatorSettings
from observer.errors import UserError
from observer.estimators import build_estimator
from observer.estimators.design.gains import (
    LuenbergerGain,
    Refusal,
    closed_loop,
    design_bandwidth,
    design_kim,
    noise_gain,
    pole_error,
    poles_of,
)
from observer.estimators.design.steady import steady_covariance, steady_kalman
from observer.frames import EstimateQuality
from observer.model.discretise import augmented, step_matrices
from tests.logs.inputs import inputs, temperatures
from tests.logs.plants import rod

SUBSETS = [np.array(bits, dtype=bool) for bits in itertools.product([True, False], repeat=4)]


@pytest.mark.parametrize("film", [0.0, 15.0])
@pytest.mark.parametrize("dt_s", [0.1, 0.5, 5.0])
@pytest.mark.parametrize("bandwidth_1_s", [2e-4, 2e-3, 6e-3])
def test_poles_are_reached_on_every_set_of_sensors_or_it_is_refused(film, dt_s, bandwidth_1_s):
    plant = rod(film_W_m2K=film, sources_m=(0.1, 0.5))
    step = step_matrices(plant, dt_s)
    for present in SUBSETS:
        gain = design_bandwidth(plant, step, present, bandwidth_1_s)
        if present.sum() < 2:
            assert isinstance(gain, Refusal), "one sensor cannot distinguish two constant heats"
            continue
        assert isinstance(gain, LuenbergerGain)
        reached = poles_of(closed_loop(plant, step, gain.K), dt_s)
        assert pole_error(gain.poles_requested_1_s, reached[: len(gain.poles_requested_1_s)]) < 0.01
        assert reached.real.max() < -0.99 * min(
            bandwidth_1_s, np.min(plant.decay_1_s[plant.decay_1_s >= bandwidth_1_s])
        )
        assert (gain.K[:, ~present] == 0).all()


def test_noise_gain_is_what_white_noise_does():
    plant = rod(sources_m=(0.1, 0.5))
    step = step_matrices(plant, 0.5)
    gain = design_bandwidth(plant, step, np.ones(4, dtype=bool), 6e-3)
    rng = np.random.default_rng(1)
    M, a, seen = closed_loop(plant, step, gain.K), np.zeros(len(gain.K)), []
    for _ in range(60_000):
        a = M @ a + gain.K @ rng.normal(size=4)
        seen.append(a[-2:])
    # 60,000 steps hold about 60,000 · 0.5 s · 0.006 / 2 = 90 independent values: σ is known to about 10 %.
    np.testing.assert_allclose(np.std(seen[2000:], axis=0), gain.noise_gain_W_K, rtol=0.35)


def test_steady_gain_solves_the_riccati_equation():
    plant = rod()
    step = step_matrices(plant, 0.5)
    K = steady_kalman(plant, step, np.ones(4, dtype=bool))
    steady = steady_covariance(plant, step, K)
    Ad, Qd = augmented(plant, step)
    H = np.hstack([plant.rows.C[:4], np.zeros((4, 3))])
    P, R = steady.P_pred, np.diag(plant.noise_R_K2)
    S = H @ P @ H.T + R
    residual = Ad @ (P - P @ H.T @ np.linalg.solve(S, H @ P)) @ Ad.T + Qd - P
    scale = np.sqrt(np.outer(np.diag(P), np.diag(P)))
    # Relative to each entry's own size; the equation is solved in double precision with a condition of some
    # 1e6.
    assert np.abs(residual / scale).max() < 1e-8
    np.testing.assert_allclose(P @ H.T @ np.linalg.inv(S), K, rtol=1e-6, atol=1e-7 * np.abs(K).max())


@pytest.mark.parametrize("present", SUBSETS)
def test_steady_gain_of_every_set_is_stable_or_refused(present):
    plant = rod(sources_m=(0.1, 0.5))
    K = steady_kalman(plant, step_matrices(plant, 0.5), present)
    if present.sum() < 2:
        assert isinstance(K, Refusal)
    else:
        assert np.abs(np.linalg.eigvals(closed_loop(plant, step_matrices(plant, 0.5), K))).max() < 1
        assert np.isfinite(noise_gain(closed_loop(plant, step_matrices(plant, 0.5), K), K, 2)).all()


@pytest.mark.parametrize("film", [0.0, 15.0])
def test_kims_rule_places_two_modes_and_the_heat(film):
    plant = rod(sources_m=(0.1,), sensors_m=(0.2,), modes=2, film_W_m2K=film)
    step = step_matrices(plant, 0.5)
    gain = design_kim(plant, step, np.ones(1, dtype=bool))
    reached = poles_of(closed_loop(plant, step, gain.K), 0.5)[: len(gain.poles_requested_1_s)]
    # Kim's poles lie a hundredth apart, and clustered poles answer rounding by its root.
    assert pole_error(gain.poles_requested_1_s, reached) < 0.01


@pytest.mark.parametrize(
    ("plant", "settings", "words"),
    [
        ({"sensors_m": (0.2,), "sources_m": (0.1, 0.5)}, {"engine": "constant"}, "observer place"),
        ({"sensors_m": (0.2,), "sources_m": (0.1, 0.5)}, {"kind": "luenberger"}, "observer place"),
        ({}, {"kind": "luenberger", "bandwidth_1_s": 0.5}, "bandwidth_1_s"),
        ({}, {"kind": "luenberger", "pole_rule": "kim"}, "one sensor and one estimated heat"),
    ],
)
def test_a_design_without_gains_is_refused_with_a_remedy(plant, settings, words):
    with pytest.raises(UserError, match=words):
        build_estimator(rod(**plant), EstimatorSettings(**settings))


@pytest.mark.parametrize("uneven", [False, True])
def test_the_observer_finds_the_heats(uneven):
    """Twenty time constants after two heats are switched on, both are found to the noise the design
    forecasts.
    """
    plant = rod(sources_m=(0.1, 0.5))
    u = inputs(plant, steps=8000, missing=0.0, law_steps=False, uneven=uneven)
    u.y_degC[:] = temperatures(plant, u, lambda t: np.array([25.0, 10.0]))
    estimator = build_estimator(plant, EstimatorSettings(kind="luenberger", bandwidth_1_s=0.006))
    _, block = estimator.run(estimator.initial(), u)
    error = block.heat_W[-1] - [25.0, 10.0]
    assert (np.abs(error) < 4 * block.heat_sigma_W[-1]).all()
    assert (np.abs(error) < 4.0).all()


@pytest.mark.parametrize(("kind", "engine"), [("kalman", "constant"), ("luenberger", "compiled")])
def test_sensors_that_cannot_distinguish_the_heats_predict_only_and_say_so(kind, engine):
    plant = rod(sources_m=(0.1, 0.5))
    u = inputs(plant, steps=600, missing=0.0, law_steps=False)
    u.y_degC[:] = temperatures(plant, u, lambda t: np.array([25.0, 10.0]))
    u.usable[300:, 1:] = False
    u.quality[300:, 1:] = 1
    estimator = build_estimator(plant, EstimatorSettings(kind=kind, engine=engine, bandwidth_1_s=0.006))
    _, block = estimator.run(estimator.initial(), u)
    assert (block.quality[300:] == EstimateQuality.DEGRADED).all()
    assert np.isfinite(block.heat_W).all()
    assert (block.heat_sigma_W[-1] > block.heat_sigma_W[299]).all()


def test_the_constant_gain_settles_on_the_kalman_filter():
    plant = rod(law_uncertainty=0.0)
    u = inputs(plant, steps=6000, missing=0.0, law_steps=False)
    u.y_degC[:] = temperatures(plant, u, lambda t: np.array([25.0, 10.0, 5.0]))
    _, kalman = build_estimator(plant, EstimatorSettings()).run(
        build_estimator(plant, EstimatorSettings()).initial(), u
    )
    constant = build_estimator(plant, EstimatorSettings(engine="constant"))
    _, block = constant.run(constant.initial(), u)
    assert np.abs(np.diff(block.heat_sigma_W[-100:], axis=0)).max() < 1e-6, "it has settled"
    # After three time constants 5 % of the start's error is left, of the steady gain's none that shows.
    np.testing.assert_allclose(block.heat_sigma_W[-1], kalman.heat_sigma_W[-1], rtol=0.01)
    assert (np.abs(block.heat_W[-1] - kalman.heat_W[-1]) < 0.1 * kalman.heat_sigma_W[-1]).all()


def test_a_settled_gain_does_not_sleep_through_a_jump_of_a_law():
    """What the law is not trusted for comes with its jump, however long the covariance has been settled."""
    plant = rod(law_uncertainty=0.3)
    u = inputs(plant, steps=6000, missing=0.0, law_steps=False)
    u.y_degC[:] = temperatures(plant, u, lambda t: np.array([0.0, 0.0, 0.0]))
    u.law_W[5000:, 1], u.law_jump_W[5000, 1] = 100.0, 100.0
    blocks = []
    for settings in (EstimatorSettings(gate_sigma=1e9), EstimatorSettings(engine="constant", gate_sigma=1e9)):
        estimator = build_estimator(plant, settings)
        blocks.append(estimator.run(estimator.initial(), u)[1])
    kalman, constant = blocks
    np.testing.assert_allclose(constant.heat_sigma_W[4999], constant.heat_sigma_W[4990], rtol=1e-4)
    assert constant.heat_sigma_W[5000, 1] > 10.0 * constant.heat_sigma_W[4999, 1]
    np.testing.assert_allclose(constant.heat_sigma_W[5000:5050], kalman.heat_sigma_W[5000:5050], rtol=0.02)
