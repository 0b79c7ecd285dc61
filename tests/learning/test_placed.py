"""The σ by which sensors are chosen, held against machines of the independent truth."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from tests.learning.placed import ALL, observed, ranked

SEED, MACHINES = 52000, 2


@pytest.mark.slow
@pytest.mark.timeout(900)
def test_what_is_found_with_good_and_bad_sensors_orders_as_their_sigma_does() -> None:
    """Of all sets of three the best, the middle one and the worst: in rms over machines the errors of field
    and position order so, and those of the heats between the ends, which in the middle are near each other.
    """
    sets = list(itertools.combinations(range(ALL), 3))
    order = np.argsort(np.log(ranked(sets)).mean(axis=1))
    chosen = [sets[order[i]] for i in (0, len(sets) // 2, len(sets) - 1)]
    squares = [observed(SEED, number, chosen) ** 2 for number in range(MACHINES)]
    heat_W, field_K, error_um = np.sqrt(np.mean(squares, axis=0)).T
    assert (np.diff(field_K) > 0.0).all()
    assert (np.diff(error_um) > 0.0).all()
    assert heat_W[0] < heat_W[-1]
