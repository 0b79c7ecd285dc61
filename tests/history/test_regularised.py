"""Tikhonov in the time domain: beside the smoother and dense forms; the choices of its parameter."""

from dataclasses import replace

import numpy as np
import pytest

from observer.config.estimator import EstimatorSettings
from observer.history.history import MethodOptions
from observer.history.identify import heat_history
from observer.history.prior import walking
from observer.history.sweeps import Sweeps, readings
from observer.history.tikhonov import (
    BENDS,
    ICO_TRIALS,
    Regularised,
    Trial,
    by_discrepancy,
    by_gcv,
    by_ico,
    by_l_curve,
    trials,
)
from tests.bits.shared import COUPLINGS
from tests.estimators.dense import posterior_heats
from tests.history.known_heats import logged
from tests.history.test_sweeps import MACHINES, moving

OPEN_GATE = EstimatorSettings(gate_sigma=1e9)


@pytest.mark.parametrize("effects", [[], COUPLINGS["everything"]], ids=["by itself", "coupled"])
def test_with_the_configured_weight_it_is_the_smoother(effects):
    plant, u = moving(effects, 60)
    plant = replace(plant, field_noise_Q=np.zeros_like(plant.field_noise_Q))
    plain = heat_history(plant, OPEN_GATE, [u], MethodOptions())
    ours = heat_history(plant, OPEN_GATE, [u], MethodOptions("tikhonov", regularisation=1.0))
    np.testing.assert_array_equal(ours.heat_W, plain.heat_W)
    np.testing.assert_array_equal(ours.heat_sigma_W, plain.heat_sigma_W)
    np.testing.assert_array_equal(ours.residual_K, plain.residual_K)


@pytest.mark.parametrize("alpha", [0.05, 40.0])
def test_with_any_weight_it_is_the_dense_posterior_of_that_prior(alpha):
    plant, u, _ = logged(steps=60)
    ours = Regularised(plant, OPEN_GATE, [u.part(0, 30), u.part(30)], 1).solve(alpha)
    heat_W, sigma_W, residual_K = posterior_heats(walking(plant, [u], alpha).plant, u)
    np.testing.assert_allclose(ours.heat, heat_W, rtol=0, atol=1e-7 * np.abs(heat_W).max())
    np.testing.assert_allclose(ours.sigma, sigma_W, rtol=1e-7)
    np.testing.assert_allclose(ours.residual, residual_K, rtol=0, atol=1e-7)


def dense_of(plant, u, alpha):
    """Li's equation as printed, (HᵀH + α I) Q = Hᵀ Z in units of noise and prior: heats, σ, the influence of
    each reading on its own, with H by columns.
    """
    log, sweeps = readings(plant, [u], 0), Sweeps(plant, u, 0)
    H = sweeps.forward(np.eye(sweeps.unknowns))[1] * log.weight_1_K[:, :, None]
    H, z = H.reshape(log.rise_K.size, -1), (log.weight_1_K * log.rise_K).ravel()
    inverse = np.linalg.inv(H.T @ H + alpha * np.eye(H.shape[1]))
    shape, prior_W = (len(u), sweeps.heats), plant.initial_sigma_W
    heat_W = (inverse @ H.T @ z).reshape(shape) * prior_W
    sigma_W = np.sqrt(np.diag(inverse)).reshape(shape) * prior_W
    return heat_W, sigma_W, np.einsum("ij,jk,ik->i", H, inverse, H).reshape(u.y_degC.shape)


@MACHINES
@pytest.mark.parametrize("alpha", [0.1, 1e3])
def test_order_0_is_lis_equation_solved_at_once(effects, alpha):
    """A moving nut, uneven steps, missing samples: heats, σ, and how free each reading is of itself."""
    plant, u = moving(effects)
    equation = Regularised(plant, OPEN_GATE, [u], 0)
    ours = equation.solve(alpha)
    heat_W, sigma_W, influence = dense_of(plant, u, alpha)
    np.testing.assert_allclose(ours.heat[1:], heat_W[1:], rtol=0, atol=1e-6 * np.abs(heat_W).max())
    np.testing.assert_allclose(ours.sigma[1:], sigma_W[1:], rtol=1e-6)
    used = np.isfinite(ours.free)
    np.testing.assert_array_equal(used, u.usable)
    np.testing.assert_allclose(ours.free[used], 1.0 - influence[used], rtol=0, atol=1e-7)
    trial = equation.trial(alpha)
    assert trial.free == pytest.approx(used.sum() - influence[used].sum(), rel=1e-6)
    assert trial.size == pytest.approx(np.sum((heat_W[1:] / plant.initial_sigma_W) ** 2), rel=1e-5)


def test_the_choices_of_the_parameter_are_where_they_should_be():
    plant, u, heat_W = logged(steps=80)
    equation = Regularised(plant, OPEN_GATE, [u], 1)
    alphas = trials(equation.top)
    morozov = equation.trial(by_discrepancy(equation.trial, alphas))
    assert morozov.misfit == pytest.approx(morozov.measurements, rel=1e-3)
    gcv, corner = by_gcv(equation.trial, alphas), by_l_curve(equation.trial, trials(equation.top, BENDS))

    def score(alpha):
        trial = equation.trial(alpha)
        return trial.misfit / trial.free**2

    assert score(gcv) <= min(score(alpha) for alpha in (*alphas, 0.8 * gcv, 1.25 * gcv)) * (1.0 + 1e-6)
    errors = {
        alpha: np.mean((equation.solve(alpha).heat - heat_W)[1:] ** 2) for alpha in (gcv, corner, *alphas)
    }
    # theory promises GCV the best prediction of the data, not of the heats; twice the least error is usual
    assert errors[gcv] < 4.0 * min(errors.values())
    # the curve's sharpest bend need not be where its legs meet; but it is far from either end
    assert errors[corner] < 0.5 * min(errors[alphas[0]], errors[alphas[-1]])


def test_ico_as_printed_goes_to_the_smallest_parameter_allowed():
    plant, u, heat_W = logged(steps=80)
    equation = Regularised(plant, OPEN_GATE, [u], 0)
    ends = {
        low: by_ico(equation.trial, equation.top, 3, bounds=(low, 1e3), tolerance=0.0) for low in (1.0, 30.0)
    }
    for low, (alpha, kept) in ends.items():
        assert alpha == pytest.approx(low, rel=1e-3), "forty halvings all went down"
        assert len(kept) == 40
    wrong = equation.solve(by_ico(equation.trial, equation.top, 3)[0]).heat
    better = equation.solve(by_discrepancy(equation.trial, trials(equation.top))).heat
    assert np.nanstd(wrong - heat_W) > 2.0 * np.nanstd(better - heat_W)
    assert by_ico(equation.trial, equation.top, 3)[0] != by_ico(equation.trial, equation.top, 4)[0]


def test_ico_without_solving_for_all_ten_draws_is_ico_as_printed():
    """Every draw of every round tried, on a residual that falls with α as every residual does."""

    def trial(alpha):
        return Trial(alpha, 50.0 * alpha / (1.0 + alpha), 1.0, 1.0, 1)

    for seed in range(20):
        for tolerance in (0.9, 0.3, 0.05, 0.0):
            low, high, rng, kept = 1e-4, 1e3, np.random.default_rng(seed), []
            for _ in range(40):
                width = high - low
                drawn = low + width * rng.random(ICO_TRIALS)
                W = [np.sqrt(trial(alpha).misfit / 50.0) for alpha in drawn]
                kept.append(drawn[np.argmin(W)])
                if min(W) <= tolerance:
                    break
                if kept[-1] - low < 0.5 * width:
                    high -= 0.5 * width
                else:
                    low += 0.5 * width
            alpha, ours = by_ico(trial, 1e3, seed, bounds=(1e-4, 1e3), tolerance=tolerance)
            assert alpha == kept[-1]
            np.testing.assert_array_equal(ours, kept)


def test_a_reading_that_the_smoother_refuses_is_not_used():
    plant, u, _ = logged(missing=0.0)
    u.y_degC[60, 1] += 30.0
    history = heat_history(plant, EstimatorSettings(), [u], MethodOptions("tikhonov"))
    assert np.isnan(history.residual_K[60, 1])
    assert np.isfinite(np.delete(history.residual_K, 60, axis=0)).all()


@pytest.mark.parametrize(
    "options",
    [
        MethodOptions("tikhonov", order=0),
        MethodOptions("tikhonov", order=1),
        MethodOptions("conjugate-gradient"),
        MethodOptions("conjugate-gradient", order=0),
        MethodOptions("conjugate-gradient", gradient="central-differences"),
    ],
)
def test_heats_before_the_first_measurement_are_unknown(options):
    plant, u, _ = logged()
    u.usable[:7] = False
    history = heat_history(plant, EstimatorSettings(), [u.part(0, 50), u.part(50)], options)
    assert len(history) == len(u)
    assert np.flatnonzero(np.isnan(history.heat_W).any(axis=1)).tolist() == list(range(7))
    if options.method == "conjugate-gradient":
        np.testing.assert_array_equal(history.heat_W[7], history.heat_W[8])


def test_a_misfit_beyond_the_noise_is_said():
    plant, u, _ = logged()
    options = MethodOptions("tikhonov", regularisation=1e9)
    history = heat_history(plant, EstimatorSettings(), [u], options)
    assert any("do not explain the log" in sentence for sentence in history.warnings)


def test_sigma_that_has_no_digits_left_is_not_shown():
    plant, u, _ = logged(steps=40)
    plant = replace(plant, initial_sigma_W=np.full(3, 1e9))
    found = Regularised(plant, OPEN_GATE, [u], 0).solve(1.0)
    assert not (found.sigma[1:] < 1e-5 * 1e9).any()
