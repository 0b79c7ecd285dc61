"""How often the bound failed is counted by runs of steps, and never stated without its upper limit."""

import math

import numpy as np
import pytest

from campaigns.first_day.judge import runs
from campaigns.integrity import rates as of
from campaigns.integrity.promise import short_of


def rows(fault: str, excursions: list[int], good: int = 3600) -> list[dict[str, str]]:
    """Return a row for each run, of an hour."""
    constant = {"fault": fault, "good": str(good), "steps": str(good), "out": "0", "wrong": "0"}
    more = {"bound_um": "2", "half_um": "1"}
    return [constant | more | {"excursions": str(n), "beyond": str(2 * n)} for n in excursions]


@pytest.mark.parametrize("count", [0, 1, 5])
def test_so_few_events_are_as_rare_as_one_in_twenty_at_the_upper_limit(count):
    most = of.most_expected(count)
    chance = sum(math.exp(-most) * most**n / math.factorial(n) for n in range(count + 1))
    assert chance == pytest.approx(0.05)
    share = of.most_share(count, 300)
    chance = sum(math.comb(300, n) * share**n * (1.0 - share) ** (300 - n) for n in range(count + 1))
    assert chance == pytest.approx(0.05)


def test_every_run_may_have_an_event():
    assert of.most_share(3, 3) == 1.0


def test_excursions_are_runs_of_consecutive_steps():
    assert runs(np.array([True, True, False, True, False, False, True])) == 3
    assert runs(np.zeros(4, bool)) == 0


def test_each_class_has_its_hours_excursions_and_upper_limits():
    lines = of.rates(rows("none", [0] * 300) + rows("all held, with noise", [0, 2])).splitlines()
    assert lines[2:] == [
        "| none | 300 | 300 | 100 % | 0 % | 0 | 0 | 0 (0.01) | 0 (0.99 %) |",
        "| held | 2 | 2 | 100 % | 0 % | 4 | 2 | 1 (3.1) | 1 (97 %) |",
    ]


def test_more_than_three_of_three_hundred_machines_beyond_the_bound_are_short_of_the_promise():
    assert not short_of(rows("none", [1] * 3 + [0] * 297, good=36000))
    assert short_of(rows("none", [1] * 4 + [0] * 296, good=36000)) == [
        "none: a good step beyond the bound on 4 of 300"
    ]
