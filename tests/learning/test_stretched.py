"""The axial force of a pre-stretched screw on a rough machine, against a chain of springs by hand."""

from __future__ import annotations

import numpy as np
import pytest

from tests.learning.stretched import STRETCHED, stretched


@pytest.mark.parametrize("supports", STRETCHED.values(), ids=str)
def test_the_force_lies_within_its_intervals_as_the_pre_tension_is_used_up(
    supports: tuple[float, float],
) -> None:
    one = stretched(64_000, 2, supports)
    late = one.hours > one.hours[0] + 0.2
    force_N, sigma_N = one.found.force_N[late, 0], one.found.force_sigma_N[late, 0]
    assert one.force_N[0] > 0.0 > one.force_N[late].min(), "this day uses up the pre-tension"
    # by the second σ of a normal distribution; what stays wrong all day does so on one machine
    assert np.mean(np.abs(force_N - one.force_N[late]) <= 1.96 * sigma_N) >= 0.95
    assert sigma_N.mean() < 0.05 * np.ptp(one.force_N), "σ says something"
