"""What an observer with a fixed gain allows for: its arithmetic, and what comes of machines that are off."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from campaigns.learning.trial import FIRST_SEED, KNOWN
from observer.align.aligner import frames_of_log
from observer.estimate.pipeline import MachineModel
from observer.estimators.design.gains import everything
from observer.frames import EstimateBlock
from observer.model.discretise import augmented, quantise, step_matrices
from tests.estimators.test_learning import FOLLOWS_S, drives, readings
from tests.learning.cover import judged, log_of
from tests.learning.machines import Rough, config_of, day, draw

KIND = {"luenberger": 'kind = "luenberger"\n', "constant": 'engine = "constant"\n'}


@cache
def a_day():
    return day(draw(1, 0, Rough()), 1, 0, "a", warm=True)


def set_up(more, steps):
    """The machine of a configuration, its estimator, and the inputs of the first steps of a log."""
    machine = MachineModel.of(config_of(more=more), learns=True)
    frames = next(iter(frames_of_log(log_of(a_day()), machine.plan)))
    _, u = machine.drive.run(machine.drive.initial(), frames)
    return machine.plant, machine.estimator(), u.part(0, steps)


def parted(plant, around):
    """The field that effects are taken along, and S (n, L), of a state's `around`."""
    n = len(plant.decay_1_s) + int(plant.estimated.sum())
    first = n + 2 * plant.rows.sensors
    return around[:first].copy(), around[first:].reshape(n, -1).copy()


def by_definition(plant, estimator, u, state):
    """x, S and `around` after the steps of u, on full matrices: e⁺ = (I - K C)(A e + c θ) - K h θ."""
    a, s, n_x = plant.learning.arrays, plant.rows.sensors, len(plant.decay_1_s)
    x, (around, S), t = state.x_hat.copy(), parted(plant, state.around), a.machine
    n, K = len(x), {}
    for k in range(len(u)):
        B, C = plant.B.copy(), plant.rows.C[:s].copy()
        for i, source in enumerate(plant.moving):
            B[:, source.index] = u.moving_B[k, i]
            C[:, plant.modes + source.index] = u.moving_C[k, i, :s]
        here, step = replace(plant, B=B), step_matrices(plant, float(quantise(u.dt_s[k])))
        F = augmented(here, step)[0]
        G = step.hold[:, None] * drives(plant, B, u.law_W[k], u.z_start[k], around)
        known = np.zeros(n)
        known[:n_x] = step.hold * (B @ u.law_W[k] + plant.E @ u.z_start[k])
        known[:n_x] += step.ramp * (plant.E @ (u.z_end[k] - u.z_start[k]))
        x, around[:n], S = F @ x + known, F @ around[:n] + known, F @ S
        S[:n_x, :t] += G * a.sigma[:t]
        H = np.hstack([C, np.zeros((s, n - n_x))])
        if step.dt_s not in K:  # a fixed gain: one for each length of a step
            K[step.dt_s] = estimator.gain(step, everything(plant))
        entries = readings(plant, u, k, around, C, u.dt_s[k]) * a.sigma[t:]
        x = x + K[step.dt_s] @ (u.y_degC[k] - H @ x - plant.rows.F[:s] @ u.z_end[k])
        S = S - K[step.dt_s] @ (H @ S + np.hstack([np.zeros((s, t)), entries]))
        around[:n] += -np.expm1(-u.dt_s[k] / FOLLOWS_S) * (x - around[:n])
    return x, S, around


def test_what_is_carried_is_what_parameters_do():
    plant, estimator, u = set_up("[estimator]\n" + KIND["luenberger"], 40)
    first, _ = estimator.run(estimator.initial(), u.part(0, 1))
    last, block = estimator.run(first, u.part(1))
    assert (block.sensor_quality == 0).all()
    x, S, around = by_definition(plant, estimator, u.part(1), first)
    carried_around, carried_S = parted(plant, last.around)
    np.testing.assert_allclose(last.x_hat, x, rtol=0, atol=1e-9 * np.abs(x).max())
    np.testing.assert_allclose(carried_S, S, rtol=0, atol=1e-9 * np.abs(S).max())
    np.testing.assert_allclose(carried_around, around, rtol=0, atol=1e-8 * np.abs(around).max())
    n_x = len(plant.decay_1_s)
    variance = np.diag(last.P)[n_x:] + (S[n_x:] ** 2).sum(axis=1)
    np.testing.assert_allclose(block.heat_sigma_W[-1], np.sqrt(variance), rtol=1e-9)
    rows = plant.rows.C[plant.rows.field_slice].copy()
    rows[:, plant.modes + plant.moving[0].index] = u.moving_C[-1, 0, plant.rows.field_slice]
    square = np.einsum("ra,ab,rb->r", rows, last.P[:n_x, :n_x], rows) + ((rows @ S[:n_x]) ** 2).sum(axis=1)
    np.testing.assert_allclose(block.field_sigma_K[-1], np.sqrt(square), rtol=1e-9)


def test_the_first_correction_takes_the_filters_gain():
    """At the start the prior's gain corrects: S = -K h of it, with h the offsets alone in a field at rest."""
    plant, estimator, u = set_up("[estimator]\n" + KIND["luenberger"], 1)
    state, _ = estimator.run(estimator.initial(), u)
    a, s, n_x = plant.learning.arrays, plant.rows.sensors, len(plant.decay_1_s)
    H = np.zeros((s, len(state.x_hat)))
    H[:, :n_x] = plant.rows.C[:s]
    for i, source in enumerate(plant.moving):
        H[:, plant.modes + source.index] = u.moving_C[0, i, :s]
    P = np.zeros((len(state.x_hat), len(state.x_hat)))
    P[:n_x, :n_x] = plant.prior_P
    P[n_x:, n_x:] = np.diag(plant.initial_sigma_W**2)
    K = P @ H.T @ np.linalg.inv(H @ P @ H.T + np.diag(plant.noise_R_K2))
    offset = np.flatnonzero(a.kind == 6)
    _, S = parted(plant, state.around)
    np.testing.assert_allclose(S[:, offset], -K * a.sigma[offset], rtol=0, atol=1e-7 * np.abs(K).max())


@pytest.mark.parametrize("kind", KIND)
def test_many_steps_are_many_runs_of_one(kind):
    _, estimator, u = set_up("[estimator]\n" + KIND[kind], 200)
    whole, block = estimator.run(estimator.initial(), u)
    state = estimator.initial()
    for k in range(len(u)):
        state, one = estimator.run(state, u.part(k, k + 1))
        for name in EstimateBlock.__dataclass_fields__:
            np.testing.assert_array_equal(getattr(one, name)[0], getattr(block, name)[k], err_msg=name)
    np.testing.assert_array_equal(state.around, whole.around)


@pytest.mark.parametrize("kind", KIND)
def test_what_is_allowed_for_changes_sigma_and_no_estimate(kind):
    known, plain, u = set_up(KNOWN + KIND[kind], 300)
    _, allowing, v = set_up("[estimator]\n" + KIND[kind], 300)
    assert known.learning is None
    _, one = plain.run(plain.initial(), u)
    _, other = allowing.run(allowing.initial(), v)
    agreed = (one.sensor_quality == other.sensor_quality).all(axis=1)
    until = len(agreed) if agreed.all() else int(np.argmin(agreed))
    assert until > 20
    np.testing.assert_array_equal(one.heat_W[:until], other.heat_W[:until])
    assert (other.heat_sigma_W[:until] >= one.heat_sigma_W[:until]).all()
    near = int(np.argmin(one.field_sigma_K[until - 1]))  # beside a sensor, which may be off by 0.3 K for good
    assert other.field_sigma_K[until - 1, near] > 0.8 * 0.3 > 1.5 * one.field_sigma_K[until - 1, near]


@pytest.mark.slow
def test_rough_machines_are_covered():
    """Four machines of the campaign's, half of them warm; without what is allowed for, a third is covered."""
    covered = {"known": [], "allowed": []}
    for number in range(4):
        one = day(
            draw(FIRST_SEED, number, Rough()), FIRST_SEED, number, "abc"[number % 3], warm=number % 2 == 1
        )
        for name, more in (("known", KNOWN), ("allowed", "[estimator]\n")):
            found = judged(config_of(more=more + KIND["luenberger"]), one)
            covered[name].append([found[q][1] for q in ("heats", "nut", "field")])
    assert (np.mean(covered["allowed"], axis=0) > 0.85).all()
    assert (np.mean(covered["known"], axis=0) < np.mean(covered["allowed"], axis=0)).all()
