from __future__ import annotations

import numpy as np
import pytest

from observer.fit.interval import correlation_time, covariance, half_width


def _coloured(rng: np.random.Generator, rho: float, n: int, s: int) -> np.ndarray:
    """A first-order process of correlation rho, and white noise as large as its steps."""
    w = rng.normal(size=(n, s))
    e = np.empty((n, s))
    e[0] = w[0] / np.sqrt(1 - rho**2)
    for k in range(1, n):
        e[k] = rho * e[k - 1] + w[k]
    return e + rng.normal(size=(n, s))


@pytest.mark.parametrize("rho", [0.0, 0.5, 0.9])
def test_intervals_cover_with_coloured_residuals(rho: float) -> None:
    rng = np.random.default_rng(20)
    n, t = 300, np.linspace(0, 1, 300)
    rise = np.outer(1 - np.exp(-6 * t), [1.0, 0.7, 0.4])
    fall = np.outer(t * np.exp(-3 * t), [0.3, 1.0, 0.8])
    J = np.stack([rise, fall], axis=2)
    hits, draws = np.zeros(2), 400
    for _ in range(draws):
        e = _coloured(rng, rho, n, 3)
        fit = np.linalg.lstsq(J.reshape(-1, 2), e.ravel())[0]
        hits += np.abs(fit) < half_width(*covariance(J, e - J @ fit, [n]))
    # 400 draws of 95 %: three standard deviations are 3.3 %; the estimated correlation costs some more
    assert np.all(hits / draws > 0.90)
    assert np.all(hits / draws < 0.985)


def test_the_correlation_time_is_that_of_a_first_order_process() -> None:
    rng = np.random.default_rng(3)
    rho, n = 0.8, 40_000
    w = rng.normal(size=n)
    e = np.empty((n, 1))
    e[0] = w[0]
    for k in range(1, n):
        e[k] = rho * e[k - 1] + w[k]
    # (1 + ρ)/(1 − ρ) = 9; the sum stops in noise, good to some per cent at this length
    assert correlation_time(e, [n // 2, n // 2])[0] == pytest.approx(9.0, rel=0.1)


def test_runs_do_not_touch() -> None:
    """Two runs that end high and begin low would anticorrelate across the join."""
    e = np.concatenate([np.ones((50, 1)), -np.ones((50, 1))])
    apart, together = correlation_time(e, [50, 50])[0], correlation_time(e, [100])[0]
    assert apart == pytest.approx(1 + 2 * sum((50 - k) / 50 for k in range(1, 25)))
    assert together != pytest.approx(apart)


def test_what_is_fitted_is_taken_off_the_degrees_of_freedom() -> None:
    """Signs that alternate resemble nothing: each value counts, and each parameter costs one."""
    signs = np.where(np.arange(10)[:, None] % 2, 1.0, -1.0) * [1.0, 2.0]
    J = np.random.default_rng(2).normal(size=(10, 2, 3))
    assert covariance(J, signs, [10])[1] == pytest.approx(17.0)
    assert covariance(J[:2], signs[:2], [2])[1] == pytest.approx(1.0), "one at the least"
