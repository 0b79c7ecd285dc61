"""Li's batch identification, Z = H Q regularised after Tikhonov, solved in the time domain.

The heats are Q = Q_law + S w. S makes the prior from independent numbers w of variance 1
(`observer.history.prior`), and w minimises |Z - H S w|² + α |w|². This is the most probable history of a
prior whose variances are divided by α. So the smoother with such a prior finds it, with its σ, in a time that
grows with the log's length. With order 1 and α = 1 it is the smoother without noise of the field. Order 0 is
Li's own: S is diagonal and Q_law is 0, and his parameter is α times the noise's variance over the prior's.
Source: Li et al. (2022), equations 36 to 39; the state-space form of a penalty, Kohn and Ansley (1987).

The weight α follows Li's ICO as printed, or one of three rules with a stopping criterion. GCV needs the trace
of the influence matrix. That is the sum of every reading's influence on its own smoothed value, which the
backward pass gives (Kohn and Ansley 1989).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from observer.config.estimator import EstimatorSettings
from observer.frames import FloatArray, Inputs
from observer.history.prior import independent, jumps_W, walking
from observer.history.smoother import Smoothed, smooth_all, smooth_heats
from observer.history.sweeps import Sweeps, readings
from observer.model.plant import Plant

_OPEN = 1e9
_DIGITS = 3e-5


class Trial(NamedTuple):
    """A solution for one weight in numbers.

    Attributes:
        alpha: The weight α.
        misfit: |Z - H Q|², in units of the noise's variance.
        size: |w|² of its heats.
        free: Number of measurements minus the trace of the influence matrix.
        measurements: Number of measurements.
    """

    alpha: float
    misfit: float
    size: float
    free: float
    measurements: int


class Regularised:
    """The regularised solutions of one log with one prior, by α; each is computed once.

    Attributes:
        top: Largest eigenvalue of (H S)ᵀ R⁻¹ H S. Weights far above it leave no heat beyond the prior's.
    """

    def __init__(
        self, plant: Plant, settings: EstimatorSettings, blocks: Sequence[Inputs], order: int
    ) -> None:
        """Leave out the readings that the smoother's gate rejects, so that all solutions use the same ones.

        Args:
            plant: The model.
            settings: The table `[estimator]`.
            blocks: Consecutive blocks of inputs.
            order: Order of the prior, 0 or 1.

        Raises:
            UserError: If fewer than three steps have a measurement.
        """
        accepted = np.isfinite(smooth_heats(plant, settings, blocks).residual_K)
        block_starts = np.cumsum([0, *map(len, blocks)])
        self._blocks = [
            block._replace(usable=block.usable & accepted[begin : begin + len(block)])
            for block, begin in zip(blocks, block_starts, strict=False)
        ]
        self._plant, self._prior = plant, walking if order == 1 else independent
        self._settings, self._order = settings.model_copy(update={"gate_sigma": _OPEN}), order
        self._log = readings(plant, self._blocks, order)
        self._sigma_W, self._keep = jumps_W(plant, self._log.inputs, order)
        self._tried: dict[float, Trial] = {}
        self.top = Sweeps(plant, self._log.inputs, order).largest(self._log.weight_1_K)

    def solve(self, alpha: float) -> Smoothed:
        """Return the solution for α: heats, σ and residuals; NaN in rows before the first measurement."""
        plant, blocks, steps = self._prior(self._plant, self._blocks, alpha)
        solution = smooth_all(plant, self._settings, blocks, steps)
        return solution if self._order == 1 else self._as_jumps(solution, alpha)

    def _as_jumps(self, solution: Smoothed, alpha: float) -> Smoothed:
        """Return the heats of order 0; σ is NaN where it is the rounding of so wide a prior."""
        sigma_W, start = solution.jump_sigma, self._log.first
        sigma_W[sigma_W < _DIGITS * self._plant.initial_sigma_W / np.sqrt(alpha)] = np.nan
        for values in (solution.jump, sigma_W):  # the first row has no step before it
            values[start] = values[start + 1]
        return solution._replace(heat=solution.jump, sigma=sigma_W)

    def trial(self, alpha: float) -> Trial:
        """Return the solution for α in numbers, computed once."""
        if alpha not in self._tried:
            fit = self.solve(alpha)
            misfit = np.nansum(fit.residual**2 / self._plant.noise_R_K2)
            free, used = float(np.nansum(fit.free)), int(np.count_nonzero(np.isfinite(fit.residual)))
            self._tried[alpha] = Trial(alpha, float(misfit), self._size(fit.heat), free, used)
        return self._tried[alpha]

    def _size(self, heat_W: FloatArray) -> float:
        """Return |w|² of heats (K, m_e)."""
        departure_W = heat_W[self._log.first :] - self._log.inputs.law_W[:, self._plant.estimated]
        jump = departure_W[1:] - self._keep[1:] * departure_W[:-1]
        jump[0] = departure_W[1]
        return float(np.nansum((jump / self._sigma_W[1:]) ** 2))


_SPAN = 12
"""Decades searched below the largest eigenvalue of (H S)ᵀ H S."""
BENDS = 3
"""Trials in a decade that show how the L-curve bends."""
_FINER = 64
_STANDSTILL = 0.02
ICO_DECADES = 12.0
ICO_TRIALS, ICO_ROUNDS, ICO_TOLERANCE = 10, 40, 1e-3
Try = Callable[[float], Trial]


def trials(top: float, per_decade: int = 1) -> FloatArray:
    """Return α over the whole relevant range, ascending: twelve decades below the largest eigenvalue to one
    above.

    Args:
        top: The largest eigenvalue.
        per_decade: Number of values in a decade.
    """
    return np.asarray(top * np.logspace(-_SPAN, 1, per_decade * (_SPAN + 1) + 1))


def by_discrepancy(trial: Try, alphas: FloatArray) -> float:
    """Return the α at which the misfit is that of the noise alone. Source: Morozov (1966).

    Args:
        trial: Returns the solution for a weight.
        alphas: The range, ascending.

    Returns:
        The weight. The largest of `alphas` if all explain the log, the smallest if none does.
    """
    from scipy.optimize import brentq  # noqa: PLC0415 - slow to import

    def excess(log_alpha: float) -> float:
        solution = trial(float(np.exp(log_alpha)))
        return solution.misfit / solution.measurements - 1.0

    low, high = float(np.log(alphas[0])), float(np.log(alphas[-1]))
    if excess(low) >= 0.0:
        return float(alphas[0])
    if excess(high) <= 0.0:
        return float(alphas[-1])
    return float(np.exp(brentq(excess, low, high, xtol=1e-3)))


def by_gcv(trial: Try, alphas: FloatArray) -> float:
    """Return the α of least misfit/(M - trace)², generalised cross-validation.

    It needs no noise level. Source: Golub, Heath and Wahba (1979).

    Args:
        trial: Returns the solution for a weight.
        alphas: The range, ascending; the best of them is refined between its neighbours.
    """
    from scipy.optimize import minimize_scalar  # noqa: PLC0415 - slow to import

    def score(log_alpha: float) -> float:
        solution = trial(float(np.exp(log_alpha)))
        return solution.misfit / solution.free**2

    logs = np.log(alphas)
    best = int(np.argmin([score(v) for v in logs]))
    bounds = logs[max(best - 1, 0)], logs[min(best + 1, len(logs) - 1)]
    return float(np.exp(minimize_scalar(score, bounds=bounds, method="bounded", options={"xatol": 0.05}).x))


def by_l_curve(trial: Try, alphas: FloatArray) -> float:
    """Return the α at the corner of log |w| over log |Z - H S w|, its point of greatest curvature.

    Source: Hansen (1992), the curvature from cubic splines along log α.

    Args:
        trial: Returns the solution for a weight.
        alphas: Weights at which the curve is computed, ascending, three per decade or more.
    """
    from scipy.interpolate import CubicSpline  # noqa: PLC0415 - slow to import

    solutions, logs = [trial(float(alpha)) for alpha in alphas], np.log(alphas)
    x, y = (
        CubicSpline(logs, 0.5 * np.log(np.maximum(values, 1e-300)))
        for values in ([t.misfit for t in solutions], [t.size for t in solutions])
    )
    fine = np.linspace(logs[0], logs[-1], _FINER * len(logs))
    pace = np.hypot(x(fine, 1), y(fine, 1))
    is_moving = pace > _STANDSTILL * pace.max()  # where the curve does not move, its curvature is rounding
    turn = x(fine, 1) * y(fine, 2) - y(fine, 1) * x(fine, 2)
    bend = np.where(is_moving, turn / np.where(is_moving, pace, 1.0) ** 3, -np.inf)
    return float(np.exp(fine[1 + np.argmax(bend[1:-1])]))


def by_ico(
    trial: Try,
    top: float,
    seed: int,
    *,
    bounds: tuple[float, float] | None = None,
    tolerance: float = ICO_TOLERANCE,
) -> tuple[float, FloatArray]:
    """Return Li's choice of α and the α kept after each round (…,), as printed.

    Draw ten values evenly in [low, high], and keep the one of smallest W = |Z^α - Z|/|Z|. Stop if W is below
    `tolerance`, else keep the half of the interval that contains it. W falls with α, so the smallest value
    drawn is kept, and the other nine need not be solved. W falls without limit, so the search ends at the
    lower bound unless the tolerance stops it. The default `bounds` are the largest eigenvalue `top` and
    twelve decades below it. Source: Li et al. (2022), equations 40 to 42.

    Args:
        trial: Returns the solution for a weight.
        top: The largest eigenvalue of (H S)ᵀ R⁻¹ H S.
        seed: Seed of the draws.
        bounds: First interval, or None for the default.
        tolerance: W at which the search ends.
    """
    low, high = bounds or (top * 10.0**-ICO_DECADES, top)
    rng = np.random.default_rng(seed)
    smallest: list[float] = []
    for _ in range(ICO_ROUNDS):
        width = high - low
        smallest.append(float(low + width * rng.random(ICO_TRIALS).min()))
        if smallest[-1] - low < 0.5 * width:
            high -= 0.5 * width
        else:
            low += 0.5 * width
    without_heat = trial(_OPEN * top).misfit  # |Z|²: so heavy a prior leaves no heat

    def stops(alpha: float) -> bool:
        return trial(alpha).misfit <= tolerance**2 * without_heat

    # W falls with α: of the values kept, in order of size, bisection finds those that stop the rounds
    ascending, stopping, others = sorted(set(smallest)), 0, len(set(smallest))
    while stopping < others:
        middle = (stopping + others) // 2
        if stops(ascending[middle]):
            stopping = middle + 1
        else:
            others = middle
    last = next((i for i, alpha in enumerate(smallest) if alpha in ascending[:stopping]), len(smallest) - 1)
    return smallest[last], np.array(smallest[: last + 1])
