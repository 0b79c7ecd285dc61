"""Conjugate gradients by sweeps of the plant, and step by step as printed."""

import numpy as np
import pytest

from observer.config.estimator import EstimatorSettings
from observer.errors import UserError
from observer.history.conjugate_gradient import descend, draw, spread, stepwise
from observer.history.history import MethodOptions
from observer.history.identify import heat_history
from observer.history.sweeps import Sweeps, readings
from tests.bits.shared import COUPLINGS, coupled
from tests.history.known_heats import DT_S, heat_at, logged
from tests.logs.inputs import inputs, temperatures
from tests.logs.plants import AMBIENT_DEGC, moving_columns, rod


def descended(plant, u, order, said=print):
    log = readings(plant, [u], order)
    return log, descend(Sweeps(plant, u, order), log.weight_1_K, log.rise_K[:, :, None], said)


def test_a_descent_says_at_each_iteration_how_far_it_is():
    plant, u, _ = logged(steps=120)
    said = []
    _, found = descended(plant, u, 1, said.append)
    assert len(said) == found.iterations[0]
    far = [float(text.split(" ×")[0].rsplit(" ", 1)[1]) for text in said]
    assert far[0] > 10.0
    assert far[-1] < 1.5
    assert said[0].startswith("iteration 1, 1 of 1 logs left")


@pytest.mark.parametrize("order", [0, 1])
def test_conjugate_gradients_end_at_the_noise(order):
    plant, u, heat_W = logged(steps=300)
    log, found = descended(plant, u, order)
    assert found.reached[0]
    assert 0.9 * log.measurements < found.misfit[0] < 1.1 * log.measurements
    assert 0 < found.iterations[0] < 300
    error_W = (found.heat_W[:, :, 0] - heat_W)[20:-20]
    assert np.sqrt(np.mean(error_W**2)) < (6.0 if order == 0 else 1.5)


def test_heats_of_a_log_do_not_depend_on_the_logs_that_descend_beside_it():
    """A sum over another number of columns rounds otherwise, each iteration multiplies the difference, and a
    descent then ends an iteration earlier or later. That moves the heats by less than a hundredth; a mixed-up
    column moves them by half.
    """
    plant, u, _ = logged(steps=120)
    log, sweeps = readings(plant, [u], 1), Sweeps(plant, u, 1)
    logs = np.stack([log.rise_K, 0.01 * log.rise_K, 0.5 * log.rise_K], axis=2)
    together = descend(sweeps, log.weight_1_K, logs)
    assert len(set(together.iterations.tolist())) == 3, "they end at different times"
    for c in range(3):
        alone = descend(sweeps, log.weight_1_K, logs[:, :, c : c + 1])
        assert alone.reached[0]
        assert together.reached[c]
        largest_W = np.abs(alone.heat_W).max()
        np.testing.assert_allclose(
            alone.heat_W[:, :, 0], together.heat_W[:, :, c], rtol=0, atol=0.02 * largest_W
        )


def test_a_nut_that_moves_is_followed_over_uneven_steps():
    """The nut stands at one end, then at the other: spread over its stroke, neither would be right."""
    plant = rod(moving=(1,), walk_W_sqrt_s=0.05, law_uncertainty=0.0)
    u = inputs(plant, steps=300, dt_s=DT_S, missing=0.1, law_steps=False)
    u.dt_s[1:] *= np.resize([0.5, 1.0, 2.0], 299)
    u.time_s[:] = 1000.0 + np.cumsum(u.dt_s)
    nut_m = np.where(np.arange(300) < 150, 0.12, 0.5)
    B, C = moving_columns(plant, nut_m)
    u = u._replace(moving_B=B, moving_C=C)
    u.z_start[:], u.z_end[:] = AMBIENT_DEGC, AMBIENT_DEGC
    heat_W = np.tile([4.0, 20.0, 6.0], (300, 1))
    simulated = u._replace(law_W=heat_W)
    noisy = u.y_degC - readings(plant, [simulated], 1).rise_K  # what these heats lead to
    noisy += 0.05 * np.random.default_rng(2).standard_normal(u.y_degC.shape)
    history = heat_history(
        plant, EstimatorSettings(), [u._replace(y_degC=noisy)], MethodOptions("conjugate-gradient")
    )
    assert history.heat_W[30:, 1].mean() == pytest.approx(20.0, rel=0.03)
    assert not history.warnings


def test_step_by_step_as_printed_follows_near_sensors_and_loses_far_ones():
    near = rod(sensors_m=(0.0, 0.3, 0.6), law_uncertainty=0.0)
    far = rod(sensors_m=(0.1, 0.2, 0.45), law_uncertainty=0.0)
    errors = []
    for plant in (near, far):
        u = inputs(plant, steps=100, dt_s=DT_S, missing=0.0, law_steps=False)
        u.z_start[:], u.z_end[:] = AMBIENT_DEGC, AMBIENT_DEGC
        u.y_degC[:] = temperatures(plant, u, heat_at)
        log = readings(plant, [u], 0)
        truth = np.array([heat_at(t - u.time_s[0]) for t in u.time_s])
        errors.append(np.sqrt(np.mean((stepwise(plant, log)(log.rise_K)[0] - truth)[1:] ** 2)))
    assert errors[0] < 3.0
    assert errors[1] > 30.0


@pytest.mark.parametrize("order", [0, 1])
def test_the_spread_of_conjugate_gradients_holds_for_heats_of_the_prior(order):
    plant, u, _ = logged(steps=150, initial_sigma_W=20.0)
    log, sweeps = readings(plant, [u], order), Sweeps(plant, u, order)
    walk = Sweeps(plant, u, 1, start_known=order == 0)
    drawn, others = (draw(walk, log.weight_1_K, seed) for seed in (0, 8))
    sigma_W = spread(drawn, descend(sweeps, log.weight_1_K, drawn.rise_K).heat_W)
    found = descend(sweeps, log.weight_1_K, others.rise_K).heat_W
    # σ² from 24 logs of correlated errors is good to some 20 %, and so is the mean over these 24
    assert np.mean(((found - others.heat_W) / sigma_W[:, :, None]) ** 2) == pytest.approx(1.0, abs=0.45)


@pytest.mark.parametrize("effect", ["radiation", "natural_convection", "fading"])
def test_what_is_no_straight_line_is_refused_in_one_sentence(effect):
    plant, u = coupled(COUPLINGS[effect], 60)
    with pytest.raises(UserError, match=r"natural convection or fading friction; use --method smoother"):
        heat_history(plant, EstimatorSettings(), [u], MethodOptions("conjugate-gradient"))


def test_step_by_step_with_a_plant_that_changes_is_refused():
    plant, u = coupled(COUPLINGS["speed_loss"], 60)
    options = MethodOptions("conjugate-gradient", gradient="central-differences")
    with pytest.raises(UserError, match=r"does not change in time, .* use --gradient adjoint"):
        heat_history(plant, EstimatorSettings(), [u], options)
