"""What couples the states of a plant acts on every column alike, however many there are."""

from __future__ import annotations

import numpy as np

from observer.kernels.coupling import _pass_on


def test_more_columns_than_the_scratch_is_wide_are_all_taken() -> None:
    rng = np.random.default_rng(3)
    states, width, columns = 5, 4, 11
    read, into, M = rng.normal(size=states), rng.normal(size=states), rng.normal(size=(states, columns))
    expected = M + 0.3 * np.outer(into, read @ M)
    sums = np.zeros(width + 1)
    _pass_on(read, into, 0.3, states, M, sums[:width])
    np.testing.assert_allclose(M, expected, rtol=1e-12)
    assert sums[width] == 0.0
