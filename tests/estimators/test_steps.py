"""The Kalman filter's steps on a small plant, against dense matrices."""

from __future__ import annotations

import numpy as np
import pytest

from observer.config.estimator import EstimatorSettings
from observer.estimators.kalman import KalmanEstimator
from observer.estimators.specification import Belief, Columns, correct, predict, transition
from observer.fit.process_noise import innovations_log_likelihood
from observer.frames import EstimateQuality, Quality
from tests.logs.inputs import lively
from tests.logs.plants import at, small

WIDE = 1e9
STEPS = 16
EVEN_S = 5.0


def began(plant, u):
    """x and P after the first step's start: the median of what the sensors say, and the prior."""
    n_x, s = len(plant.decay_1_s), plant.rows.sensors
    C, F = at(plant, u, 0).rows.C[:s], plant.rows.F[:s]
    x = np.zeros(n_x + int(plant.estimated.sum()))
    x[plant.modes : n_x] = u.law_W[0]
    levels = (u.y_degC[0] - C @ x[:n_x] - F @ u.z_end[0]) / (C @ plant.uniform)
    x[:n_x] += plant.uniform * np.median(levels[u.usable[0]])
    P = np.zeros((len(x), len(x)))
    P[:n_x, :n_x] = plant.prior_P
    P[n_x:, n_x:] = np.diag(plant.initial_sigma_W**2)
    return x, P


def dense(plant, u, shares=None, kept=None):
    """Predict and correct on dense matrices, in Joseph's form, from the start on.

    `shares` of the prior are added to P before the correction of some steps, `kept` (K, s) are the sensors
    that correct. Returns states, P, the innovations and their σ, and what each innovation's likelihood is.
    """
    n_x, s = len(plant.decay_1_s), plant.rows.sensors
    kept = u.usable if kept is None else kept
    x, prior = began(plant, u)
    P = prior.copy()
    states, covariances, innovations, sigmas, likelihood = [], [], [], [], []
    for k in range(len(u)):
        now = at(plant, u, k)
        if k:
            step = transition(plant, u, k, x, Columns(now.B, np.zeros((n_x, 0))))
            x, P = predict(Belief(x, P), step.F, step.forced, step.Q)
        H = np.hstack([now.rows.C[:s], np.zeros((s, len(x) - n_x))])
        R = np.diag(plant.noise_R_K2)
        nu = u.y_degC[k] - H @ x - plant.rows.F[:s] @ u.z_end[k]
        innovations.append(np.where(u.usable[k], nu, np.nan))
        sigmas.append(np.where(u.usable[k], np.sqrt(np.diag(H @ P @ H.T + R)), np.nan))
        P = P + (shares or {}).get(k, 0.0) * prior
        r = R[np.ix_(kept[k], kept[k])]
        y = nu[kept[k]] + H[kept[k]] @ x
        (x, P), _, _, _, log_likelihood = correct(Belief(x, P), H[kept[k]], y, r)
        states.append(x)
        covariances.append(P.copy())
        likelihood.append(log_likelihood)
    return (np.array(a) for a in (states, covariances, innovations, sigmas, likelihood))


def uneven(plant, steps=STEPS):
    """Steps of several lengths, laws that jump, a nut that moves and samples that are missing."""
    u = lively(plant, steps=steps, nut_m=0.3 + 0.2 * np.sin(np.arange(steps)))
    rng = np.random.default_rng(3)
    u.dt_s[1:] = rng.choice([0.1, 0.5, 3.0], steps - 1)
    u.dt_s[0] = 0.0
    u.law_jump_W[1:] = np.diff(u.law_W, axis=0)
    u.usable[:] = rng.random(u.usable.shape) > 0.2
    u.usable[:2] = True
    u.usable[5] = False  # a step without any sample
    u.quality[:] = np.where(u.usable, Quality.GOOD, Quality.MISSING)
    return u


@pytest.mark.parametrize(
    ("moving", "rate_1_s"), [((), 0.0), ((), 1e-3), ((0,), 1e-3), ((1,), 0.0), ((0, 2), 1e-3)]
)
def test_every_step_is_the_textbooks(moving, rate_1_s):
    plant = small(moving, heat_rate_1_s=rate_1_s)
    n_x, s = len(plant.decay_1_s), plant.rows.sensors
    u = uneven(plant)
    estimator = KalmanEstimator(plant, EstimatorSettings(gate_sigma=WIDE))
    last, block = estimator.run(estimator.initial(), u)
    x, P, nu, sigma, likelihood = dense(plant, u)
    size = np.abs(x).max()
    # The dense form loses a few digits on the large entries of a modal P.
    np.testing.assert_allclose(last.x_hat, x[-1], rtol=0, atol=1e-9 * size)
    np.testing.assert_allclose(last.P, P[-1], rtol=0, atol=1e-9 * np.abs(P[0]).max())
    np.testing.assert_allclose(block.innovation_K, nu, rtol=0, atol=1e-9 * size)
    np.testing.assert_allclose(block.innovation_sigma_K, sigma, rtol=1e-6)
    np.testing.assert_allclose(block.heat_W, u.law_W[:, plant.estimated] + x[:, n_x:], rtol=1e-8)
    np.testing.assert_allclose(block.heat_sigma_W, np.sqrt(np.einsum("kaa->ka", P)[:, n_x:]), rtol=1e-8)
    for k in range(len(u)):
        rows = at(plant, u, k).rows.C[s:]
        field = rows @ x[k, :n_x] + plant.rows.F[s:] @ u.z_end[k]
        variance = np.einsum("ra,ab,rb->r", rows, P[k, :n_x, :n_x], rows)
        np.testing.assert_allclose(block.field_degC[k], field, rtol=1e-8)
        np.testing.assert_allclose(block.field_sigma_K[k], np.sqrt(variance), rtol=1e-6)
    reported = innovations_log_likelihood(plant, u)
    assert reported == pytest.approx(likelihood[1:].sum(), rel=1e-6)


def test_many_rows_are_reported_as_few_are():
    """Up to eight one after the other, more all at once: the field is the same."""
    few, many = (small(grid=grid) for grid in (3, 17))
    blocks = []
    for plant in (few, many):
        u = lively(plant, steps=4)
        estimator = KalmanEstimator(plant, EstimatorSettings(gate_sigma=WIDE))
        blocks.append(estimator.run(estimator.initial(), u)[1])
    np.testing.assert_allclose(blocks[1].field_sigma_K[:, ::8], blocks[0].field_sigma_K, rtol=1e-9)


def test_sensors_that_say_almost_everything_leave_the_digits():
    """What P expects is more than 10⁸ of the noise: one after the other, in Joseph's form."""
    plant = small(noise_K=1e-5)
    u = lively(plant, steps=4)
    u.usable[2, 1] = False
    estimator = KalmanEstimator(plant, EstimatorSettings(gate_sigma=1e12))
    last, block = estimator.run(estimator.initial(), u)
    x, P, nu, _, likelihood = dense(plant, u)
    n_x, scale = len(plant.decay_1_s), np.maximum(np.sqrt(np.diag(P[-1])), 1e-12)  # a lag without a walk
    np.testing.assert_allclose(last.x_hat, x[-1], rtol=0, atol=1e-5 * np.abs(x).max())
    np.testing.assert_allclose(block.heat_sigma_W[-1], scale[n_x:], rtol=1e-4)
    np.testing.assert_allclose(last.P / np.outer(scale, scale), P[-1] / np.outer(scale, scale), atol=1e-4)
    np.testing.assert_array_equal(last.P, last.P.T)
    np.testing.assert_allclose(block.innovation_K, nu, rtol=0, atol=1e-4 * np.nanmax(np.abs(nu)))
    assert innovations_log_likelihood(plant, u) == pytest.approx(likelihood[1:].sum(), rel=1e-3)


@pytest.mark.parametrize("present", [(0, 1, 2), (0, 2), (1,)])
def test_it_begins_at_the_median_of_what_the_sensors_say(present):
    plant = small()
    u = lively(plant, steps=1)
    u.y_degC[0] = [35.0, 21.0, 24.0]
    u.usable[0] = [i in present for i in range(3)]
    estimator = KalmanEstimator(plant, EstimatorSettings(gate_sigma=WIDE))
    last, _ = estimator.run(estimator.initial(), u)
    x, P, *_ = dense(plant, u)
    np.testing.assert_allclose(last.x_hat, x[-1], rtol=0, atol=1e-9 * np.abs(x).max())
    np.testing.assert_allclose(last.P, P[-1], rtol=0, atol=1e-9 * np.abs(plant.prior_P).max())


# ---- what opens the covariance ----


def even(plant, steps):
    u = lively(plant, steps=steps)
    u.dt_s[:] = EVEN_S
    u.law_W[:] = 0.0
    u.z_start[:] = u.z_end[:] = [20.0, 0.0]
    C, F = plant.rows.C[:3], plant.rows.F[:3]
    u.y_degC[:] = 20.0 * (C @ plant.uniform + F[:, 0])
    return u


@pytest.mark.parametrize(
    ("off", "silent", "released"),
    [((0, 1, 2), (), True), ((0, 2), (), True), ((1,), (), False), ((1,), (2,), False), ((0, 1), (2,), True)],
)
def test_more_than_half_of_the_sensors_overrule_the_model_at_the_third_step(off, silent, released):
    """Of those that have a sample: one of two is not more than half."""
    plant, first = small(), 4
    u = even(plant, 10)
    u.usable[:, list(silent)], u.quality[:, list(silent)] = False, Quality.MISSING
    u.y_degC[first:, list(off)] += 60.0
    estimator = KalmanEstimator(plant, EstimatorSettings(gate_sigma=3.0))
    last, block = estimator.run(estimator.initial(), u.part(0, first + 3))
    kept = u.usable.copy()
    kept[first : first + (2 if released else 99), list(off)] = False
    _, P, nu, sigma, _ = dense(plant, u, {first + 2: 1.0} if released else {}, kept)
    np.testing.assert_allclose(last.P, P[first + 2], rtol=0, atol=1e-9 * np.abs(P[0]).max())
    np.testing.assert_allclose(block.innovation_K, nu[: first + 3], rtol=0, atol=1e-7)
    np.testing.assert_allclose(block.innovation_sigma_K, sigma[: first + 3], rtol=1e-6)
    rejected = u.usable[: first + 3] & ~kept[: first + 3]
    np.testing.assert_array_equal(block.sensor_quality == Quality.REJECTED, rejected)
    assert last.suspect.tolist() == [3.0 * (i in off and not released) for i in range(3)]


def test_what_the_qualities_say():
    """Silent for more than two steps is stale; a refused sensor stays marked between its samples."""
    plant = small()
    u = even(plant, 16)
    u.usable[3:8] = False
    u.quality[3:8] = Quality.MISSING
    u.usable[9], u.quality[9] = False, Quality.STALE
    u.usable[10, 0], u.quality[10, 0] = False, Quality.STALE
    u.y_degC[12, 1] += 500.0
    u.usable[13:15, 1] = False
    u.degraded[15] = 1
    estimator = KalmanEstimator(plant, EstimatorSettings(gate_sigma=5.0))
    _, block = estimator.run(estimator.initial(), u)
    good, degraded, stale = EstimateQuality.GOOD, EstimateQuality.DEGRADED, EstimateQuality.STALE
    expected = [good] * 3 + [degraded] * 2 + [stale] * 3 + [good, stale, degraded, good]
    assert block.quality.tolist() == expected + [degraded] * 4
    wanted = u.quality.copy()
    wanted[12:15, 1] = Quality.REJECTED
    np.testing.assert_array_equal(block.sensor_quality, wanted)


def test_a_nut_that_is_lost_costs_the_whole_prior_within_forty_seconds():
    """The prior's share grows with the square of the time; afterwards by as much as in the last step."""
    plant = small()
    u = even(plant, 14)
    u.degraded[3:13] = 2
    u.degraded[2] = 1  # an input that is missing costs nothing
    estimator = KalmanEstimator(plant, EstimatorSettings(gate_sigma=WIDE))
    last, block = estimator.run(estimator.initial(), u)
    squares = (np.arange(9) * EVEN_S / 40.0) ** 2
    shares = dict(zip(range(3, 11), np.diff(squares), strict=True))
    shares |= {11: squares[8] - squares[7], 12: squares[8] - squares[7]}
    _, P, *_ = dense(plant, u, shares)
    np.testing.assert_allclose(last.P, P[-1], rtol=0, atol=1e-9 * np.abs(P[0]).max())
    n_x = len(plant.decay_1_s)
    np.testing.assert_allclose(block.heat_sigma_W, np.sqrt(np.einsum("kaa->ka", P)[:, n_x:]), rtol=1e-8)
    assert last.lost_s == 0.0
    expected = np.full(14, EstimateQuality.GOOD)
    expected[2:13] = EstimateQuality.DEGRADED
    np.testing.assert_array_equal(block.quality, expected)


@pytest.mark.parametrize(("off_K", "steps"), [(2.0, 18), (500.0, 40)])
def test_a_refused_sensor_is_given_a_chance_after_twenty_seconds_and_then_each_minute(off_K, steps):
    """P gets the share of its prior that makes what it says three σ, and the others speak first."""
    plant, at_fault, first = small(initial_sigma_K=4.0), 1, 6
    u = even(plant, steps)
    u.y_degC[first:, at_fault] += off_K
    estimator = KalmanEstimator(plant, EstimatorSettings(gate_sigma=5.0))
    _, block = estimator.run(estimator.initial(), u)
    assert (block.sensor_quality[first:, at_fault] == Quality.REJECTED).all()
    assert (block.sensor_quality[:, [0, 2]] == Quality.GOOD).all()
    kept = u.usable.copy()
    kept[first:, at_fault] = False
    opened = [k for k in (first + 3, first + 15, first + 27) if k < steps]  # 20, 80 and 140 s refused
    c = plant.rows.C[at_fault]
    variance = c @ plant.prior_P @ c
    shares = {k: min(1.0, max(0.01, (block.innovation_K[k, at_fault] / 3.0) ** 2 / variance)) for k in opened}
    assert (shares[opened[0]] == 1.0) == (off_K > 100.0)
    assert shares[opened[0]] > 0.01
    x, P, nu, sigma, _ = dense(plant, u, shares, kept)
    n_x = len(plant.decay_1_s)
    np.testing.assert_allclose(block.heat_sigma_W, np.sqrt(np.einsum("kaa->ka", P)[:, n_x:]), rtol=1e-7)
    np.testing.assert_allclose(block.innovation_K, nu, rtol=0, atol=1e-8 * np.abs(x).max())
    np.testing.assert_allclose(block.innovation_sigma_K, sigma, rtol=1e-6)


def test_a_sensor_held_back_is_believed_when_it_agrees_with_what_the_others_made_of_it():
    """Wrong by 60 K for a while and then right again, or by a little less: a third of it is not agreeing."""
    plant, at_fault, first = small(initial_sigma_K=4.0), 1, 6
    for now_K, believed in ((0.0, True), (10.0, True), (25.0, False)):
        u = even(plant, first + 6)
        u.y_degC[first:, at_fault] += 60.0
        u.y_degC[first + 5 :, at_fault] += now_K - 60.0
        estimator = KalmanEstimator(plant, EstimatorSettings(gate_sigma=30.0))
        _, block = estimator.run(estimator.initial(), u)
        good = block.sensor_quality[-1, at_fault] == Quality.GOOD
        sigmas = abs(block.innovation_K[-1, at_fault]) / block.innovation_sigma_K[-1, at_fault]
        assert sigmas < 30.0, "the gate alone would let it pass"
        assert good == believed, now_K


def test_a_law_that_is_no_number_leaves_the_state_and_its_step_unknown():
    plant = small(moving=(1,))
    u = lively(plant, steps=8, nut_m=np.full(8, 0.3))
    u.law_W[2, 1] = u.z_start[3, 0] = u.z_end[4, 0] = u.moving_B[5, 0, 1] = np.nan
    estimator = KalmanEstimator(plant, EstimatorSettings(gate_sigma=WIDE))
    before, _ = estimator.run(estimator.initial(), u.part(0, 2))
    after, block = estimator.run(before, u.part(2, 6))
    np.testing.assert_array_equal(after.x_hat, before.x_hat)
    np.testing.assert_array_equal(after.P, before.P)
    assert (block.quality == EstimateQuality.INVALID).all()
    for values in (block.heat_W, block.heat_sigma_W, block.field_degC, block.field_sigma_K, block.law_W):
        assert np.isnan(values).all()
    assert np.isnan(block.innovation_K).all()
    assert np.isnan(block.innovation_sigma_K).all()
