"""The sweeps are the plant's own map from heats to readings, and its transpose."""

from dataclasses import replace

import numpy as np
import pytest

from observer.errors import UserError
from observer.history.sweeps import Sweeps, readings
from observer.model.simulate import simulate
from tests.bits.shared import COUPLINGS
from tests.history.known_heats import logged
from tests.logs.inputs import driven
from tests.logs.plants import described

LINEAR = [e for name in ("speed_loss", "films", "body_at_the_nut", "lags") for e in COUPLINGS[name]]
MACHINES = pytest.mark.parametrize("effects", [[], LINEAR], ids=["by itself", "coupled"])


def moving(effects, steps=40):
    """A machine whose nut moves, uneven steps, missing samples."""
    _, plant = described(4, 3, 3, moving=True, effect=effects)
    return plant, driven(plant, steps, dt_s=2.0, uneven=True, missing=0.2, loss=True)


@MACHINES
@pytest.mark.parametrize("order", [0, 1])
def test_a_sweep_forward_is_what_the_plant_does_with_these_heats(effects, order):
    plant, u = moving(effects)
    sweeps = Sweeps(plant, u, order)
    V = np.random.default_rng(3).standard_normal((sweeps.unknowns, 1))
    V[: sweeps.start] = 0.0
    heat_W, rows_K = (values[:, :, 0] for values in sweeps.forward(V))
    none = np.zeros_like(u.z_end)
    only = plant.sensors_only()
    seen = u.sensors_only(only.rows.sensors)._replace(law_W=heat_W, z_start=none, z_end=none)
    seen = seen._replace(loss_degC=np.zeros(len(u)))
    expected_K = simulate(only, np.zeros(len(plant.decay_1_s)), seen.part(1))[1]
    np.testing.assert_allclose(rows_K[1:], expected_K, rtol=0, atol=1e-9 * np.abs(expected_K).max())


@MACHINES
@pytest.mark.parametrize("order", [0, 1])
def test_a_sweep_back_is_its_transpose(effects, order):
    plant, u = moving(effects, 200)  # more step lengths and rows than one table of steps holds
    u.dt_s[1:] += 1e-3 * np.arange(199)
    sweeps, rng = Sweeps(plant, u, order), np.random.default_rng(1)
    V, e = rng.standard_normal((sweeps.unknowns, 3)), rng.standard_normal((200, 3, 3))
    there = np.einsum("ksc,ksc->c", sweeps.forward(V)[1], e)
    back = np.einsum("nc,nc->c", V, sweeps.adjoint(e))
    np.testing.assert_allclose(there, back, rtol=1e-10)


def test_the_heats_of_a_history_have_the_priors_spread():
    plant, u, _ = logged(heat_rate_1_s=2e-3, walk_W_sqrt_s=1.0)
    sweeps = Sweeps(plant, u, 1)
    heat_W, _ = sweeps.forward(np.random.default_rng(2).standard_normal((sweeps.unknowns, 4000)))
    t_s = u.time_s - u.time_s[0]
    variance = 30.0**2 * np.exp(-4e-3 * t_s) + (1.0 - np.exp(-4e-3 * t_s)) / 4e-3
    np.testing.assert_allclose(heat_W[1:].var(axis=2), variance[1:, None] * np.ones(3), rtol=0.12)


def test_the_largest_eigenvalue_is_that_of_the_dense_matrix():
    plant, u, _ = logged(steps=40)
    log, sweeps = readings(plant, [u], 1), Sweeps(plant, u, 1)
    dense = sweeps.forward(np.eye(sweeps.unknowns))[1] * log.weight_1_K[:, :, None]
    dense = dense.reshape(-1, sweeps.unknowns)
    largest = np.linalg.eigvalsh(dense.T @ dense)[-1]
    assert 0.5 * largest < sweeps.largest(log.weight_1_K) <= 1.001 * largest


def test_rows_before_the_first_measurement_are_left_out_and_a_log_without_three_is_refused():
    plant, u, _ = logged()
    u.usable[:7] = False
    log = readings(plant, [u.part(0, 50), u.part(50)], 1)
    assert log.first == 7
    assert len(log.rise_K) == len(u) - 7
    with pytest.raises(UserError, match="fewer than three steps"):
        readings(plant, [u.part(0, 2)], 1)


def test_what_the_laws_explain_is_not_in_the_readings_of_order_1_alone():
    plant, u, heat_W = logged(missing=0.0, noise_K=0.0)
    known = u._replace(law_W=heat_W)
    plant = replace(plant, law_uncertainty=np.ones(3))
    small, large = (np.abs(readings(plant, [known], order).rise_K).max() for order in (1, 0))
    assert small < 0.02, "the lags begin at rest under their laws, and that log's did not"
    assert large > 1.0
