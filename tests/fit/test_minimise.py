"""Least squares on problems whose answer is known: where a fit ends, and when."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from observer.fit.hypothesis import TRIALS, Minimum, Range, Stop, minimise
from observer.frames import FloatArray

FREE = Range(np.full(2, -np.inf), np.full(2, np.inf), np.full(2, np.inf))
LONG = Stop(steps=50, little=1e-14, small=1e-9)
A = np.random.default_rng(4).normal(size=(20, 2))
GOAL = np.array([1.0, -2.0])


class Least:
    """Counts what is asked of a problem, measured − f(θ)."""

    def __init__(self, f, slope, measured, weight: float = 1.0) -> None:
        self.f, self.df, self.measured, self.weight = f, slope, measured, weight
        self.tried: list[FloatArray] = []
        self.slopes: list[FloatArray] = []

    def fit(self, start, within: Range = FREE, stop: Stop = LONG) -> Minimum:
        def residual(theta: FloatArray) -> FloatArray:
            self.tried.append(theta.copy())
            return self.measured - self.f(theta)

        def slope(theta: FloatArray) -> FloatArray:
            self.slopes.append(theta.copy())
            return self.df(theta)

        return minimise(
            residual, slope, lambda c: self.weight * c, np.array(start, dtype=float), within, stop
        )


def straight(noise: float = 0.0) -> Least:
    measured = A @ GOAL + noise * np.random.default_rng(5).normal(size=len(A))
    return Least(lambda theta: A @ theta, lambda _: A, measured)


def valley() -> Least:
    """Rosenbrock's: residuals 10 (y − x²) and 1 − x; the least is 0 at (1, 1)."""
    return Least(
        lambda t: np.array([-10 * (t[1] - t[0] ** 2), t[0]]),
        lambda t: np.array([[20 * t[0], -10.0], [1.0, 0.0]]),
        np.array([0.0, 1.0]),
    )


def slack() -> Least:
    """An arctangent, on which a whole step of Newton's goes ever further astray from 1.4 on."""
    return Least(
        lambda t: np.array([np.arctan(t[0]), t[1]]),
        lambda t: np.array([[1 / (1 + t[0] ** 2), 0.0], [0.0, 1.0]]),
        np.zeros(2),
    )


def test_what_is_linear_takes_one_step() -> None:
    least = straight(0.1)
    found = least.fit([5.0, 5.0], stop=LONG._replace(steps=1))
    np.testing.assert_allclose(found.theta, np.linalg.lstsq(A, least.measured)[0], rtol=0, atol=1e-9)
    np.testing.assert_allclose(found.residual, least.measured - A @ found.theta, rtol=0, atol=1e-9)
    np.testing.assert_array_equal(found.jacobian, -A)
    assert len(least.tried) == 2


def test_a_bent_valley_is_followed_to_its_end() -> None:
    least = valley()
    found = least.fit([-1.2, 1.0])
    np.testing.assert_allclose(found.theta, [1.0, 1.0], rtol=0, atol=1e-8)
    np.testing.assert_allclose(found.residual, 0.0, atol=1e-8)


def test_a_step_that_leads_astray_is_shortened() -> None:
    """From 30 the whole step lands at −1335; damping finds the way."""
    least = slack()
    found = least.fit([30.0, 0.0])
    squares = [float(np.sum(least.f(theta) ** 2)) for theta in least.slopes]
    assert all(after <= before + 1e-9 for before, after in pairwise(squares))
    np.testing.assert_allclose(found.theta, 0.0, atol=1e-6)
    tried = [theta[0] for theta in least.tried]
    assert tried[1] < -1000.0
    assert (np.diff(np.abs(tried[1:8])) < 0).all(), "each trial is shorter than the one before"


def test_damping_is_taken_back_where_all_goes_well() -> None:
    """A step of 10 ‖D step‖² is taken; a tenth of it is kept for the next, until it is nothing."""
    least = slack()
    least.fit([3.0, 0.0])
    whole = [float(-np.arctan(x) * (1 + x**2)) for x, _ in least.slopes]
    taken = [float(b - a) for (a, _), (b, _) in pairwise(least.slopes)]
    damping = [w / t - 1 for w, t in zip(whole, taken, strict=False)]
    assert damping[:6] == pytest.approx([10.0, 1.0, 0.1, 0.01, 1e-3, 1e-4], rel=1e-6)
    assert len(damping) <= 8


def test_a_step_that_no_shortening_helps_is_not_taken() -> None:
    """Derivatives of the wrong sign: every step leads uphill."""
    least = Least(lambda theta: A @ theta, lambda _: -A, A @ GOAL)
    found = least.fit([0.0, 0.0])
    np.testing.assert_array_equal(found.theta, [0.0, 0.0])
    np.testing.assert_array_equal(found.residual, least.measured)
    normal = A.T @ A
    dampings = [0.0, 1e-3, 1e-2, 0.1, 1.0, 10.0, 100.0, 1000.0]
    steps = [np.linalg.solve(normal + d * np.diag(np.diag(normal)), -normal @ GOAL) for d in dampings]
    assert len(steps) == TRIALS
    np.testing.assert_allclose(least.tried[1:], steps, rtol=1e-6)


def test_bounds_of_a_fit_hold_and_free_parameters_make_up_for_them() -> None:
    within = Range(np.array([-np.inf, -1.0]), np.full(2, np.inf), np.full(2, np.inf))
    least = straight()
    found = least.fit([0.0, 0.0], within)
    assert found.theta[1] == -1.0
    alone = A[:, 0] @ (least.measured + A[:, 1]) / (A[:, 0] @ A[:, 0])
    assert found.theta[0] == pytest.approx(alone, rel=1e-9)
    other = straight().fit([0.0, -3.0], Range(np.full(2, -3.0), np.array([0.5, 0.5]), np.full(2, np.inf)))
    assert other.theta[0] == 0.5


def test_no_step_is_longer_than_its_reach() -> None:
    within = Range(FREE.low, FREE.high, np.array([0.3, np.inf]))
    least = straight()
    found = least.fit([0.0, 0.0], within)
    np.testing.assert_allclose(found.theta, GOAL, rtol=0, atol=1e-9)
    along = [theta[0] for theta in least.tried]
    np.testing.assert_allclose(along[:5], [0.0, 0.3, 0.6, 0.9, 1.0], rtol=0, atol=1e-9)
    low, high = Range(np.array([-1.0]), np.array([2.0]), np.array([0.5])).step(np.array([1.75]))
    assert (low.tolist(), high.tolist()) == ([-0.5], [0.25])
    low, high = Range(np.array([-1.0]), np.array([2.0]), np.array([0.5])).step(np.array([-0.75]))
    assert (low.tolist(), high.tolist()) == ([-0.25], [0.5])


# ---- when it is over ----


def test_a_fit_is_over_after_its_steps() -> None:
    for steps in (0, 1, 3):
        least = valley()
        least.fit([-1.2, 1.0], stop=LONG._replace(steps=steps))
        assert len(least.slopes) == steps + 1


@pytest.mark.parametrize(
    ("stop", "weight", "first"),
    [
        # (1 − x)² drops by 0.19, 0.17, … at each tenth; the step that brings less is still taken
        ({"little": 0.4}, 1.0, 0.1),
        ({"little": 0.0}, 1.0, 0.6),
        # σ is 1, and a half where the weight is 2
        ({"small": 0.11, "steps": 5}, 1.0, 0.1),
        ({"small": 0.09, "steps": 5}, 1.0, 0.5),
        ({"small": 0.11, "steps": 5}, 2.0, 0.5),
        # five more drops as the first lead to −0.14, four after it to 0.05: hopeless beside a lesser rival
        ({"rival": -0.1}, 1.0, 0.2),
        ({"rival": -0.2}, 1.0, 0.1),
        ({"rival": 0.04, "steps": 5}, 1.0, 0.1),
        ({"rival": 0.06, "steps": 5}, 1.0, 0.2),
    ],
)
def test_a_fit_ends_at_a_little_drop_a_small_step_or_beside_a_rival(
    stop: dict[str, float], weight: float, first: float
) -> None:
    """By tenths from 0 towards 1."""
    least = Least(lambda t: t, lambda _: np.eye(2), np.array([1.0, 0.0]), weight)
    within = Range(FREE.low, FREE.high, np.full(2, 0.1))
    found = least.fit([0.0, 0.0], within, LONG._replace(**({"steps": 6} | stop)))
    assert found.theta[0] == pytest.approx(first)


def test_what_is_no_number_is_left_where_it_is() -> None:
    least = straight()
    least.measured[3] = np.nan
    found = least.fit([1.0, 1.0])
    assert found.theta.tolist() == [1.0, 1.0]
    assert len(least.tried) == 1
    steep = Least(lambda theta: A @ theta, lambda _: np.inf * A, A @ GOAL)
    assert steep.fit([1.0, 1.0]).theta.tolist() == [1.0, 1.0]
    assert len(steep.tried) == 1


def test_a_step_into_what_overflows_is_shortened() -> None:
    least = Least(
        lambda t: np.array([np.inf if t[0] > 0.5 else t[0], t[1]]), lambda _: np.eye(2), np.array([0.6, 0.0])
    )
    found = least.fit([0.0, 0.0])
    assert 0.0 < found.theta[0] <= 0.5
    assert np.isfinite(found.residual).all()


def test_without_parameters_there_is_nothing_to_do() -> None:
    least = Least(lambda _: np.zeros(3), lambda _: np.zeros((3, 0)), np.ones(3))
    none = np.zeros(0)
    found = least.fit(none, Range(none, none, none))
    assert found.theta.shape == (0,)
    assert found.residual.tolist() == [1.0, 1.0, 1.0]
    assert found.jacobian.shape == (3, 0)


def test_columns_that_say_the_same_share_what_they_explain() -> None:
    """A singular problem has an end all the same, and its residual is the least."""
    twice = np.column_stack([A[:, 0], A[:, 0]])
    least = Least(lambda theta: twice @ theta, lambda _: twice, A[:, 0] * 3.0)
    found = least.fit([0.0, 0.0])
    assert found.theta.sum() == pytest.approx(3.0, rel=1e-9)
