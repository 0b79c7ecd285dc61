"""Least squares for slow predictions, by Gauss-Newton steps, damped where they diverge.

An own loop in place of scipy's, because a search stops a fit that cannot overtake its rival, and keeps
derivatives over small steps; the bounded step itself is scipy's.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from observer.frames import FloatArray

TRIALS = 8
"""How often a diverging step is shortened."""


class Range(NamedTuple):
    """Where parameters (p,) may go: between bounds, and no further than `reach` in one step."""

    low: FloatArray
    high: FloatArray
    reach: FloatArray

    def step(self, theta: FloatArray) -> tuple[FloatArray, FloatArray]:
        """The smallest and the largest step (p,) from a point."""
        return np.maximum(self.low - theta, -self.reach), np.minimum(self.high - theta, self.reach)


class Stop(NamedTuple):
    """When a fit ends: after so many steps, after one that lowers the sum of squares by less than `little` or
    is `small` in standard deviations of every parameter, or when it would not reach a `rival`'s sum of
    squares in the remaining steps at its current rate.
    """

    steps: int
    little: float
    small: float
    rival: float = np.inf


class Minimum(NamedTuple):
    """The end of a fit: parameters (p,), the residual (n,) there, and its derivatives (n, p) nearby."""

    theta: FloatArray
    residual: FloatArray
    jacobian: FloatArray


def minimise(
    residual: Callable[[FloatArray], FloatArray],
    slope: Callable[[FloatArray], FloatArray],
    weighed: Callable[[FloatArray], FloatArray],
    start: FloatArray,
    within: Range,
    stop: Stop,
) -> Minimum:
    """Return where the sum of squares of `weighed(residual)` is least.

    `slope` returns the derivatives (n, p) of the prediction, that is of the residual with its sign changed.
    """
    theta, here, damping = start, residual(start), 0.0
    J = slope(theta)
    for left in reversed(range(stop.steps if len(theta) else 0)):
        A, b = weighed(J), weighed(here)
        before = _squares(b)
        if not (np.isfinite(A).all() and np.isfinite(before)):
            break
        for _trial in range(TRIALS):
            step, sigma = _bounded_step(A, b, *within.step(theta), damping)
            there = residual(theta + step)
            now = _squares(weighed(there))
            if now <= before + 1e-9:  # not where it has overflown
                break
            damping = max(10 * damping, 1e-3)
        else:
            break
        theta, here = np.clip(theta + step, within.low, within.high), there
        damping = damping / 10 if damping > 1e-4 else 0.0
        hopeless = (before - now) * left < now - stop.rival
        if np.max(np.abs(step) / sigma) < stop.small or before - now < stop.little or hopeless:
            break
        J = slope(theta)
    return Minimum(theta, here, -J)


def _squares(values: FloatArray) -> float:
    return float(np.sum(values**2))


def _bounded_step(
    A: FloatArray, b: FloatArray, low: FloatArray, high: FloatArray, damping: float
) -> tuple[FloatArray, FloatArray]:
    """The damped step that minimises ‖b − A step‖² + damping ‖D step‖² within bounds, D the columns' lengths,
    and each parameter's standard deviation (Levenberg 1944; Marquardt 1963).
    """
    from scipy.optimize import lsq_linear  # noqa: PLC0415 - slow to import

    R = np.asarray(np.linalg.qr(np.column_stack([A, b]), mode="r"))
    p = A.shape[1]
    bounds = (np.minimum(low, 0.0) - 1e-12, np.maximum(high, 0.0) + 1e-12)
    damp = np.diag(np.sqrt(damping) * np.linalg.norm(R[:p, :p], axis=0))
    solved = lsq_linear(np.vstack([R[:p, :p], damp]), np.concatenate([R[:p, p], np.zeros(p)]), bounds=bounds)
    sigma = np.sqrt(np.maximum(np.diag(np.linalg.pinv(R[:p, :p].T @ R[:p, :p])), 0.0)) + 1e-12
    return np.asarray(solved.x), sigma
