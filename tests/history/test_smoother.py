"""The compiled smoother against the dense posterior, and properties it must have."""

from dataclasses import replace

import numpy as np
import pytest

from observer.config.estimator import EstimatorSettings
from observer.estimators import build_estimator
from observer.history import smoother
from observer.history.history import MethodOptions
from observer.history.identify import heat_history
from observer.history.smoother import smooth_heats
from observer.kernels.codes import NUT_LOST, REJECTED
from observer.model.build import build_plant
from observer.model.discretise import augmented, step_matrices
from tests.bits.shared import COUPLINGS
from tests.estimators.dense import posterior_heats
from tests.logs.inputs import driven, inputs
from tests.logs.plants import described, rod
from tests.reference.cases import config_of, point
from tests.truth.bar import Bar

OPEN_GATE = EstimatorSettings(gate_sigma=1e9)
LINEAR = [e for name in ("speed_loss", "films", "body_at_the_nut", "lags") for e in COUPLINGS[name]]


def nut_path(steps):
    return 0.3 + 0.2 * np.sin(1.7 * np.arange(steps))


def assert_is_the_dense_posterior(plant, u, digits):
    ours = smooth_heats(plant, OPEN_GATE, [u])
    heat, sigma, residual = posterior_heats(plant, u)
    np.testing.assert_allclose(ours.heat_W, heat, rtol=0, atol=digits * np.abs(heat).max())
    np.testing.assert_allclose(ours.heat_sigma_W, sigma, rtol=digits)
    np.testing.assert_allclose(ours.residual_K, residual, rtol=0, atol=digits * np.nanmax(np.abs(residual)))


@pytest.mark.parametrize("moving", [(), (1,)])
@pytest.mark.parametrize("estimated", [None, (True, False, True)])
@pytest.mark.parametrize("heat_rate", [0.0, 5e-3])
def test_the_smoother_equals_the_dense_posterior(moving, estimated, heat_rate):
    """Uneven steps, missing samples, jumping laws, a moving nut."""
    plant = rod(moving=moving, estimated=estimated, heat_rate_1_s=heat_rate)
    u = inputs(plant, steps=90, nut_m=nut_path(90), uneven=True, missing=0.3)
    # both lose digits of a covariance whose entries span ten decades; half of double precision is left
    assert_is_the_dense_posterior(plant, u, 1e-8)


@pytest.mark.parametrize(("noise_K", "digits"), [(0.1, 1e-8), (1e-4, 2e-3)], ids=["usual", "almost exact"])
@pytest.mark.parametrize("effects", [[], LINEAR], ids=["by itself", "coupled"])
def test_a_short_history_of_coupled_states_equals_the_dense_posterior(effects, noise_K, digits):
    """Two sensors are heard late. Sensors so exact that they
    correct one after the other cost the dense matrices most of their digits.
    """
    _, plant = described(4, 3, 3, moving=True, effect=effects)
    plant = replace(plant, noise_R_K2=np.full(3, noise_K**2))
    u = driven(plant, 16, dt_s=2.0, uneven=True, missing=0.2, loss=True)
    u.usable[:5, 1] = u.usable[:9, 2] = False
    assert_is_the_dense_posterior(plant, u, digits)


def a_sensor_that_jumps(u):
    """Refused from step 100 on, and again after each time that it is tried."""
    u.y_degC[100:, 1] += 40.0


def a_sensor_that_comes_back(u):
    """Refused for a minute, so that P has been opened for it, and then right again."""
    u.y_degC[100:220, 1] += 40.0


def sensors_that_all_jump(u):
    """The model is the surprised one, not they."""
    u.y_degC[100:] += 40.0


def an_outage(u):
    """Nothing is measured or known for a minute, in the middle and at the end again."""
    for away in (slice(100, 220), slice(380, 390)):
        u.usable[away] = False
        u.z_end[away] = np.nan


def a_lost_nut(u):
    """Nobody knows where it is, up to the end of the log."""
    u.degraded[-60:] = NUT_LOST


@pytest.mark.parametrize("steps", [150, 230, 290, 400])
@pytest.mark.parametrize(
    "trouble",
    [a_sensor_that_jumps, a_sensor_that_comes_back, sensors_that_all_jump, an_outage, a_lost_nut],
)
def test_at_its_end_a_history_is_what_the_filter_knows(trouble, steps):
    """Nothing comes after the last step: refused, held back or let in, the same sensors have corrected."""
    plant = rod(moving=(1,))
    u = inputs(plant, steps=400, nut_m=nut_path(400), missing=0.0)
    trouble(u)
    u, settings = u.part(0, steps), EstimatorSettings(gate_sigma=4.0)
    estimator = build_estimator(plant, settings)
    _, block = estimator.run(estimator.initial(), u)
    history = smooth_heats(plant, settings, [u])
    np.testing.assert_allclose(history.heat_W[-1], block.heat_W[-1], rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(history.heat_sigma_W[-1], block.heat_sigma_W[-1], rtol=1e-9)
    refused = block.sensor_quality == REJECTED
    np.testing.assert_array_equal(np.isnan(history.residual_K), refused | ~np.isfinite(block.innovation_K))


def coupled_machine(**effect):
    """A configuration whose effects couple the states, and inputs that speed up and slow down."""
    config = config_of(
        Bar(0.6),
        [point("left", 0.0, random_walk_W_sqrt_s=0.3), point("right", 0.6, random_walk_W_sqrt_s=0.3)],
        [0.0, 0.6],
        sensor_m=(0.05, 0.2, 0.55),
        model={"modes": 6},
        effect=[effect],
    )
    plant = build_plant(config)
    u = inputs(plant, steps=80, missing=0.2, dt_s=4.0)
    ambient = [np.repeat(z, len(plant.known_names), axis=1) for z in (u.z_start, u.z_end)]
    return plant, u._replace(
        z_start=ambient[0],
        z_end=ambient[1],
        loss_1_s=np.where(np.arange(80) // 20 % 2 == 1, 2e-3, 0.0),
        loss_degC=np.full(80, 20.0),
    )


@pytest.mark.parametrize(
    "effect",
    [
        {"kind": "radiation", "emissivity": 0.8},
        {"kind": "natural_convection", "coefficient_W_m2K": 9.0},
        {"kind": "friction_fade", "target": "left", "per_K": 0.02},
    ],
    ids=lambda effect: effect["kind"],
)
def test_the_last_step_is_the_filters_where_the_plant_depends_on_temperature(effect):
    plant, u = coupled_machine(**effect)
    estimator = build_estimator(plant, EstimatorSettings())
    _, filtered = estimator.run(estimator.initial(), u)
    ours = smooth_heats(plant, EstimatorSettings(), [u])
    np.testing.assert_array_equal(ours.heat_W[-1], filtered.heat_W[-1])
    np.testing.assert_array_equal(ours.heat_sigma_W[-1], filtered.heat_sigma_W[-1])


def test_a_log_in_blocks_and_segments_is_the_log_to_the_last_bit(monkeypatch):
    plant = rod(moving=(1,))
    u = inputs(plant, steps=300, nut_m=nut_path(300))
    whole = smooth_heats(plant, OPEN_GATE, [u])
    monkeypatch.setattr(smoother, "_STEPS_IN_SEGMENT", 7)
    parts = smooth_heats(plant, OPEN_GATE, [u.part(0, 1), u.part(1, 120), u.part(120)])
    for name in ("heat_W", "heat_sigma_W", "residual_K"):
        assert getattr(parts, name).tobytes() == getattr(whole, name).tobytes(), name


def test_what_the_gate_refused_does_not_count():
    plant = rod()
    u = inputs(plant, steps=80, missing=0.0, law_steps=False)
    spoiled = inputs(plant, steps=80, missing=0.0, law_steps=False)
    spoiled.y_degC[40, 1] += 60.0
    used = u.usable.copy()
    used[40, 1] = False
    ours = smooth_heats(plant, EstimatorSettings(gate_sigma=30.0), [spoiled])
    heat, _, _ = posterior_heats(plant, u, used)
    assert np.isnan(ours.residual_K[40, 1])
    np.testing.assert_allclose(ours.heat_W, heat, rtol=0, atol=1e-8 * np.abs(heat).max())


def test_steps_that_cannot_be_computed_are_unknown_and_harm_nothing():
    plant = rod()
    u = inputs(plant, steps=60, missing=0.0)
    u.usable[:5] = False
    u.z_end[30] = np.nan
    ours = smooth_heats(plant, OPEN_GATE, [u])
    unknown = np.isnan(ours.heat_W).any(axis=1)
    assert np.flatnonzero(unknown).tolist() == [0, 1, 2, 3, 4, 30]
    assert np.isfinite(ours.heat_sigma_W[~unknown]).all()


def test_sigmas_hold_for_heats_drawn_from_the_prior():
    """Normalised errors of heats that truly walk: mean square 1, in the middle of 40 logs of 400 steps."""
    plant = rod(walk_W_sqrt_s=2.0, initial_sigma_K=1e-6, law_uncertainty=0.0, initial_sigma_W=5.0)
    rng = np.random.default_rng(5)
    scores = []
    for seed in range(40):
        u = inputs(plant, steps=400, seed=seed, law_steps=False)
        truth = _walk(plant, u, rng)
        ours = smooth_heats(plant, OPEN_GATE, [u])
        scores.append((((ours.heat_W - truth) / ours.heat_sigma_W) ** 2)[40::90].mean())
    # 40 logs x 4 times x 3 heats, nearly independent: a standard error of sqrt(2/480) = 0.065
    assert np.mean(scores) == pytest.approx(1.0, abs=0.25)


def _walk(plant, u, rng):
    """Draw heats and measurements from the prior, in place of the measurements of `u`; return the heats."""
    n_x, K, s = len(plant.decay_1_s), len(u), plant.rows.sensors
    u.z_start[:], u.z_end[:] = 20.0, 20.0
    x = np.concatenate([plant.uniform * 20.0, plant.initial_sigma_W * rng.standard_normal(3)])
    truth = np.empty((K, 3))
    F, Q = augmented(plant, step_matrices(plant, 0.5))
    root = np.linalg.cholesky(Q + 1e-14 * np.diag(np.diag(Q)) + 1e-18 * np.eye(len(Q)))
    known = step_matrices(plant, 0.5).hold * (plant.E @ u.z_start[0])
    for k in range(K):
        if k:
            x = F @ x + root @ rng.standard_normal(len(x))
            x[:n_x] += known
        truth[k] = x[n_x:]
        u.y_degC[k] = plant.rows.C[:s] @ x[:n_x] + np.sqrt(plant.noise_R_K2) * rng.standard_normal(s)
    return truth


@pytest.mark.parametrize("method", ["smoother", "tikhonov"])
def test_a_source_that_would_cool_is_reported(method):
    """Sensors ten kelvin below the air, at rest."""
    config = config_of(
        Bar(0.6), [point("left", 0.0), point("right", 0.6)], [0.0, 0.6], sensor_m=(0.05, 0.2, 0.55)
    )
    plant = build_plant(config)
    u = inputs(plant, steps=200, dt_s=20.0)
    z = np.repeat(u.z_end, len(plant.known_names), axis=1)
    u = u._replace(law_W=np.abs(u.law_W), z_start=z, z_end=z)

    def warnings(y_degC, law_W):
        history = heat_history(
            plant, config.estimator, [u._replace(y_degC=y_degC, law_W=law_W)], MethodOptions(method)
        )
        return [sentence for sentence in history.warnings if "would cool" in sentence]

    air_degC = u.z_end[:, [plant.known.ambient]]
    too_cold = np.broadcast_to(air_degC - 10.0, u.y_degC.shape)
    assert any(sentence.startswith("left would cool") for sentence in warnings(too_cold, u.law_W))
    assert not warnings(too_cold, -1.0 - u.law_W), "what is said to cool may"
    assert not warnings(air_degC + np.array([12.0, 8.0, 12.0]), u.law_W)
