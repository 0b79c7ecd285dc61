"""What parameters do to a state beside couplings, against full matrices; and when a machine stands."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from observer.estimators.kalman import KalmanEstimator
from observer.estimators.specification import Belief, Columns, columns_in_place, predict, transition
from observer.kernels.codes import STILL
from observer.kernels.learning import FOLLOWS_S
from observer.model.discretise import quantise, step_matrices
from observer.model.learning import Nuisance
from tests.bits.shared import COUPLINGS, EVERY, learning
from tests.logs.inputs import driven
from tests.logs.plants import described

LINEAR = [
    e
    for name in ("speed_loss", "films", "body_at_an_end", "body_at_the_nut", "lags")
    for e in COUPLINGS[name]
]


TIED = {
    "node": [{"name": "body", "capacity_J_K": 600.0}],
    "link": [
        {"between": ["body", "ambient"], "conductance_W_K": 0.5},
        {"between": ["nut", "body"], "conductance_W_K": 8.0},
    ],
}


def passed_in_place(plant, B, x, z):
    """What each link to a nut adds to dx/dt, (n_x, k), if it conducts as much again, the nut in place."""
    c, columns = plant.coupling, []
    for i, source in enumerate(c.links.source):
        foot = c.place_gain[source] * B[:, source]
        modes = np.arange(len(x)) < plant.modes
        under = c.under_C[source] + c.conductance_W_m * np.where(modes, foot, 0.0)
        apart_K = (c.links.C[i] - under) @ x - c.under_F[source] @ z
        passed = c.links.conductance_W_K[i] * apart_K * (foot - c.links.B[i])
        e = slice(*c.spreads.first[source : source + 2])  # and place by place under the stroke that it sweeps
        row, into = c.spreads.row[e], c.spreads.into[e]
        size = c.place_gain[source] ** 2 * (B[: plant.modes, source] @ B[: plant.modes, source])
        now, at_rest = ((c.spreads.swept[source] / s) ** 2 for s in (size, c.spreads.at_rest[source]))
        share = np.clip((now - at_rest) / (1.0 - at_rest), 0.0, 1.0)
        part = c.links.conductance_W_K[i] / c.links.conductance_W_K[c.links.source == source].sum()
        shapes = into.T @ (share * part * c.spreads.rate_1_s[e] * (row @ x[: row.shape[1]]))
        columns.append(passed - np.pad(shapes, (0, len(x) - len(shapes))))
    return np.array(columns).T


@pytest.mark.parametrize(
    ("effects", "beside"), [([], {}), (LINEAR, {}), ([], TIED)], ids=["by itself", "coupled", "tied"]
)
def test_parameters_act_where_the_field_followed_is(effects, beside):
    """Nothing is measured; heats and parameters are off by about their priors."""
    config, plant, u = learning([*EVERY, "link"], steps=6, effect=effects, **beside)
    u = u._replace(loss_1_s=np.full(len(u), 1e-3))
    u.usable[1:] = False
    u.law_W[:] = 10.0 + np.arange(len(u))[:, None]
    estimator, rng = KalmanEstimator(plant, config.estimator), np.random.default_rng(2)
    first, _ = estimator.run(estimator.initial(), u.part(0, 1))
    a, n_x, m_e = plant.learning.arrays, len(plant.decay_1_s), int(plant.estimated.sum())
    assert (a.link >= 0).sum() == len(beside.get("node", []))
    n, around = n_x + m_e, first.around.copy()
    x = first.x_hat + np.sqrt(np.diag(first.P)) * rng.standard_normal(len(first.x_hat))
    around[:n] = first.x_hat[:n] + 0.3 * np.sqrt(np.diag(first.P))[:n] * rng.standard_normal(n)
    last, _ = estimator.run(replace(first, x_hat=x, around=around), u.part(1))
    belief, here = Belief(x, first.P), around[:n]
    for k in range(1, len(u)):
        B, _ = columns_in_place(plant, u, k)
        heat_W = u.law_W[k].copy()
        heat_W[plant.estimated] += here[n_x:]
        c = a.drives(here[:n_x], B, u.law_W[k], heat_W, u.z_start[k])[:, : a.machine]
        if beside:
            c[:, a.link[: a.machine] == 0] = passed_in_place(plant, B, here[:n_x], u.z_start[k])
        G = step_matrices(plant, float(quantise(u.dt_s[k]))).hold[:, None] * c
        step = transition(plant, u, k, belief.x, Columns(B, G))
        here = step.F[:n, :n] @ here + step.forced[:n]
        here[:n_x] += G @ belief.x[n : n + a.machine]
        belief = predict(belief, step.F, step.forced, step.Q)
        here += -np.expm1(-u.dt_s[k] / FOLLOWS_S) * (belief.x[:n] - here)
    scale = np.sqrt(np.diag(first.P)) + 1e-9
    np.testing.assert_allclose(last.x_hat / scale, belief.x / scale, rtol=0, atol=1e-8)
    np.testing.assert_allclose(last.around[:n] / scale[:n], here / scale[:n], rtol=0, atol=1e-8)
    np.testing.assert_allclose(
        last.P / np.outer(scale, scale), belief.P / np.outer(scale, scale), rtol=0, atol=1e-8
    )


@pytest.mark.parametrize(("part", "stands"), [(0.97, True), (-0.97, True), (1.03, False), (-1.03, False)])
def test_a_machine_stands_while_no_sensor_is_three_sigma_off_the_air(part, stands):
    """σ² is that of the sensor's offset, of the air's, and of noise; where it stands its heats are known."""
    config, plant = described(3, 3, 3, moving=True, learns=True, estimator={"learn": EVERY})
    a, u = plant.learning.arrays, driven(plant, 1)
    air_K, offset_K = (a.sigma[a.kind == kind] for kind in (Nuisance.AMBIENT, Nuisance.OFFSET))
    sigma_K = np.sqrt(offset_K[1] ** 2 + air_K[0] ** 2 + plant.noise_R_K2[1])
    u.y_degC[0] = u.z_end[0, plant.known.ambient]
    u.y_degC[0, 1] += 3.0 * part * sigma_K
    estimator = KalmanEstimator(plant, config.estimator)
    _, block = estimator.run(estimator.initial(), u)
    share = block.heat_sigma_W[0] / plant.initial_sigma_W
    np.testing.assert_allclose(share, STILL if stands else 1.0, rtol=0.05)
