"""What tolerances leave to the heats of a log: beside dense equations, and on rough machines."""

import numpy as np
import pytest

from observer.fit.changes import changes_within
from observer.history.identify import heat_history
from observer.history.options import MethodOptions
from observer.history.smoother import smooth_heats
from observer.history.stacked import Prior, stacked_problem
from observer.history.tikhonov import _dense
from observer.history.within import Change, most_probable, with_readings
from observer.service.align import frames_of_log
from observer.service.identify import inputs_of
from observer.service.machine import Machine
from observer.tables.estimator import EstimatorSettings
from tests.history.test_stacked import DT_S, held, logged
from tests.learning.cover import log_of
from tests.learning.histories import FIRST_SEED, covered, identified
from tests.learning.machines import CONFIG, Rough, config_of, day, draw
from tests.learning.trial import KNOWN

OPEN_GATE = EstimatorSettings(gate_sigma=1e9)


def drifts(K, s):
    """Three slow changes of the sensors, nothing at first: the start's level is what the sensors say."""
    t = np.linspace(0.0, 1.0, K)[:, None]
    ramp = t * np.eye(s)[0]
    return [0.4 * ramp, 0.3 * np.sin(3.0 * t) * np.ones(s), 0.5 * t**2 * np.linspace(-1.0, 1.0, s)]


@pytest.mark.parametrize(
    "learnt", [(True, True, True), (True, False, True), (False, False, False)], ids=["all", "two", "none"]
)
def test_heats_and_their_variance_are_those_of_the_dense_equations(learnt):
    """Heats, tolerances and noise as one vector of independent numbers; estimate and error as matrices on it.
    The error's variance holds whatever the estimate makes of what it does not learn.
    """
    plant, u, _ = logged(steps=90)
    changes = [Change(d, is_learnt) for d, is_learnt in zip(drifts(90, 4), learnt, strict=True)]
    problem, _ = stacked_problem(plant, [u])
    prior = Prior.of(plant, DT_S, 1)
    z, n = problem.whiten(problem.rise_K).ravel(), problem.steps * problem.heats
    H = problem.whiten(_dense(problem, prior)).reshape(len(z), n)
    X = problem.whiten(np.stack([c.sensor_K for c in changes], axis=2)).reshape(len(z), 3)
    both = np.hstack([H, X])
    g = np.linalg.solve(both.T @ both + np.eye(n + 3), both.T)[n:] * np.array(learnt)[:, None]
    K = np.linalg.solve(H.T @ H + np.eye(n), H.T) @ (np.eye(len(z)) - X @ g)
    error = np.hstack([K @ H - np.eye(n), K @ X, K])
    heats = prior.heats(error.reshape(problem.steps, problem.heats, -1))
    sigma_W = np.sqrt(np.sum(heats**2, axis=-1))
    heat_W = prior.heats((K @ z).reshape(problem.steps, problem.heats))

    same_plant, same_u = held(plant, u, prior)
    found = most_probable(same_plant, OPEN_GATE, [same_u], problem.weight_1_K > 0.0, changes)
    history = smooth_heats(same_plant, OPEN_GATE, with_readings([same_u], -found.sensor_K))
    ours_W = np.sqrt(history.heat_sigma_W**2 + found.variance_W2)
    np.testing.assert_allclose(history.heat_W[1:], heat_W, rtol=0, atol=1e-6 * np.abs(heat_W).max())
    np.testing.assert_allclose(ours_W[1:], sigma_W, rtol=1e-5)
    assert (ours_W > 1.05 * history.heat_sigma_W).any(), "there is something to tell"


@pytest.mark.parametrize("method", ["smoother", "tikhonov", "conjugate-gradient"])
def test_every_method_takes_learnt_off_the_readings_and_the_rest_into_sigma(method):
    plant, u, _ = logged(steps=90)
    options = MethodOptions(method)
    plain = heat_history(plant, OPEN_GATE, [u], options)
    same = heat_history(plant, OPEN_GATE, [u], options, lambda _heat_W: [])
    np.testing.assert_array_equal(same.heat_W, plain.heat_W)
    np.testing.assert_array_equal(same.heat_sigma_W, plain.heat_sigma_W)
    known, learnt = (
        heat_history(plant, OPEN_GATE, [u], options, lambda _heat_W, by=by: [Change(drifts(90, 4)[0], by)])
        for by in (False, True)
    )
    np.testing.assert_array_equal(known.heat_W, plain.heat_W)
    assert (known.heat_sigma_W > 1.05 * plain.heat_sigma_W).any()
    assert np.abs(learnt.heat_W - plain.heat_W).max() > 0.0
    assert (learnt.heat_sigma_W <= known.heat_sigma_W + 1e-9).all() or method == "conjugate-gradient"


def of_morning(number):
    """The first twenty minutes of a rough machine's day."""
    one = day(draw(FIRST_SEED, number, Rough()), FIRST_SEED, number, "a")
    return one._replace(**{name: getattr(one, name)[:1200] for name in one._fields})


def test_with_all_tolerances_at_0_the_result_is_that_of_the_smoother_alone():
    one, config = of_morning(0), config_of(CONFIG, KNOWN)
    machine = Machine.of(config)
    blocks = inputs_of(frames_of_log(log_of(one), machine.plan), machine.drive)
    alone = heat_history(machine.plant, config.estimator, blocks, MethodOptions())
    ours = identified(config, one)
    for column in ("heat_W", "heat_sigma_W", "residual_K"):
        np.testing.assert_array_equal(getattr(ours, column), getattr(alone, column))


def test_each_tolerance_is_a_change_of_its_own_sensors_and_learnt_by_its_key():
    """Rows without a heat or an input take those before; a sensor beside the screw has no place there."""
    one = of_morning(0)
    config = config_of(CONFIG, '\n[estimator]\nlearn = ["conductivity", "lag_s"]\n')
    plan = Machine.of(config).plan
    one.air_degC[300:310] = np.nan
    frames = list(frames_of_log(log_of(one), plan))
    heat_W = one.heat_W.copy()
    heat_W[:5], heat_W[400:410] = np.nan, np.nan
    every = changes_within(config, frames, heat_W)
    # material, film, ends and air of all sensors; place, lag, gain and offset of each of five
    assert len(every) == 2 + 1 + 2 + 1 + 4 * 5
    assert sum(change.learnt for change in every) == 1 + 5
    assert all(np.isfinite(change.sensor_K).all() for change in every)
    assert [np.count_nonzero(change.sensor_K.any(axis=0)) for change in every] == [5] * 6 + [1] * 20
    offsets = [c.sensor_K for c in every[-9::2]]
    np.testing.assert_array_equal([c.max() for c in offsets], [0.3] * 5)
    # what lags reads later by 4 s: while a sensor warms evenly that is 4 s of its slope
    lag_K = next(c.sensor_K for c in every[11:] if c.learnt)
    warming = np.gradient(np.convolve(one.sensor_degC[:, 0], np.ones(60) / 60.0, "same"))
    assert lag_K[900:1100, 0].mean() == pytest.approx(-4.0 * warming[900:1100].mean(), rel=0.2)
    assert changes_within(config, frames, np.full_like(heat_W, np.nan)) == []


@pytest.mark.slow
def test_true_heats_of_rough_machines_lie_within_their_95_percent_bands():
    """Four of the campaign's sixteen, two of which began warm; before any was drawn
    90 to 98 % were asked for.
    Bands that take everything for known hold the truth in 24 %.
    """
    inside = []
    for number in range(4):
        one = day(
            draw(FIRST_SEED, number, Rough()), FIRST_SEED, number, "abc"[number % 3], warm=number % 2 == 1
        )
        inside.append(covered(identified(config_of(), one), one)[1].mean())
    assert np.mean(inside) >= 0.90
