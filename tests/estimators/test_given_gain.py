"""Observers with given gains, step by step against dense matrices."""

from __future__ import annotations

from dataclasses import fields, replace

import numpy as np
import pytest

from observer.config.estimator import EstimatorSettings
from observer.estimators import build_estimator
from observer.frames import EstimateQuality, Quality
from observer.model.discretise import augmented, quantise, step_matrices
from tests.estimators.test_learning import ALL, a_day, set_up, textbook
from tests.logs.inputs import lively
from tests.logs.plants import AMBIENT_DEGC, at, small

KINDS = [("kalman", "constant"), ("luenberger", "compiled")]
WIDE = 1e9
STEPS = 24


def built(plant, kind, engine, gate_sigma=WIDE):
    return build_estimator(
        plant, EstimatorSettings(kind=kind, engine=engine, bandwidth_1_s=0.005, gate_sigma=gate_sigma)
    )


def settled(plant, estimator):
    """A state long after the start, with a covariance of its own."""
    n_x = len(plant.decay_1_s)
    n = n_x + int(plant.estimated.sum())
    rng = np.random.default_rng(7)
    x = rng.normal(size=n)
    x[:n_x] += AMBIENT_DEGC * plant.uniform
    root, verdict = 0.3 * rng.normal(size=(n, n)), estimator.initial().verdict.copy()
    verdict["runs_s"] = 1e9
    return replace(
        estimator.initial(),
        x_hat=x,
        P=root @ root.T,
        started=True,
        time_s=0.0,
        verdict=verdict,
        gain_sensors=(1 << plant.rows.sensors) - 1,
    )


def dense(plant, estimator, u, state):
    """x⁺ = x_pred + K ν and P⁺ = (I − K C) P (I − K C)ᵀ + K R Kᵀ: columns of all steps, the keys, and P.

    A good sensor without a sample at a tick keeps its gain, and its column is left out.
    """
    found, keys, n_x, s = [], set(), len(plant.decay_1_s), plant.rows.sensors
    x, P, gains = state.x_hat, state.P, estimator._bank.gains
    for k in range(len(u)):
        now = at(plant, u, k)
        step = step_matrices(plant, float(quantise(u.dt_s[k])))
        F, Q = augmented(now, step)
        P = P.copy()
        P[n_x:, n_x:] += np.diag((plant.jump_uncertainty * u.law_jump_W[k][plant.estimated]) ** 2)
        x, P = F @ x, F @ P @ F.T + Q
        x[:n_x] += step.hold * (now.B @ u.law_W[k] + plant.E @ u.z_start[k])
        x[:n_x] += step.ramp * (plant.E @ (u.z_end[k] - u.z_start[k]))
        H = np.hstack([now.rows.C[:s], np.zeros((s, len(x) - n_x))])
        nu = np.where(u.usable[k], u.y_degC[k] - H @ x - plant.rows.F[:s] @ u.z_end[k], np.nan)
        nu_sigma = np.where(u.usable[k], np.sqrt(np.diag(H @ P @ H.T) + plant.noise_R_K2), np.nan)
        if u.usable[k].any():
            key = (8 << s) + sum(1 << i for i in range(s) if u.quality[k, i] == Quality.GOOD)
            K = gains.K[list(gains.key).index(key)] * u.usable[k]
            x, left = x + K @ np.nan_to_num(nu), np.eye(len(x)) - K @ H
            P = left @ P @ left.T + K @ np.diag(plant.noise_R_K2) @ K.T
            keys.add(key)
        rows = now.rows.C[s:]
        field_sigma = np.sqrt(np.einsum("ra,ab,rb->r", rows, P[:n_x, :n_x], rows))
        heat = u.law_W[k, plant.estimated] + x[n_x:]
        field = rows @ x[:n_x] + plant.rows.F[s:] @ u.z_end[k]
        found.append((nu, nu_sigma, heat, np.sqrt(np.diag(P)[n_x:]), field, field_sigma))
    return [np.array(part) for part in zip(*found, strict=True)], keys, x, P


@pytest.mark.parametrize("moving", [(), (1,), (0,)])
@pytest.mark.parametrize(("kind", "engine"), KINDS)
def test_a_given_gain_corrects_as_dense_matrices_do(kind, engine, moving):
    plant = small(moving, walk_W_sqrt_s=0.01)
    estimator = built(plant, kind, engine)
    u = lively(plant, nut_m=0.3 + 0.2 * np.sin(np.arange(STEPS)))
    loses = kind == "luenberger"  # where the sensors change, the constant gain is that of the Kalman filter
    for k, lost in ((2, [0]), (3, [2]), (4, [0, 1, 2]), (6, [1])) if loses else ():
        u.usable[k, lost], u.quality[k, lost] = False, Quality.MISSING
    u.usable[8, 1] = False  # no sample at this tick: the gain of all waits for it
    u.law_jump_W[12, 2] = 100.0 if loses else 0.0
    first = settled(plant, estimator)
    last, block = estimator.run(first, u)
    columns, keys, x, P = dense(plant, estimator, u, first)
    names = ("innovation_K", "innovation_sigma_K", "heat_W", "heat_sigma_W", "field_degC", "field_sigma_K")
    for name, expected in zip(names, columns, strict=True):
        atol = 1e-9 * np.nanmax(np.abs(expected))  # rounding of sums in another order
        np.testing.assert_allclose(getattr(block, name), expected, rtol=0, atol=atol, err_msg=name)
    np.testing.assert_allclose(last.x_hat, x, rtol=0, atol=1e-9 * np.abs(x).max())
    np.testing.assert_allclose(last.P, P, rtol=0, atol=1e-9 * np.abs(P).max())
    assert len(keys) == (4 if loses else 1)
    assert set(estimator._bank.gains.key.tolist()) == keys, "no gain is designed that is not used"


def test_what_is_only_considered_widens_sigma_and_keeps_its_value():
    """The textbook's consider filter with the given gain, on a machine that is only roughly known."""
    plant, _, u = set_up(ALL, 300, a_day(warm=True))
    settings = EstimatorSettings(kind="luenberger", bandwidth_1_s=0.003, period_s=1.0, gate_sigma=WIDE)
    estimator = build_estimator(plant, settings)
    first, _ = estimator.run(estimator.initial(), u.part(0, 1))
    last, _ = estimator.run(first, u.part(1))
    x, P, around = textbook(estimator.plant, u.part(1), first, estimator._bank.gains.K[0])
    scale = np.sqrt(np.diag(first.P)) + 1e-12
    np.testing.assert_allclose(last.x_hat / scale, x / scale, rtol=0, atol=1e-7 * np.abs(x / scale).max())
    np.testing.assert_allclose(last.P / np.outer(scale, scale), P / np.outer(scale, scale), rtol=0, atol=1e-7)
    np.testing.assert_allclose(last.around, around, rtol=0, atol=1e-8 * np.abs(around).max())
    L = len(plant.learning.arrays.kind)
    assert (last.x_hat[-L:] == 0.0).all()
    assert np.diag(last.P)[-L:] == pytest.approx(plant.learning.arrays.sigma**2)


@pytest.mark.parametrize("silent", [0, 2])
def test_after_a_start_a_constant_gain_is_the_kalman_filter(silent):
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


def test_a_constant_gain_goes_over_to_that_of_other_sensors_without_a_leap():
    """A gain made for the covariance of other sensors, applied at once, throws heats far off."""
    plant = small(walk_W_sqrt_s=3.0)
    estimator, u = built(plant, "kalman", "constant"), lively(plant, steps=60)
    u.y_degC[:] = 20.0
    u.usable[30:, 2], u.quality[30:, 2] = False, Quality.MISSING
    filtered = built(plant, "kalman", "compiled")
    start, _ = filtered.run(filtered.initial(), u.part(0, 1))
    state = replace(settled(plant, estimator), x_hat=start.x_hat, P=start.P)
    before, _ = estimator.run(replace(state, verdict=start.verdict), u.part(1, 30))
    _, block = estimator.run(before, u.part(30))
    _, expected = filtered.run(before, u.part(30))
    np.testing.assert_allclose(block.heat_W, expected.heat_W, rtol=0, atol=0.05 * expected.heat_sigma_W.min())


@pytest.mark.parametrize("what", ["no law", "no ambient"])
def test_a_step_that_is_no_number_is_left_out(what):
    plant = small()
    estimator = built(plant, "kalman", "constant")
    u = lively(plant)
    (u.law_W if what == "no law" else u.z_end)[8, 0] = np.nan
    _, block = estimator.run(settled(plant, estimator), u)
    assert list(np.flatnonzero(block.quality == EstimateQuality.INVALID)) == [8]
    assert np.isfinite(np.delete(block.heat_W, 8, axis=0)).all()


def test_a_sensor_that_was_refused_is_heard_again():
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
    """To the last bit, wherever the log is cut."""
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
    assert 300 < (found[0]["quality"] == EstimateQuality.GOOD).sum() < 395
    for others in found[1:]:
        for name, column in found[0].items():
            np.testing.assert_array_equal(others[name], column, err_msg=name)
