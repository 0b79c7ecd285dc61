"""What changes of the readings make of a history: beside the history of the changed log, in few steps."""

from __future__ import annotations

import numpy as np
import pytest

from observer.config.estimator import EstimatorSettings
from observer.estimators.specification import Columns, columns_in_place, transition
from observer.history.smoother import smooth_changes, smooth_heats
from observer.history.tolerances import _roughly_known, changes_within
from observer.kernels.codes import REJECTED
from observer.model.discretise import quantise, step_matrices
from observer.model.learning import Nuisance
from observer.model.simulate import start_from_sensors
from tests.bits.shared import COUPLINGS
from tests.logs.inputs import driven
from tests.logs.plants import described

OPEN_GATE = EstimatorSettings(gate_sigma=1e9)
LINEAR = [effect for name in ("speed_loss", "films", "body_at_the_nut", "lags") for effect in COUPLINGS[name]]


def logged(effects, steps=20):
    """A plant with a nut that moves, and a log with a step without a sensor and one that is no number."""
    tables = {"effect": effects} if effects else {}
    _, plant = described(3, 3, 3, moving=True, **tables)
    u = driven(plant, steps, missing=0.2, uneven=True, loss=bool(effects))
    u.usable[7] = False
    u.z_end[11, 0] = np.nan
    u.quality[~u.usable] = REJECTED
    return plant, u


def drifts(K, s):
    """Two changes of the sensors (K, s, 2), nothing at first: the start's level is what they say."""
    t = np.linspace(0.0, 1.0, K)[:, None]
    return np.stack([0.4 * t * np.eye(s)[0], 0.5 * t**2 * np.linspace(-1.0, 1.0, s)], axis=2)


@pytest.mark.parametrize("effects", [[], LINEAR], ids=["by itself", "coupled"])
def test_changes_are_what_the_history_of_the_changed_log_has_beside_that_of_the_log(effects):
    """Σ⁻¹ times the readings about their mean is what the smoother leaves of them, over their variance."""
    plant, u = logged(effects)
    D = drifts(len(u), plant.rows.sensors)
    information, heat_W = smooth_changes(plant, OPEN_GATE, [u], D)
    own = smooth_heats(plant, OPEN_GATE, [u])

    def left(history):
        """Dᵀ Σ⁻¹ (y − ŷ)."""
        weighed = np.nan_to_num(history.residual_K) / plant.noise_R_K2
        return np.einsum("kic,ki->c", D, weighed)

    np.testing.assert_allclose(information[:, 0], left(own), rtol=1e-6)
    for c in range(D.shape[2]):
        other = smooth_heats(plant, OPEN_GATE, [u._replace(y_degC=u.y_degC + D[:, :, c])])
        moved_W = other.heat_W - own.heat_W
        here = np.isfinite(moved_W).all(axis=1)
        assert here.sum() == len(u) - 1, "one step is no number"
        largest_W = np.abs(moved_W[here]).max()
        assert largest_W > 1.0
        np.testing.assert_allclose(heat_W[here, :, c], moved_W[here], rtol=0, atol=1e-7 * largest_W)
        np.testing.assert_allclose(information[:, 1 + c], left(other) - left(own), rtol=1e-6)


def by_hand(plant, u, x):
    """What one standard deviation of each tolerance does to the sensors (K, s, L), on full matrices: the open
    loop's state x (n_x,), and behind it how far each parameter of the machine has moved that.
    """
    a, s, n_x = plant.learning.arrays, plant.rows.sensors, len(x)
    D, S, n = np.zeros((len(u), s, len(a.kind))), np.zeros((n_x, a.machine)), n_x + int(plant.estimated.sum())
    lags, (slow_degC, was_degC) = np.flatnonzero(a.kind == Nuisance.LAG), np.zeros((2, len(a.kind)))
    for k in range(len(u)):
        B, C = columns_in_place(plant, u, k)
        if k > 0:
            law_W = u.law_W[k]
            c = a.drives(x, B, law_W, law_W, u.z_start[k])[:, : a.machine]
            G = step_matrices(plant, float(quantise(u.dt_s[k]))).hold[:, None] * c
            step = transition(plant, u, k, np.pad(x, (0, n - n_x + len(a.kind))), Columns(B, G))
            S = step.F[:n_x, :n_x] @ S + step.F[:n_x, n : n + a.machine] * a.sigma[: a.machine]
            x = step.F[:n_x, :n_x] @ x + step.forced[:n_x]
        now_degC = C[:s] @ x + plant.rows.F[:s] @ u.z_end[k]
        if k == 0:
            slow_degC[:] = was_degC[:] = now_degC[a.of]
        D[k, :, : a.machine] = C[:s] @ S
        D[k, a.of[a.machine :], np.arange(a.machine, len(a.kind))] = (a.entries(x, u.z_end[k]) * a.sigma)[
            a.machine :
        ]
        for q in lags:  # a lag of the first order behind readings that go straight from step to step
            share = u.dt_s[k] / a.lag_s[q]
            fade = np.exp(-share)
            slope = (now_degC[a.of[q]] - was_degC[q]) / share if k > 0 else 0.0
            slow_degC[q] = now_degC[a.of[q]] - slope + fade * (slow_degC[q] - was_degC[q] + slope)
            was_degC[q] = now_degC[a.of[q]]
            D[k, a.of[q], q] = (slow_degC[q] - was_degC[q]) / a.lag_s[q] * a.sigma[q]
    return D


@pytest.mark.parametrize("effects", [[], LINEAR], ids=["by itself", "coupled"])
@pytest.mark.parametrize("gain", [0.0, 0.02])
def test_tolerances_change_readings_as_full_matrices_have_it(effects, gain):
    """In a log whose steps are all computed; what a gain changes follows from the same field."""
    looks = {"name": "t2", "channel": "t2_degC", "position_m": 0.5, "shows": 0.4, "shows_tolerance": 0.2}
    touch = [{"name": f"t{i}", "channel": f"t{i}_degC", "position_m": x} for i, x in ((1, 0.05), (3, 0.95))]
    sensors = [touch[0], looks, touch[1]]
    config, made = described(3, 3, 3, moving=True, effect=effects, tolerance={"gain": gain}, sensor=sensors)
    u = driven(made, 20, dt_s=2.0, uneven=True, loss=True).sensors_only(3)
    u.law_W[:] += 5.0
    found = changes_within(config, [u.part(0, 9), u.part(9)], u.law_W[:, made.estimated])
    plant, learnt = _roughly_known(config)
    first = start_from_sensors(plant, u.y_degC[0], plant.noise_R_K2, u.law_W[0], u.z_end[0])
    expected_K = by_hand(plant, u, first)
    L = expected_K.shape[2]
    largest_K = np.abs(expected_K).max(axis=(0, 1))
    assert {int(kind) for kind in plant.learning.arrays.kind} >= {
        Nuisance.CONVECTION,
        Nuisance.END,
        Nuisance.PLACE,
        Nuisance.LAG,
        Nuisance.GAIN,
    }
    assert (largest_K > 1e-4).all()
    np.testing.assert_allclose(
        found.sensor_K[:, :, :L] / largest_K, expected_K / largest_K, rtol=0, atol=1e-9
    )
    assert found.learnt[:L].tolist() == learnt.tolist()
    assert found.sensor_K.shape[2] == L + (3 if gain > 0.0 else 0)
    assert not found.sensor_K[:, :, L + 1 : L + 2].any()  # its own tolerance is no common one
