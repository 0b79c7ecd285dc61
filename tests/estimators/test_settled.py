"""Observers whose covariance has settled, step by step against dense matrices."""

from __future__ import annotations

from dataclasses import fields, replace

import numpy as np
import pytest

from observer.estimators import build_estimator
from observer.estimators.fixed_gain import slack
from observer.estimators.protocol import EstimatorState
from observer.frames import EstimateQuality, Quality
from observer.model.discretise import augmented, quantise, step_matrices
from observer.tables.estimator import EstimatorSettings
from tests.logs.inputs import inputs, lively
from tests.logs.plants import AMBIENT_DEGC, LENGTH_M, at, rod, small

KINDS = [("kalman", "constant"), ("luenberger", "compiled")]
WIDE = 1e9
STEPS = 24


def built(plant, kind, engine, gate_sigma=WIDE):
    return build_estimator(
        plant, EstimatorSettings(kind=kind, engine=engine, bandwidth_1_s=0.005, gate_sigma=gate_sigma)
    )


def table_of(estimator):
    return estimator._bank.gains


def settled(plant, estimator):
    """A state with the steady covariance of all sensors."""
    x = np.random.default_rng(7).normal(size=len(plant.decay_1_s) + int(plant.estimated.sum()))
    x[: len(plant.decay_1_s)] += AMBIENT_DEGC * plant.uniform
    none = np.zeros(plant.rows.sensors)
    return EstimatorState(x, table_of(estimator).P[0].copy(), True, none, none, none, 0.0)


def dense(plant, u, x, K):
    """x⁺ = x_pred + K ν with the same gain at every step: states, innovations, heats, fields."""
    found, n_x, s = [], len(plant.decay_1_s), plant.rows.sensors
    for k in range(len(u)):
        now = at(plant, u, k)
        step = step_matrices(plant, float(quantise(u.dt_s[k])))
        x = augmented(now, step)[0] @ x
        x[:n_x] += step.hold * (now.B @ u.law_W[k] + plant.E @ u.z_start[k])
        x[:n_x] += step.ramp * (plant.E @ (u.z_end[k] - u.z_start[k]))
        nu = u.y_degC[k] - now.rows.C[:s] @ x[:n_x] - plant.rows.F[:s] @ u.z_end[k]
        x = x + K @ nu
        field = now.rows.C[s:] @ x[:n_x] + plant.rows.F[s:] @ u.z_end[k]
        found.append((x, nu, u.law_W[k, plant.estimated] + x[n_x:], field))
    return [np.array(part) for part in zip(*found, strict=True)]


@pytest.mark.parametrize("moving", [(), (1,), (0,)])
@pytest.mark.parametrize(("kind", "engine"), KINDS)
def test_a_settled_observer_is_its_gain_and_nothing_else(kind, engine, moving):
    plant = small(moving)
    estimator = built(plant, kind, engine)
    u = lively(plant, nut_m=0.3 + 0.2 * np.sin(np.arange(STEPS)))
    first, gains = settled(plant, estimator), table_of(estimator)
    last, block = estimator.run(first, u)
    x, nu, heats, field = dense(plant, u, first.x_hat, gains.K[0])
    # Rounding of sums in another order.
    np.testing.assert_allclose(last.x_hat, x[-1], rtol=0, atol=1e-11 * np.abs(x).max())
    np.testing.assert_allclose(block.innovation_K, nu, rtol=0, atol=1e-11 * np.abs(x).max())
    np.testing.assert_allclose(block.heat_W, heats, rtol=0, atol=1e-11 * np.abs(x).max())
    np.testing.assert_allclose(block.field_degC, field, rtol=0, atol=1e-11 * np.abs(x).max())
    np.testing.assert_array_equal(block.law_W, u.law_W[:, plant.estimated])
    np.testing.assert_array_equal(last.P, first.P)
    np.testing.assert_array_equal(block.heat_sigma_W, np.tile(gains.heat_sigma[0], (STEPS, 1)))
    np.testing.assert_array_equal(block.field_sigma_K, np.tile(gains.field_sigma[0], (STEPS, 1)))
    np.testing.assert_allclose(block.innovation_sigma_K, np.tile(np.sqrt(gains.S[0]), (STEPS, 1)), rtol=1e-12)
    assert (block.quality == EstimateQuality.GOOD).all()
    assert (block.sensor_quality == Quality.GOOD).all()


@pytest.mark.parametrize("change", ["every input, at each step", "none, for longer than a run is"])
def test_inputs_that_are_held_drive_as_before_and_no_others(change):
    """Six laws and both ends of one ambient fill a register: nothing beside them is always the same."""
    estimated = (True, *[False] * 4, True)
    plant = rod((0.05, 0.3, 0.55), np.linspace(0.0, LENGTH_M, 6), modes=3, estimated=estimated, grid=3)
    estimator = built(plant, *KINDS[0])
    u = inputs(plant, steps=260, missing=0.0)
    u = u._replace(degraded=np.zeros(len(u), dtype=np.int8), law_jump_W=np.zeros_like(u.law_W))
    u.dt_s[:] = 0.5
    moves = 1.0 if change.startswith("every") else 0.0
    u.law_W[:] = 15.0 + moves * np.sin(np.arange(len(u))[:, None] + np.arange(6))
    u.z_start[:, 0] = AMBIENT_DEGC + moves * 0.01 * np.arange(len(u))
    u.z_end[:] = u.z_start + moves * 0.01
    first, gains = settled(plant, estimator), table_of(estimator)
    last, block = estimator.run(first, u)
    x, nu, *_ = dense(plant, u, first.x_hat, gains.K[0])
    np.testing.assert_allclose(last.x_hat, x[-1], rtol=0, atol=1e-11 * np.abs(x).max())
    np.testing.assert_allclose(block.innovation_K, nu, rtol=0, atol=1e-11 * np.abs(x).max())


@pytest.mark.parametrize(("kind", "engine"), KINDS)
def test_the_steady_sigmas_are_those_of_the_steady_covariance(kind, engine):
    plant = small()
    estimator = built(plant, kind, engine)
    gains, s, n_x = table_of(estimator), plant.rows.sensors, len(plant.decay_1_s)
    P = gains.P[0]
    F, Q = augmented(plant, step_matrices(plant, 0.5))
    C, rows = plant.rows.C[:s], plant.rows.C[s:]
    predicted = (F @ P @ F.T + Q)[:n_x, :n_x]
    np.testing.assert_allclose(gains.S[0], np.diag(C @ predicted @ C.T) + plant.noise_R_K2, rtol=1e-8)
    np.testing.assert_allclose(gains.heat_sigma[0], np.sqrt(np.diag(P)[n_x:]), rtol=1e-12)
    np.testing.assert_allclose(
        gains.field_sigma[0], np.sqrt(np.diag(rows @ P[:n_x, :n_x] @ rows.T)), rtol=1e-9
    )


def test_before_it_has_settled_a_fixed_gain_is_that_of_the_sensors_that_are_left():
    """x⁺ = x + K ν and P⁺ = (I − K C) P (I − K C)ᵀ + K R Kᵀ, on dense matrices, far from the steady P."""
    plant = small(walk_W_sqrt_s=0.01)
    estimator = built(plant, "luenberger", "compiled")
    u, first = lively(plant, steps=10), settled(plant, estimator)
    first = replace(first, P=4.0 * first.P)
    for k, lost in ((2, [0]), (3, [2]), (4, [0, 1, 2]), (6, [1])):
        u.usable[k, lost], u.quality[k, lost] = False, Quality.MISSING
    u.usable[8, 1] = False  # no sample at this tick: the gain of all waits for it
    last, block = estimator.run(first, u)
    gains, n_x, s = table_of(estimator), len(plant.decay_1_s), plant.rows.sensors
    step = step_matrices(plant, 0.5)
    F, Q = augmented(plant, step)
    H, x, P = np.hstack([plant.rows.C[:s], np.zeros((s, 2))]), first.x_hat, first.P
    keys = set()
    for k in range(len(u)):
        x, P = F @ x, F @ P @ F.T + Q
        x[:n_x] += step.hold * (plant.B @ u.law_W[k] + plant.E @ u.z_start[k])
        x[:n_x] += step.ramp * (plant.E @ (u.z_end[k] - u.z_start[k]))
        if u.usable[k].any():
            key = (8 << s) + sum(1 << i for i in range(s) if u.quality[k, i] == Quality.GOOD)
            K = gains.K[list(gains.key).index(key)] * u.usable[k]
            nu = np.where(u.usable[k], u.y_degC[k] - H @ x - plant.rows.F[:s] @ u.z_end[k], 0.0)
            x, keep = x + K @ nu, np.eye(len(x)) - K @ H
            P = keep @ P @ keep.T + K @ np.diag(plant.noise_R_K2) @ K.T
            keys.add(key)
        np.testing.assert_allclose(block.heat_sigma_W[k], np.sqrt(np.diag(P)[n_x:]), rtol=1e-8)
        np.testing.assert_allclose(block.heat_W[k], u.law_W[k, plant.estimated] + x[n_x:], rtol=1e-8)
    assert len(keys) == 4
    assert set(gains.key.tolist()) == keys, "no gain is designed that is not used"
    np.testing.assert_allclose(last.P, P, rtol=0, atol=1e-9 * np.abs(P).max())


@pytest.mark.parametrize("silent", [0, 2])
def test_until_it_has_settled_a_constant_gain_is_the_kalman_filter(silent):
    plant = small(law_uncertainty=0.0)
    u = lively(plant, steps=8)
    for lost in (slice(0, silent), slice(5, 6)):
        u.usable[lost], u.quality[lost] = False, Quality.MISSING
    states, blocks = [], []
    for engine in ("compiled", "constant"):
        estimator = built(plant, "kalman", engine)
        state, block = estimator.run(estimator.initial(), u)
        states.append(state)
        blocks.append(block)
    for name in ("heat_W", "heat_sigma_W", "field_degC", "field_sigma_K", "innovation_K", "quality", "law_W"):
        ours, theirs = (getattr(b, name) for b in blocks)
        np.testing.assert_allclose(ours, theirs, rtol=1e-9, atol=1e-9, err_msg=name)
    np.testing.assert_allclose(states[1].P, states[0].P, rtol=0, atol=1e-9 * np.abs(states[0].P).max())
    assert (blocks[1].quality[:silent] == EstimateQuality.INVALID).all()
    assert np.isfinite(blocks[1].heat_W[silent:]).all()
    assert states[1].started


def same_sigma(block, gains):
    """At which steps the σ are those of the steady state, to the last bit."""
    return list((block.heat_sigma_W == gains.heat_sigma[0]).all(axis=1))


def spoiled(what, u):
    """Make step 8 one that is not like the others."""
    match what:
        case "missing":
            u.usable[8, 1], u.quality[8, 1] = False, Quality.MISSING
        case "no sample":
            u.usable[8, 1] = False
        case "longer":
            u.dt_s[8] = 0.6
        case "another rung":
            u.dt_s[8] = 1.0
        case "jump":
            u.law_jump_W[8, 2] = 100.0
        case "nut lost":
            u.degraded[8] = 2
        case "no law":
            u.law_W[8, 1] = np.nan
        case "no ambient":
            u.z_end[8, 0] = np.inf
        case "refused":
            u.y_degC[8, 1] += 1e6
        case "input degraded":
            u.degraded[8] = 1
        case "jump of a heat that is not estimated":
            u.law_jump_W[8, 1] = 100.0


@pytest.mark.parametrize("what", ["missing", "no sample", "longer", "another rung", "jump", "refused"])
@pytest.mark.parametrize(("kind", "engine"), KINDS)
def test_what_makes_the_covariance_move(kind, engine, what):
    """Up to that step σ are the steady ones. The Kalman filter's are larger then; the Luenberger gain is not
    the best, and may even be worse than that of fewer sensors.
    """
    plant = small(walk_W_sqrt_s=3.0)
    estimator = built(plant, kind, engine, gate_sigma=1e5 if what == "refused" else WIDE)
    u = lively(plant, steps=60)
    spoiled(what, u)
    state = settled(plant, estimator)
    gains = table_of(estimator)
    _, block = estimator.run(state, u)
    steady = same_sigma(block, gains)
    assert all(steady[:8])
    assert not steady[8]
    if kind == "kalman":
        assert (block.heat_sigma_W[8] > gains.heat_sigma[0]).any()


@pytest.mark.parametrize("what", ["input degraded", "jump of a heat that is not estimated"])
def test_what_leaves_the_covariance_as_it_is(what):
    plant = small()
    estimator = built(plant, "kalman", "constant")
    u = lively(plant)
    spoiled(what, u)
    _, block = estimator.run(settled(plant, estimator), u)
    assert all(same_sigma(block, table_of(estimator)))
    expected = np.full(STEPS, EstimateQuality.GOOD)
    expected[8] = EstimateQuality.DEGRADED if what == "input degraded" else EstimateQuality.GOOD
    np.testing.assert_array_equal(block.quality, expected)


@pytest.mark.parametrize(("share", "quiet"), [(0.9e-3, True), (1.1e-3, False)])
def test_a_jump_of_a_thousandth_of_its_variance_is_no_jump(share, quiet):
    """Beyond, that step is corrected by the gain of the moment, which is a little larger."""
    plant = small()
    estimator = built(plant, "kalman", "constant")
    gains, u, state = table_of(estimator), lively(plant, steps=10), settled(plant, estimator)
    u.law_jump_W[8, 2] = np.sqrt(share) * gains.heat_sigma[0, 1] / plant.law_uncertainty[1]
    _, block = estimator.run(state, u)
    heats = dense(plant, u, state.x_hat, gains.K[0])[2]
    apart = np.abs(block.heat_W / heats - 1)
    assert (apart[:8] < 1e-11).all()
    assert (apart[8] < 1e-11).all() == quiet


@pytest.mark.parametrize("what", ["no law", "no ambient"])
def test_a_step_that_is_no_number_is_left_out(what):
    plant = small()
    estimator = built(plant, "kalman", "constant")
    u = lively(plant)
    spoiled(what, u)
    _, block = estimator.run(settled(plant, estimator), u)
    assert list(np.flatnonzero(block.quality == EstimateQuality.INVALID)) == [8]
    assert np.isfinite(np.delete(block.heat_W, 8, axis=0)).all()


def test_a_sensor_that_was_refused_is_heard_again():
    """Its first good sample is no step of the steady state: it is counted."""
    plant = small()
    estimator = built(plant, "kalman", "constant")
    suspect = np.array([0.0, 2.0, 0.0])
    last, _ = estimator.run(replace(settled(plant, estimator), suspect=suspect), lively(plant, steps=3))
    np.testing.assert_array_equal(last.suspect, np.zeros(3))


def test_what_overflows_is_marked_as_not_known():
    plant = small()
    estimator = built(plant, "kalman", "constant")
    state = settled(plant, estimator)
    state.x_hat[-1] = np.inf
    u = lively(plant, steps=3)
    u.usable[:, :] = u.quality[:, :] == Quality.GOOD
    _, block = estimator.run(state, u)
    assert (block.quality == EstimateQuality.INVALID).all()
    assert np.isnan(block.heat_W).all()


@pytest.mark.parametrize(("kind", "engine"), KINDS)
@pytest.mark.parametrize(
    ("excess", "near"), [(0.01, True), (-0.01, True), (0.0, True), (0.04, False), (-0.04, False)]
)
def test_a_covariance_within_two_per_cent_has_settled(kind, engine, excess, near):
    """A step changes this one by little: what begins beside its steady value ends so."""
    plant = small(walk_W_sqrt_s=0.01)
    estimator = built(plant, kind, engine)
    state = settled(plant, estimator)
    _, block = estimator.run(replace(state, P=(1 + excess) * state.P), lively(plant, steps=1))
    assert same_sigma(block, table_of(estimator)) == [near]


@pytest.mark.parametrize(("kind", "engine"), KINDS)
def test_one_variance_that_is_off_is_enough(kind, engine):
    plant = small(walk_W_sqrt_s=0.01)
    estimator = built(plant, kind, engine)
    state = settled(plant, estimator)
    state.P[-1, -1] *= 1.04
    _, block = estimator.run(state, lively(plant, steps=1))
    assert same_sigma(block, table_of(estimator)) == [False]


def test_an_observer_settles_again_after_a_sample_was_missed():
    plant = small(walk_W_sqrt_s=3.0)
    estimator = built(plant, "kalman", "constant")
    u = lively(plant, steps=20)
    spoiled("missing", u)
    _, block = estimator.run(settled(plant, estimator), u)
    assert same_sigma(block, table_of(estimator)) == [True] * 8 + [False] + [True] * 11


def long_and_eventful(plant, steps=400):
    """Held and changing laws, an ambient that rises, and now and then a step that is not like the others."""
    u = lively(plant, steps=steps)
    u.law_W[:] = np.where((np.arange(steps) // 50 % 2 == 1)[:, None], u.law_W, 5.0)
    u.z_start[100:200] = u.z_end[100:200] = 21.0
    u.usable[[30, 31, 299], 1], u.quality[[30, 31, 299], 1] = False, Quality.MISSING
    u.usable[77, 0] = False
    u.dt_s[[140, 141]] = 0.6
    u.law_jump_W[170, 2] = 100.0
    u.y_degC[220:226, 2] += 1e5
    u.law_W[250, 1], u.z_end[260, 0], u.y_degC[270, 0] = np.nan, np.inf, np.nan
    u.degraded[[280, 281]] = 1, 2
    return u


@pytest.mark.parametrize(("kind", "engine", "moving"), [(*KINDS[0], ()), (*KINDS[0], (1,)), (*KINDS[1], ())])
def test_a_run_of_many_steps_is_runs_of_one(kind, engine, moving):
    """To the last bit, wherever the log is cut and a run of regular steps begins or ends."""
    plant = small(moving)
    u = long_and_eventful(plant)
    found = []
    for size in (len(u), 1, 7):
        estimator = built(plant, kind, engine, gate_sigma=1e4)
        state, blocks = settled(plant, estimator), []
        for begin in range(0, len(u), size):
            state, block = estimator.run(state, u.part(begin, begin + size))
            blocks.append(block)
        columns = {
            f.name: np.concatenate([getattr(b, f.name) for b in blocks]) for f in fields(blocks[0])[:-2]
        }
        found.append(columns | {"x": state.x_hat, "P": state.P})
    regular = same_sigma(blocks[0], table_of(estimator)), (found[0]["quality"] == EstimateQuality.GOOD).sum()
    assert all(regular[0])
    assert 300 < regular[1] < 395
    for others in found[1:]:
        for name, column in found[0].items():
            np.testing.assert_array_equal(others[name], column, err_msg=name)


def test_a_variance_that_no_report_shows_may_settle_late():
    """Two states: one is what is reported, the other takes hardly any part in it, or none at all."""
    P, rows = np.diag([4.0, 1e-6, 9.0]), np.array([[1.0, 0.5]])
    np.testing.assert_allclose(slack(P, rows, np.array([4.0])), [0.02 * 4.0, 0.005 * 16.0, 0.02 * 9.0])
    np.testing.assert_allclose(slack(P, 0 * rows, np.array([4.0])), 0.02 * np.diag(P))
