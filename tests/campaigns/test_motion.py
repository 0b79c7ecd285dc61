"""No false jump on healthy axes, and real jumps found: a small part of `campaigns.motion`."""

from __future__ import annotations

import numpy as np
import pytest

from campaigns.motion.axis import draw_axis, draw_path
from campaigns.motion.measure import PERIODS_S, faulty_delay_s, healthy

HOURS = 4.0


@pytest.mark.parametrize("period_s", PERIODS_S)
@pytest.mark.parametrize("seed", range(3))
def test_a_healthy_axis_never_jumps(period_s, seed):
    samples, jumps, _, polling = healthy(period_s, 3600.0 * HOURS, 20_260 + seed)
    assert samples > 0.5 * 3600.0 * HOURS / period_s
    assert jumps == 0, polling


@pytest.mark.parametrize(
    ("name", "size_m", "period_s"),
    [
        ("lost by 30 mm at rest", 0.03, 0.02),
        ("lost by 100 mm at rest", 0.1, 0.05),
        ("lost by 100 mm moving", 0.1, 0.05),
        ("sign reversed", 0.0, 0.1),
        ("stuck", 0.0, 0.02),
    ],
)
def test_a_real_fault_is_found_within_five_minutes(name, size_m, period_s):
    """At least 18 of 20 on an idle computer; the seconds are those of the simulated axis."""
    delays_s = [faulty_delay_s(name, size_m, period_s, loaded=False, seed=77_000 + n) for n in range(20)]
    assert np.sum(np.isfinite(delays_s)) >= 18


def test_the_simulated_axis_keeps_its_limits():
    """Its path is continuous, and no faster and no more accelerated than it was drawn."""
    for seed in range(20):
        rng = np.random.default_rng(seed)
        axis = draw_axis(rng)
        time_s = np.arange(0.0, 120.0, 1e-3)
        place_m, velocity_m_s = draw_path(axis, 120.0, rng).at(time_s)
        assert np.abs(velocity_m_s).max() <= axis.rapid_m_s + 1e-9
        assert np.abs(np.diff(velocity_m_s)).max() <= 1e-3 * axis.acceleration_m_s2 * (1.0 + 1e-6)
        mean_m_s = 0.5 * (velocity_m_s[1:] + velocity_m_s[:-1])
        assert np.abs(np.diff(place_m) - 1e-3 * mean_m_s).max() < 1e-5
        assert place_m.min() >= axis.low_m - 0.1
        assert place_m.max() <= axis.high_m + 0.1
