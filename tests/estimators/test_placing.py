"""The search over sets of sensors, on scores that are made up."""

import itertools
import math

import numpy as np
import pytest

from observer.estimators.design import placing
from observer.estimators.design.placing import SetLimits, best_sets

N = 9


def information(n=N, heats=3, seed=1):
    """A score as covariances make it: what is left of three unknowns by n sensors."""
    rows = np.random.default_rng(seed).normal(size=(n, heats))

    def score(sets):
        return np.array(
            [
                np.sqrt(np.trace(np.linalg.inv(np.eye(heats) * 1e-2 + rows[list(s)].T @ rows[list(s)])))
                for s in sets
            ]
        )

    return score


def limits(costs=None, most=N, budget=math.inf, kept=(), n=N):
    costs = np.ones(n) if costs is None else np.asarray(costs, dtype=float)
    return SetLimits(
        costs, tuple(i for i in range(n) if i not in kept), most, budget, kept, frozenset(range(n))
    )


def every_set(n, most):
    return [s for k in range(1, most + 1) for s in itertools.combinations(range(n), k)]


def test_few_sets_are_all_tried_and_each_line_is_the_best_of_its_cost():
    score = information()
    found = best_sets(score, limits(most=4))
    assert found.exhaustive
    assert found.tried == len(every_set(N, 4))
    for one in found.sets:
        same = list(itertools.combinations(range(N), len(one)))
        assert score([one])[0] == pytest.approx(score(same).min(), rel=1e-5)


@pytest.mark.parametrize(("budget", "tried"), [(0.5, 1), (1.0, 1 + 30), (1.9, 1 + 30)])
def test_sets_within_a_small_budget_are_all_tried_however_many_there_would_be(budget, tried):
    """All of 20 sensors at most, of 30: no search by steps, where only the budget allows few of them."""
    found = best_sets(information(n=31), limits(most=20, budget=budget, kept=(30,), n=31))
    assert (found.exhaustive, found.tried) == (True, tried)


def test_nothing_on_the_front_is_dearer_without_being_better():
    costs = np.random.default_rng(3).uniform(1.0, 10.0, N)
    score, within = information(), limits(costs, most=5, budget=18.0)
    front = best_sets(score, within)
    allowed = [s for s in every_set(N, 5) if costs[list(s)].sum() <= 18.0]
    scores, prices = score(allowed), np.array([costs[list(s)].sum() for s in allowed])
    own = score(front.sets)
    assert (np.diff(own) < 0).all()
    assert (np.diff([within.cost(s) for s in front.sets]) > 0).all()
    for one, value in zip(front.sets, own, strict=True):
        assert scores[prices <= within.cost(one)].min() == pytest.approx(value, rel=1e-5)


@pytest.mark.parametrize("costs", [None, np.arange(1.0, N + 1.0)])
def test_the_search_by_steps_says_so_and_comes_close(monkeypatch, costs):
    """Changing one sensor at a time need not find the best of all sets, but it must not miss it by much."""
    score, within = information(seed=5), limits(costs, most=4)
    best = best_sets(score, within)
    monkeypatch.setattr(placing, "MOST_SETS", 10)
    stepwise = best_sets(score, within)
    assert not stepwise.exhaustive
    for one in best.sets:
        affordable = [s for s in stepwise.sets if within.cost(s) <= within.cost(one)]
        assert score(affordable).min() < 1.1 * score([one])[0]
    assert score(stepwise.sets).min() == pytest.approx(score(best.sets).min(), rel=0.05)


def test_what_is_kept_is_in_every_set_and_costs_nothing():
    found = best_sets(information(), limits(most=2, kept=(2, 5)))
    assert found.sets[0] == (2, 5)
    assert all({2, 5} <= set(one) for one in found.sets)
    assert [len(one) for one in found.sets] == [2, 3, 4]


def test_places_that_differ_by_rounding_alone_are_taken_from_the_left():
    """Which end of a symmetric screw comes first must not depend on the computer."""
    noise = np.random.default_rng(0)

    def score(sets):
        return np.array([1.0 / len(s) for s in sets]) * (1.0 + 1e-12 * noise.standard_normal(len(sets)))

    assert best_sets(score, limits(most=2)).sets == ((0,), (0, 1))
