"""The σ by which sensors are chosen, held against machines of the independent truth."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from tests.learning.placed import ALL, observed, ranked

SEED, MACHINES = 53000, 9


@pytest.mark.slow
@pytest.mark.timeout(900)
def test_good_sensors_find_what_their_sigma_says_they_find_better() -> None:
    """Of all sets of three the best, the middle one and the worst, by the product of the three σ. The best
    has at most half of the others' σ of field and thermal error, and in rms over the machines smaller errors
    of both. Three machines work each programme; on one of them the best set may be mistaken by itself.
    """
    sets = list(itertools.combinations(range(ALL), 3))
    sigma = ranked(sets)
    order = np.argsort(np.log(sigma).mean(axis=1))
    chosen = [order[i] for i in (0, len(sets) // 2, len(sets) - 1)]
    assert (sigma[chosen[0], 1:] < 0.5 * sigma[chosen[1:], 1:]).all()
    squares = [observed(SEED, number, [sets[i] for i in chosen]) ** 2 for number in range(MACHINES)]
    rms = np.sqrt(np.mean(squares, axis=0))
    assert (rms[0, 1:] < rms[1:, 1:]).all()
