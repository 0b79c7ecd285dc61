"""Reduction without a configuration: what it says it leaves out is what is missing."""

from __future__ import annotations

import numpy as np
import pytest

from observer.model.build import build_plant, full_model, keep_modes
from observer.model.realise import realise
from observer.model.reduce import reduce
from observer.model.rod.modes import quadrature, source_field, tail_left
from tests.logs.machines import config_of


@pytest.fixture
def full():
    machine = realise(config_of(8, 4, 5))
    return full_model(machine.config, machine.terms)


def test_the_configured_plant_is_its_full_model_reduced(full):
    config = config_of(8, 4, 5)
    plant, reduced = build_plant(config), reduce(full, keep_modes(config, full.modes))[0]
    for name in ("decay_1_s", "B", "E", "prior_P", "uniform", "noise_R_K2"):
        np.testing.assert_array_equal(getattr(plant, name), getattr(reduced, name), err_msg=name)
    np.testing.assert_array_equal(plant.rows.C, reduced.rows.C)


@pytest.mark.parametrize("modes", [1, 3, 6])
def test_what_is_left_out_is_what_is_missing_at_rest(full, modes):
    """‖Ψ − Ψ_N‖ / ‖Ψ‖ = √(1 − (1 − left)²), by quadrature of the closed form and of the modes' own sum."""
    (plant, kept_modes), rod = reduce(full, range(modes)), full.modes.rod
    for j, heat in enumerate(full.heats):
        x, w = quadrature(rod.length_m, (heat.stretch.a_m, heat.stretch.b_m))
        whole = source_field(rod, heat.stretch, x)
        kept = kept_modes.theta(x) @ (plant.B[:modes, j] / plant.decay_1_s[:modes])
        missing = np.sqrt(np.sum(w * (whole - kept) ** 2) / np.sum(w * whole**2))
        assert missing == pytest.approx(
            np.sqrt(1.0 - (1.0 - tail_left(kept_modes, modes, heat.stretch)) ** 2), rel=1e-6
        )


def test_the_lags_settle_as_the_first_mode_that_is_dropped(full):
    for n in (2, 4, 7):
        plant, _ = reduce(full, range(n))
        np.testing.assert_array_equal(plant.decay_1_s[n:], full.modes.decay_1_s[n])
        assert plant.dropped_rate_1_s == full.modes.decay_1_s[n]


def test_the_field_at_rest_needs_no_mode_but_one(full):
    """By the static correction: rows at rest under 1 W are those of the closed form, however few modes."""
    few, many = (reduce(full, range(n))[0] for n in (1, 8))
    for plant in (few, many):
        rest = plant.rows.C @ (plant.B / plant.decay_1_s[:, None])
        x = full.places.grid_m
        for j, heat in enumerate(full.heats):
            np.testing.assert_allclose(
                rest[plant.rows.field_slice, j], source_field(full.modes.rod, heat.stretch, x), rtol=1e-9
            )
