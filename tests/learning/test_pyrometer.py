"""An infrared sensor of unknown emissivity in the place of a thermocouple, on rough machines of the truth."""

from __future__ import annotations

import numpy as np
import pytest

from observer.frames import EstimateBlock
from tests.learning.cover import QUANTITIES, TWO_SIDED_95, misses
from tests.learning.machines import Day
from tests.learning.pyrometer import (
    EMISSIVITY,
    EMISSIVITY_SIGMA,
    ENDS,
    MIDDLE,
    estimated,
    looked_at,
    shown_degC,
)
from tests.truth.machine.physics import FloatArray

FRESH_SEED = 53_000
ROUGHLY = EMISSIVITY_SIGMA / EMISSIVITY


def judged(found: EstimateBlock, day: Day) -> dict[str, tuple[float, float]]:
    """The rms error of each quantity, and the part of it within the 95 % interval."""
    return {
        name: (float(np.sqrt(np.mean(error**2))), float(np.mean(np.abs(error) <= TWO_SIDED_95 * sigma)))
        for name, (error, sigma) in misses(found, day).items()
    }


def test_it_shows_the_part_that_it_emits_when_it_takes_all_for_black() -> None:
    """To the first order; of 20 K it shows 6 % more, for radiance grows faster than the temperature."""
    air = np.full(2, 22.0)
    warm = air + np.array([0.01, 20.0])
    part = (shown_degC(warm, air, air, 0.3, 1.0) - air) / (warm - air)
    np.testing.assert_allclose(part, [0.3, 0.319], rtol=1e-3)
    np.testing.assert_allclose(shown_degC(warm, air, air, 0.3, 0.3), warm, atol=1e-3)


def test_with_its_tolerance_sigma_holds_and_the_field_is_better_known_than_without() -> None:
    one = looked_at(FRESH_SEED, 0, "a")
    roughly = judged(estimated(one, MIDDLE, one.described(shows_tolerance=ROUGHLY)), one.day)
    without = judged(estimated(one, ENDS), one.day)
    for name in QUANTITIES:
        assert roughly[name][1] >= 0.9
    assert roughly["field"][0] < 0.75 * without["field"][0]
    trusting = "\n[integrity]\nenabled = false\n"  # else it is excluded for a third of the day
    as_black = judged(estimated(one, MIDDLE, one.described(shows=1.0), trusting), one.day)
    assert as_black["field"][0] > 2.0 * judged(estimated(one, ENDS, tables=trusting), one.day)["field"][0]


@pytest.mark.slow
def test_on_fresh_machines() -> None:
    """Infrared sensors on rough machines; the bounds were set before the seed was drawn."""
    squares, within = dict[str, list[FloatArray]](), dict[str, list[FloatArray]]()
    for number in range(6):
        one = looked_at(FRESH_SEED, number, "abc"[number % 3])
        cases = {
            "roughly": estimated(one, MIDDLE, one.described(shows_tolerance=ROUGHLY)),
            "without": estimated(one, ENDS),
        }
        for case, found in cases.items():
            own = np.array(list(judged(found, one.day).values()))
            squares.setdefault(case, []).append(own[:, 0] ** 2)
            within.setdefault(case, []).append(own[:, 1])
    rms = {case: np.sqrt(np.mean(each, axis=0)) for case, each in squares.items()}
    assert (np.mean(within["roughly"], axis=0) >= 0.9).all()
    assert (rms["roughly"][1:] < 0.75 * rms["without"][1:]).all()
