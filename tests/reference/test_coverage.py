"""Is σ true? The 95 % intervals of heat, field and thermal error, over 200 runs of the independent truth."""

from __future__ import annotations

import numpy as np
import pytest

from observer.frames import FloatArray
from tests.reference.campaign import PERIOD_S, RUNS, Campaign, run_campaign

TIMES_S = np.arange(400.0, 3601.0, 400.0) - 10.0
"""Thin: 400 s is longer than the filter remembers a heat (100 s) or diffusion takes between sensors."""
TWO_SIDED_95 = 1.959964


@pytest.fixture(scope="module")
def campaign() -> Campaign:
    return run_campaign(seed=20)


def inside(truth: FloatArray, estimate: FloatArray, sigma: FloatArray) -> FloatArray:
    """Share of a run's values inside their 95 % intervals; values that are known exactly do not count."""
    counts = sigma > 1e-9
    return np.mean(np.abs(truth - estimate)[counts] <= TWO_SIDED_95 * sigma[counts])


@pytest.mark.parametrize("what", ["heat", "field", "error"])
def test_ninety_five_percent_intervals_hold_the_truth(campaign: Campaign, what: str) -> None:
    ticks = np.round(TIMES_S / PERIOD_S).astype(int)
    unit = {"heat": "W", "field": "degC", "error": "um"}[what]
    sigma_unit = {"heat": "W", "field": "K", "error": "um"}[what]
    truth = getattr(campaign, f"{what}_{unit}")
    shares = np.array(
        [
            inside(
                truth[ticks, :, run],
                getattr(block, f"{what}_{unit}")[ticks],
                getattr(block, f"{what}_sigma_{sigma_unit}")[ticks],
            )
            for run, block in enumerate(campaign.estimates)
        ]
    )
    # Runs are independent, times and places within one are not: the spread of the shares between runs gives
    # the standard error of their mean. The band 93–97 % must be wider than three of them to say anything.
    standard_error = shares.std(ddof=1) / np.sqrt(RUNS)
    print(f"{what}: {100 * shares.mean():.2f} % inside, standard error {100 * standard_error:.2f} %")
    assert 3.0 * standard_error < 0.02
    assert 0.93 <= shares.mean() <= 0.97


def test_the_intervals_are_worth_having(campaign: Campaign) -> None:
    """An interval that is always wide would cover as well: σ must be small against what was unknown."""
    block = campaign.estimates[0]
    assert np.median(block.heat_sigma_W[-900:]) < 2.0  # started at 5 W and walked by 0.1 W √(3600 s) = 6 W
    assert np.median(block.field_sigma_K[-900:]) < 0.2  # started at 2 K
    assert (block.quality == 0).all()
