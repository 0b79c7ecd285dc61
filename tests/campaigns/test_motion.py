"""No false jump on healthy axes, and real jumps found: a small part of `campaigns.motion`."""

from __future__ import annotations

import numpy as np
import pytest

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
