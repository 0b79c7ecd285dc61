"""Linear least squares against dense solutions by the normal equations."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from observer.fit.linear import LinearFit, Marginal, unabsorbed

SEEDS, ROWS, PARAMETERS = st.integers(0, 10**6), st.integers(6, 20), st.integers(1, 5)


@given(SEEDS, ROWS, PARAMETERS, st.floats(0.0, 3.0))
def test_a_fit_solves_the_normal_equations_with_its_prior(seed: int, n: int, p: int, weight: float) -> None:
    rng = np.random.default_rng(seed)
    A, b = rng.normal(size=(n, p)) + np.eye(n, p), rng.normal(size=n)
    fit = LinearFit.of(A, b, prior_weight=weight)
    information = A.T @ A + weight**2 * np.eye(p)
    step = np.linalg.solve(information, A.T @ b)
    rounding = 1e-14 * np.linalg.cond(information) + 1e-12
    np.testing.assert_allclose(fit.step, step, rtol=0, atol=rounding)
    np.testing.assert_allclose(fit.covariance, np.linalg.inv(information), rtol=0, atol=10 * rounding)
    np.testing.assert_allclose(fit.sigma**2, np.diag(fit.covariance), rtol=1e-12)
    squares = np.sum((b - A @ step) ** 2) + weight**2 * np.sum(step**2)
    assert fit.deviance == pytest.approx(squares, rel=1e-9, abs=1e-12)
    by_information = LinearFit.of_information(information, A.T @ b)
    np.testing.assert_allclose(by_information.step, step, rtol=0, atol=rounding)
    assert by_information.floor == 0.0


@given(SEEDS, ROWS, PARAMETERS)
def test_marginalised_nuisances_are_fitted_with_a_prior_of_one(seed: int, n: int, t: int) -> None:
    """Both ways to leave a nuisance open give one step, one covariance and one deviance."""
    rng = np.random.default_rng(seed)
    A, T, b = rng.normal(size=(n, 1)), 3.0 * rng.normal(size=(n, t)), rng.normal(size=n)
    marginal = Marginal.of(T)
    short = LinearFit.of(marginal(A), marginal(b))
    long = LinearFit.of(np.hstack([A, T]), b, prior_weight=np.array([0.0, *[1.0] * t]))
    assert short.step[0] == pytest.approx(long.step[0], rel=1e-7, abs=1e-9)
    assert short.covariance[0, 0] == pytest.approx(long.covariance[0, 0], rel=1e-7)
    assert short.deviance == pytest.approx(long.deviance, rel=1e-7, abs=1e-9)


def test_a_direction_without_a_measurement_stays_at_zero() -> None:
    A = np.array([[1.0, 1.0], [2.0, 2.0], [3.0, 3.0]])
    fit = LinearFit.of(A, np.array([2.0, 4.0, 6.5]))
    assert fit.step == pytest.approx([fit.step[0]] * 2)
    assert fit.deviance == pytest.approx(np.sum((np.array([2.0, 4.0, 6.5]) - A @ fit.step) ** 2))
    few = LinearFit.of(A[:1], np.array([2.0]))
    assert few.step == pytest.approx([1.0, 1.0])
    assert few.deviance == pytest.approx(0.0, abs=1e-12)


def test_a_damped_step_is_shorter_and_stays_within_its_bounds() -> None:
    rng = np.random.default_rng(2)
    A, b, wide = rng.normal(size=(9, 3)), rng.normal(size=9), np.full(3, 10.0)
    fit = LinearFit.of(A, b)
    damped = fit.bounded_step(-wide, wide, damping=4.0)
    weights = np.diag(np.sum(A**2, axis=0))
    np.testing.assert_allclose(damped, np.linalg.solve(A.T @ A + 4.0 * weights, A.T @ b), atol=1e-9)
    assert np.linalg.norm(damped) < np.linalg.norm(fit.step)
    np.testing.assert_allclose(fit.bounded_step(-wide, wide), fit.step, atol=1e-9)
    assert (np.abs(fit.bounded_step(-0.01 * wide / 10, 0.01 * wide / 10)) <= 0.01 + 1e-12).all()


def test_a_bounded_step_may_always_be_zero() -> None:
    fit = LinearFit.of(np.eye(2), np.array([2.0, -2.0]))
    beyond_zero = fit.bounded_step(np.array([-1.0, 0.5]), np.array([-0.5, 1.0]))
    np.testing.assert_allclose(beyond_zero, 0.0, atol=2e-12)
    np.testing.assert_allclose(fit.bounded_step(np.zeros(2), np.zeros(2)), 0.0, atol=2e-12)


def test_what_a_fit_cannot_absorb_is_orthogonal_to_it() -> None:
    rng = np.random.default_rng(4)
    A, columns = rng.normal(size=(12, 3)), rng.normal(size=(12, 2))
    remaining = unabsorbed(A, columns)
    np.testing.assert_allclose(A.T @ remaining, 0.0, atol=1e-12)
    np.testing.assert_allclose(unabsorbed(A, A @ rng.normal(size=3)), 0.0, atol=1e-12)
    np.testing.assert_array_equal(unabsorbed(np.zeros((12, 0)), columns), columns)
    mostly_absorbed = 1e8 * A @ rng.normal(size=3) + columns[:, 0]
    np.testing.assert_allclose(np.linalg.qr(A)[0].T @ unabsorbed(A, mostly_absorbed), 0.0, atol=1e-12)
