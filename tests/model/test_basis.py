"""A plant in its own modes is the plant it was."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from observer.model.build import build_plant
from observer.model.extend import with_learning
from observer.model.generator import APART, diagonalised, frozen, generator, on_the_screw
from observer.model.rod.moving import columns_at
from observer.model.simulate import start
from tests.bits.shared import COUPLINGS, EVERY
from tests.logs.plants import described
from tests.model.unturned import unturned

LASTING = ["films", "body_at_an_end", "lags", "everything"]


def before_and_after(effects, *, learns=False, moving=True, last=False):
    """The plant as it is put together, what lasts of its couplings, and the plant in its own modes; its nut
    may be the `last` of its sources.
    """
    config, _ = described(3, 3, 3, moving=moving, effect=COUPLINGS[effects], estimator={"learn": EVERY})
    if last:
        config = config.remade(config.model_dump(exclude_unset=True) | {"source": _turned(config)})
    plant, constant, full, modes = unturned(config)
    if learns:
        plant = with_learning(plant, config, full, modes)
    return plant, constant, diagonalised(plant, constant)


def _turned(config):
    return [source.model_dump(exclude_unset=True) for source in reversed(config.source)]


@pytest.mark.parametrize("effects", LASTING)
def test_the_modes_are_those_of_the_generator(effects):
    plant, constant, own = before_and_after(effects)
    A = constant.A - np.diag(plant.decay_1_s)
    alike = len(plant.source_names) + len(constant.follow)
    rebuilt = own.basis.V @ np.diag(-own.decay_1_s) @ own.basis.inverse
    np.testing.assert_allclose(rebuilt, A, rtol=0, atol=1.01 * APART * alike * np.abs(A).max())
    np.testing.assert_array_equal(np.diag(own.basis.V), 1.0)
    np.testing.assert_array_equal(own.basis.decay_1_s, plant.decay_1_s)


@pytest.mark.parametrize("effects", LASTING)
def test_what_is_read_and_what_acts_stay(effects):
    plant, constant, own = before_and_after(effects)
    V = own.basis.V
    np.testing.assert_allclose(V @ own.B, plant.B, atol=1e-9 * np.abs(plant.B).max())
    np.testing.assert_allclose(V @ own.E, plant.E + constant.E, atol=1e-9 * np.abs(plant.E).max())
    np.testing.assert_allclose(own.rows.C, plant.rows.C @ V, rtol=1e-12)
    np.testing.assert_allclose(V @ own.prior_P @ V.T, plant.prior_P, atol=1e-9 * plant.prior_P.max())
    np.testing.assert_allclose(own.lag_rows, V[plant.lag_slice])
    heats_W = np.arange(1.0, 1.0 + len(plant.source_names))
    np.testing.assert_allclose(
        V @ start(own, 21.0, heats_W), start(plant, 21.0, heats_W), atol=1e-9 * 21.0 * plant.uniform.max()
    )


@pytest.mark.parametrize("last", [False, True])
@pytest.mark.parametrize("effects", LASTING)
def test_a_nut_has_the_same_columns_wherever_it_stands(effects, last):
    """Rows see of its lag what the table says there, and what follows that lag besides."""
    plant, _, own = before_and_after(effects, last=last)
    assert plant.moving[0].index == (2 if last else 0)
    V, nut = own.basis.V, own.moving[0]
    lag = plant.modes + nut.index
    for place_m in (0.3, 0.55):
        B, C = columns_at(plant.moving[0].table, [place_m])
        B_own, C_own = columns_at(nut.table, [place_m])
        np.testing.assert_allclose(V @ B_own, B, atol=1e-9 * np.abs(B).max())
        there = plant.rows.C.copy()
        there[:, lag] = C
        np.testing.assert_allclose((there @ V)[:, lag], C_own, rtol=1e-9, atol=1e-12)
    there[:, lag] = plant.moving[0].table.mean_C
    np.testing.assert_allclose((there @ V)[:, lag], nut.table.mean_C, rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("effects", LASTING)
def test_what_is_roughly_known_does_the_same(effects):
    plant, _, own = before_and_after(effects, learns=True)
    here, there, V = plant.learning.arrays, own.learning.arrays, own.basis.V
    rng = np.random.default_rng(3)
    xi, z = rng.standard_normal(len(V)), rng.standard_normal(len(plant.known_names))
    law_W, heat_W = rng.standard_normal((2, len(plant.source_names)))
    c = here.drives(V @ xi, plant.B, law_W, heat_W, z)
    np.testing.assert_allclose(V @ there.drives(xi, own.B, law_W, heat_W, z), c, atol=1e-9 * np.abs(c).max())
    theta = rng.standard_normal(len(here.kind))
    A = here.feedback(theta)
    np.testing.assert_allclose(V @ there.feedback(theta) @ own.basis.inverse, A, atol=1e-9 * np.abs(A).max())
    np.testing.assert_allclose(there.entries(xi, z), here.entries(V @ xi, z), rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(V @ there.rest_P @ V.T, here.rest_P, atol=1e-9 * here.rest_P.max())


@pytest.mark.parametrize("modes", [5, 6, 8])
def test_what_loses_nothing_stays_for_good(modes):
    """Without a film and a loss one mode does not decay, and rounding has none grow."""
    config, _ = described(modes, 3, 3)
    body = [effect | {"loss_W_K": 0.0} for effect in COUPLINGS["body_at_an_end"]]
    surface = {"surface": {"convection_W_m2K": 0.0}, "effect": body}
    plant, constant, *_ = unturned(config.remade(config.model_dump(exclude_unset=True) | surface))
    slowest = np.sort(diagonalised(plant, constant).decay_1_s)
    assert 0.0 <= slowest[0] < 1e-12
    assert slowest[1] > 1e-5


def test_a_loss_of_the_screw_is_one_of_the_screw_alone():
    plant, _, own = before_and_after("body_at_an_end")
    V, inverse, _ = own.basis
    np.testing.assert_allclose(V @ on_the_screw(own) @ inverse, on_the_screw(plant), atol=1e-12)


def test_a_plant_of_which_nothing_lasts_is_its_own():
    config, _ = described(3, 3, 3, moving=True, effect=COUPLINGS["speed_loss"])
    plant = build_plant(config)
    assert plant.basis is None
    assert plant.coupling.active
    assert plant.by_itself


def test_for_a_design_a_nut_that_moves_is_spread_over_its_stroke():
    config, _ = described(3, 3, 3, moving=True, effect=COUPLINGS["everything"])
    plant = build_plant(config)
    still, V = frozen(plant)
    assert not still.coupling.active
    assert not still.moving
    rebuilt = V @ np.diag(-still.decay_1_s) @ np.linalg.inv(V)
    A = generator(replace(plant, moving=()))
    np.testing.assert_allclose(rebuilt, A, rtol=0, atol=1e-6 * np.abs(A).max())
