"""The stacked equation, Tikhonov and conjugate gradients: beside the plant, the smoother and dense forms."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from observer.errors import UserError
from observer.history.conjugate_gradient import Convolution, descend, spread, stepwise_heats
from observer.history.history import MethodOptions
from observer.history.identify import heat_history
from observer.history.smoother import smooth_heats
from observer.history.stacked import Prior, stacked_problem
from observer.history.tikhonov import (
    Spectrum,
    by_discrepancy,
    by_gcv,
    by_ico,
    by_l_curve,
    normal_equations,
    solve,
)
from observer.tables.estimator import EstimatorSettings
from tests.bits.shared import COUPLINGS, coupled
from tests.logs.inputs import inputs, temperatures
from tests.logs.plants import AMBIENT_DEGC, rod

DT_S = 6.0


def heat_at(t_s):
    return np.array([12.0, 30.0 * np.exp(-t_s / 300.0), 6.0])


def logged(steps=120, missing=0.2, noise_K=0.05, **plant_):
    """A plant and a log of it under known heats; the heats (K, 3) too."""
    plant = rod(**({"walk_W_sqrt_s": 0.3, "law_uncertainty": 0.0} | plant_))
    u = inputs(plant, steps=steps, dt_s=DT_S, missing=missing, law_steps=False)
    u.z_start[:], u.z_end[:] = AMBIENT_DEGC, AMBIENT_DEGC
    u.y_degC[:] = temperatures(plant, u, heat_at, noise_K=noise_K)
    u.y_degC[~u.usable] = np.nan
    return plant, u, np.array([heat_at(t - u.time_s[0]) for t in u.time_s])


def held(plant, u, prior):
    """The same prior for the smoother: heats that jump at the start of each step and are held over it."""
    jumps = np.tile(prior.step_W, (len(u), 1))
    plant = replace(plant, random_walk_W2_s=np.zeros(3), law_uncertainty=np.ones(3))
    return plant, u._replace(law_jump_W=jumps)


def test_the_columns_of_H_are_the_plants_responses():
    plant, u, heat_W = logged(missing=0.0, noise_K=0.0)
    problem, first = stacked_problem(plant, [u])
    rows = Convolution(problem.response_K_W).forward(heat_W[1:])
    assert first == 0
    # the start of the log, a screw of one temperature, is what `temperatures` starts from
    np.testing.assert_allclose(rows, problem.rise_K, rtol=0, atol=1e-9 * problem.rise_K.max())


def test_the_adjoints_are_those_of_the_products():
    plant, u, _ = logged(heat_rate_1_s=2e-3)
    problem, _ = stacked_problem(plant, [u])
    H, prior, rng = Convolution(problem.response_K_W), Prior.of(plant, DT_S, 1), np.random.default_rng(1)
    w, e = rng.standard_normal((problem.steps, 3)), rng.standard_normal(problem.rise_K.shape)
    there = np.vdot(problem.whiten(H.forward(prior.heats(w))), e)
    back = np.vdot(w, prior.adjoint(H.adjoint(problem.whiten_adjoint(e))))
    assert there == pytest.approx(back, rel=1e-11)


def test_the_dense_matrix_is_the_convolution():
    plant, u, _ = logged(steps=40)
    problem, _ = stacked_problem(plant, [u])
    prior, w = Prior.of(plant, DT_S, 1), np.random.default_rng(2).standard_normal((39, 3))
    fast = problem.whiten(Convolution(problem.response_K_W).forward(prior.heats(w)))
    normal = normal_equations(problem, prior)
    assert w.ravel() @ normal.G @ w.ravel() == pytest.approx(np.vdot(fast, fast), rel=1e-11)
    assert w.ravel() @ normal.b == pytest.approx(np.vdot(fast, problem.whiten(problem.rise_K)), rel=1e-9)


def with_a_housing():
    """A screw whose left end is in a housing, all heats beyond no law, no noise but that of sensors."""
    plant, u = coupled(COUPLINGS["body_at_an_end"], 200, moving=False, dt_s=DT_S)
    u.dt_s[0], u.usable[0], u.law_W[:], u.law_jump_W[:] = 0.0, True, 0.0, 0.0
    return replace(plant, field_noise_Q=np.zeros_like(plant.field_noise_Q)), u, None


@pytest.mark.parametrize("machine", [partial(logged, steps=200), with_a_housing])
def test_tikhonov_at_the_smoothers_prior_is_the_smoother(machine):
    """Missing samples, an uncertain start, heats held over each step: mean and σ to 1e-6."""
    plant, u, _ = machine()
    problem, _ = stacked_problem(plant, [u])
    prior = Prior.of(plant, DT_S, 1)
    heat_W, sigma_W = solve(problem, prior, normal_equations(problem, prior), 1.0)
    same_plant, same_u = held(plant, u, prior)
    smooth = smooth_heats(same_plant, EstimatorSettings(gate_sigma=1e9), [same_u])
    np.testing.assert_allclose(heat_W, smooth.heat_W[1:], rtol=0, atol=1e-6 * np.abs(heat_W).max())
    np.testing.assert_allclose(sigma_W, smooth.heat_sigma_W[1:], rtol=1e-6)
    left = problem.rise_K - Convolution(problem.response_K_W).forward(heat_W)
    np.testing.assert_allclose(problem.unexplained(left), smooth.residual_K, rtol=0, atol=1e-6)


@pytest.mark.parametrize("heat_rate", [0.0, 2e-3])
def test_the_walk_of_the_default_smoother_is_close_to_heats_held_over_each_step(heat_rate):
    plant, u, _ = logged(steps=200, heat_rate_1_s=heat_rate)
    batch = heat_history(plant, EstimatorSettings(), [u], MethodOptions("tikhonov", regularisation=1.0))
    smooth = heat_history(plant, EstimatorSettings(), [u], MethodOptions())
    apart = np.abs(batch.heat_W - smooth.heat_W)[5:] / smooth.heat_sigma_W[5:]
    assert np.median(apart) < 0.2


def test_choices_by_the_spectrum_are_those_by_solving():
    plant, u, heat_W = logged(steps=80)
    problem, _ = stacked_problem(plant, [u])
    prior, H = Prior.of(plant, DT_S, 1), Convolution(problem.response_K_W)
    normal = normal_equations(problem, prior)
    spectrum = Spectrum.of(normal, problem.measurements)
    for alpha in (1e-2, 1.0, 1e3):
        found = solve(problem, prior, normal, alpha)[0]
        left = problem.whiten(problem.rise_K - H.forward(found))
        assert spectrum.misfit(alpha) == pytest.approx(np.vdot(left, left), rel=1e-6)
    assert spectrum.misfit(by_discrepancy(spectrum)) == pytest.approx(problem.measurements, rel=1e-4)
    errors = {
        alpha: np.mean((solve(problem, prior, normal, alpha)[0] - heat_W[1:]) ** 2)
        for alpha in (by_gcv(spectrum), by_l_curve(spectrum), *spectrum.trials()[::7])
    }
    best = min(errors.values())
    # theory promises GCV the best prediction of the data, not of the heats; twice the least error is usual
    assert errors[by_gcv(spectrum)] < 4.0 * best
    # the curve's sharpest bend need not be where its legs meet; but it is far from either end
    assert errors[by_l_curve(spectrum)] < 0.25 * min(errors[spectrum.trials()[i]] for i in (0, -1))


def test_ico_as_printed_goes_to_the_smallest_parameter_allowed():
    plant, u, heat_W = logged(steps=80)
    problem, _ = stacked_problem(plant, [u], start_known=True)
    prior = Prior.of(plant, DT_S, 0)
    normal = normal_equations(problem, prior)
    spectrum = Spectrum.of(normal, problem.measurements)
    ends = {low: by_ico(spectrum, 3, bounds=(low, 1e3), tolerance=0.0) for low in (1e-3, 1.0, 30.0)}
    for low, (alpha, kept) in ends.items():
        assert alpha == pytest.approx(low, rel=1e-3), "forty halvings all went down"
        assert len(kept) == 40
    wrong = solve(problem, prior, normal, ends[1e-3][0])[0]
    better = solve(problem, prior, normal, by_discrepancy(spectrum))[0]
    assert np.std(wrong - heat_W[1:]) > 2.0 * np.std(better - heat_W[1:])
    assert by_ico(spectrum, 3)[0] == by_ico(spectrum, 3)[0]
    assert by_ico(spectrum, 3)[0] != by_ico(spectrum, 4)[0]


@pytest.mark.parametrize("order", [0, 1])
def test_conjugate_gradients_end_at_the_noise(order):
    plant, u, heat_W = logged(steps=300)
    problem, _ = stacked_problem(plant, [u], start_known=order == 0)
    found = descend(problem, Prior.of(plant, DT_S, order), Convolution(problem.response_K_W), problem.rise_K)
    assert found.reached
    assert 0.9 * problem.measurements < found.misfit < 1.1 * problem.measurements
    assert 0 < found.iterations < 300
    assert np.sqrt(np.mean((found.heat_W - heat_W[1:])[20:-20] ** 2)) < (6.0 if order == 0 else 1.5)


def test_conjugate_gradients_without_noise_find_the_heats():
    plant, u, heat_W = logged(steps=100, missing=0.0, noise_K=0.0)
    problem, _ = stacked_problem(replace(plant, noise_R_K2=plant.noise_R_K2 * 1e-4), [u], start_known=True)
    found = descend(problem, Prior.of(plant, DT_S, 1), Convolution(problem.response_K_W), problem.rise_K)
    assert found.reached
    # a descent that ends at 0.5 mK leaves a percent or two open where the heat jumps at the start
    np.testing.assert_allclose(found.heat_W[:90], heat_W[1:91], rtol=0, atol=1.0)


def test_step_by_step_as_printed_follows_near_sensors_and_loses_far_ones():
    near = rod(sensors_m=(0.0, 0.3, 0.6), law_uncertainty=0.0)
    far = rod(sensors_m=(0.1, 0.2, 0.45), law_uncertainty=0.0)
    errors = []
    for plant in (near, far):
        u = inputs(plant, steps=100, dt_s=DT_S, missing=0.0, law_steps=False)
        u.z_start[:], u.z_end[:] = AMBIENT_DEGC, AMBIENT_DEGC
        u.y_degC[:] = temperatures(plant, u, heat_at)
        problem, _ = stacked_problem(plant, [u], start_known=True)
        truth = np.array([heat_at(t - u.time_s[0]) for t in u.time_s[1:]])
        errors.append(np.sqrt(np.mean((stepwise_heats(plant, problem, problem.rise_K) - truth) ** 2)))
    assert errors[0] < 3.0
    assert errors[1] > 30.0


@pytest.mark.parametrize("order", [0, 1])
def test_the_spread_of_conjugate_gradients_holds_for_heats_of_the_prior(order):
    plant, u, _ = logged(steps=150, initial_sigma_W=20.0)
    problem, _ = stacked_problem(plant, [u], start_known=order == 0)
    walk, prior = Prior.of(plant, DT_S, 1), Prior.of(plant, DT_S, order)
    H = Convolution(problem.response_K_W)

    def find(rise_K):
        return descend(problem, prior, H, rise_K).heat_W

    sigma = spread(problem, walk, H, find, seed=0)
    rng, scores = np.random.default_rng(8), []
    for _ in range(40):
        truth = walk.heats(rng.standard_normal((problem.steps, 3)))
        noise = np.where(u.usable, 0.05 * rng.standard_normal(u.usable.shape), 0.0)
        seen = np.where(u.usable, H.forward(truth) + problem.draw_start(rng), 0.0) + noise
        scores.append((((find(seen) - truth) / sigma) ** 2).mean())
    # σ² from 24 logs of correlated errors is good to some 20 %, and so is the mean over these 40
    assert np.mean(scores) == pytest.approx(1.0, abs=0.4)


def test_rows_before_the_first_measurement_are_unknown():
    plant, u, _ = logged()
    u.usable[:7] = False
    history = heat_history(plant, EstimatorSettings(), [u.part(0, 50), u.part(50)], MethodOptions("tikhonov"))
    assert len(history) == len(u)
    assert np.flatnonzero(np.isnan(history.heat_W).any(axis=1)).tolist() == list(range(7))
    np.testing.assert_array_equal(history.heat_W[7], history.heat_W[8])


def test_what_moves_is_taken_at_its_mean_and_that_is_said():
    plant, u, _ = logged(moving=(1,))
    plant = replace(plant, moving=tuple(replace(m, index=1) for m in plant.moving))
    history = heat_history(plant, EstimatorSettings(), [u], MethodOptions("conjugate-gradient"))
    assert any("q1 at the mean of the stroke; --method smoother" in sentence for sentence in history.warnings)


def test_a_misfit_beyond_the_noise_is_said():
    plant, u, _ = logged()
    options = MethodOptions("tikhonov", regularisation=1e9)
    history = heat_history(plant, EstimatorSettings(), [u], options)
    assert any("do not explain the log" in sentence for sentence in history.warnings)


def test_uneven_steps_and_long_logs_are_refused_in_one_sentence():
    plant, u, _ = logged()
    u.dt_s[30] = 20.0
    with pytest.raises(UserError, match=r"uneven, 6 to 20 s, .* use --method smoother"):
        stacked_problem(plant, [u])
    plant, u, _ = logged(steps=3000)
    with pytest.raises(UserError, match=r"GB for 2999 steps of 3 heats.* use --method smoother"):
        heat_history(plant, EstimatorSettings(), [u], MethodOptions("tikhonov"))
    with pytest.raises(UserError, match="fewer than three steps"):
        stacked_problem(plant, [u.part(0, 2)])


def test_a_plant_that_changes_is_refused():
    plant, u, _ = logged()
    plant = replace(plant, coupling=plant.coupling._replace(active=1))
    with pytest.raises(UserError, match=r"an effect changes the plant .* use --method smoother"):
        stacked_problem(plant, [u])


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        ({"regularisation": 2.0}, "--regularisation belongs to --method tikhonov, not smoother"),
        ({"method": "smoother", "order": 1}, "--order belongs to"),
        ({"method": "tikhonov", "gradient": "adjoint"}, "--gradient belongs to --method conjugate-gradient"),
        ({"method": "tikhonov", "regularisation": 1.0, "parameter_choice": "gcv"}, "give one of them"),
        ({"method": "tikhonov", "regularisation": -1.0}, "give a number above 0"),
        (
            {"method": "conjugate-gradient", "gradient": "central-differences", "order": 1},
            "leave out --order",
        ),
    ],
)
def test_options_that_contradict_each_other_are_refused(options, sentence):
    with pytest.raises(UserError, match=sentence):
        MethodOptions(**options).check()
