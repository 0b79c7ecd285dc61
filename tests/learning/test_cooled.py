"""What it is worth to measure the inlet of a coolant whose chiller drifts, on rough machines of the truth."""

from __future__ import annotations

import numpy as np

from tests.learning.cooled import CONSTANT, MEASURED, cooled, estimates
from tests.learning.cover import misses

FRESH_SEED, MACHINES = 56_000, 3


def test_with_the_inlet_measured_heats_and_error_are_better_known() -> None:
    """The bounds were set on other seeds: of heats, the nut's, field and thermal error, rms."""
    found = []
    for number in range(MACHINES):
        one = cooled(FRESH_SEED, number, "abc"[number])
        both = [misses(estimates(one.log, inlet), one.day) for inlet in (CONSTANT, MEASURED)]
        found.append([[np.mean(error**2) for error, _ in each.values()] for each in both])
        for error, sigma in both[1].values():
            assert np.mean(np.abs(error) <= 1.96 * sigma) >= 0.95
    constant, measured = np.sqrt(np.mean(found, axis=0))
    assert (measured < 0.85 * constant).all()
