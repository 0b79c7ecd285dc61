"""What couples the states of a plant acts on every column alike, however many there are."""

from __future__ import annotations

import numpy as np
import pytest

from observer.kernels.advance import multiply_columns
from observer.kernels.coupling import couple, uniform_loss
from observer.model.build import build_plant
from observer.model.coupling import half_step_columns, link_scratch, state_column
from tests.bits.shared import COUPLINGS, coupled
from tests.reference.cases import config_of, point
from tests.truth.bar import Bar

DRAWN_1_S, DRAWN_K_S, HALF_S = 1e-4, 2e-3, 30.0


def test_more_columns_than_the_scratch_is_wide_are_all_taken() -> None:
    rng = np.random.default_rng(3)
    states, others, width, columns = 5, 2, 4, 11
    M, X = rng.normal(size=(states, states + 1)), rng.normal(size=(states + others, columns))
    expected = np.vstack([M[:, :states] @ X[:states], X[states:]])
    multiply_columns(M, states, X, np.zeros((states, width)))
    np.testing.assert_allclose(X, expected, rtol=1e-12)


@pytest.mark.parametrize("effects", COUPLINGS)
def test_the_matrix_of_half_a_step_does_what_the_couplings_do_to_a_state(effects: str) -> None:
    plant, u = coupled(COUPLINGS[effects], 3)
    c, z, x = plant.coupling, u.z_end[2], 20.0 + np.arange(len(plant.decay_1_s), dtype=float)
    B = np.ascontiguousarray(plant.B.T)
    state, (matrix, transposed) = state_column(c), half_step_columns(c)
    state.X[:, 0], state.inputs[:-1, 0] = x, z
    matrix.X[:, : len(x)] = np.eye(len(x))
    for columns in (state, matrix):
        couple(c, DRAWN_1_S, DRAWN_K_S, B, HALF_S, columns, link_scratch(c))
    first = transposed.shape[1]
    known = matrix.X[:, first : first + len(z) + 1] @ np.append(z, 1.0)
    np.testing.assert_allclose(matrix.X[:, : len(x)] @ x + known, state.X[:, 0], rtol=1e-11)
    assert not np.allclose(state.X[:, 0], x, rtol=1e-6)


BAR = Bar(length_m=0.6, diameter_m=0.03, convection_W_m2K=12.0)
AT_10_K_W_M2K, AIR_DEGC = 9.0, 21.0
PLACES = 400


def rates_K_s(rise_K: np.ndarray) -> np.ndarray:
    """Return how fast a section cools, K/s, at its rise above still air: 4 h θ/(ρ c d)."""
    h_W_m2K = AT_10_K_W_M2K * (np.abs(rise_K) / 10.0) ** 0.25
    return 4.0 * h_W_m2K * rise_K / (BAR.density_kg_m3 * BAR.specific_heat_J_kgK * BAR.diameter_m)


@pytest.mark.parametrize("mean_K", [30.0, 3.0, -12.0])
def test_a_screw_in_still_air_loses_what_its_sections_lose(mean_K: float) -> None:
    """The field is a cosine of 40 % of its mean, and the loss of its sections is summed section by section.

    The third order is zero for a cosine. The fourth is 0.055 of 0.4⁴ · 3/8, which is 5e-4 of the loss.
    """
    middle_m = (np.arange(PLACES) + 0.5) / PLACES * BAR.length_m
    effect = [{"kind": "natural_convection", "coefficient_W_m2K": AT_10_K_W_M2K}]
    plant = build_plant(config_of(BAR, [point("left", 0.0)], middle_m, effect=effect, model={"modes": 6}))
    c, modes = plant.coupling, plant.modes
    rise_K = mean_K * (1.0 + 0.4 * np.cos(np.pi * middle_m / BAR.length_m))
    shapes = plant.rows.C[plant.rows.field_slice, :modes]
    x = np.zeros(len(plant.decay_1_s))
    x[:modes] = np.linalg.lstsq(shapes, AIR_DEGC + rise_K, rcond=None)[0]
    rate_1_s, drawn_K_s = uniform_loss(c, 0.0, 0.0, AIR_DEGC, x)
    np.testing.assert_allclose(shapes @ x[:modes], AIR_DEGC + rise_K, atol=1e-3)
    mean_rate_K_s = rate_1_s * (AIR_DEGC + mean_K) - drawn_K_s
    np.testing.assert_allclose(mean_rate_K_s, rates_K_s(rise_K).mean(), rtol=1e-3)
    tangent_1_s = (rates_K_s(np.array(mean_K + 0.01)) - rates_K_s(np.array(mean_K - 0.01))) / 0.02
    np.testing.assert_allclose(rate_1_s, tangent_1_s, rtol=1e-6)


def test_still_air_draws_a_screw_that_is_as_warm_to_its_own_temperature() -> None:
    plant, _ = coupled(COUPLINGS["natural_convection"], 1)
    rate_1_s, drawn_K_s = uniform_loss(plant.coupling, 0.0, 0.0, AIR_DEGC, plant.uniform * AIR_DEGC)
    assert rate_1_s >= 0.0
    # the variance along the screw is a difference of squares, and rounds to some 1e-13 K²
    assert drawn_K_s == pytest.approx(rate_1_s * AIR_DEGC, abs=1e-9)
