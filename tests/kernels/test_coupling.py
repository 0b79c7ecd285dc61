"""What couples the states of a plant acts on every column alike, however many there are."""

from __future__ import annotations

import numpy as np
import pytest

from observer.kernels.advance import multiply_columns
from observer.kernels.coupling import couple
from observer.model.coupling import half_step_columns, link_scratch, state_column
from tests.bits.shared import COUPLINGS, coupled

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
    state.X[:, 0], state.known[:-1, 0] = x, z
    matrix.X[:, : len(x)] = np.eye(len(x))
    for columns in (state, matrix):
        couple(c, DRAWN_1_S, DRAWN_K_S, B, HALF_S, columns, link_scratch(c))
    first = transposed.shape[1]
    known = matrix.X[:, first : first + len(z) + 1] @ np.append(z, 1.0)
    np.testing.assert_allclose(matrix.X[:, : len(x)] @ x + known, state.X[:, 0], rtol=1e-11)
    assert not np.allclose(state.X[:, 0], x, rtol=1e-6)
