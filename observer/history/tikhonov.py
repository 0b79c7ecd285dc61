"""Li's batch identification: the stacked equation Z = H Q solved at once, regularised after Tikhonov.

The heats are Q = S w, where S makes the configured prior out of independent numbers w of variance 1
(`Prior`), and w minimises |Z - H S w|² + α |w|². With α = 1 that is the most probable history under the
prior, the one the smoother finds. Order 0 is Li's own: S is diagonal, and his parameter is α times the
noise's variance over the prior's. Everything is dense: time grows with the cube of the log's length, memory
with its square.
Source: Li et al. (2022), equations 36 to 39.

How much weight α the prior gets is Li's ICO as printed, or one of three rules with a stopping criterion. All
work on the spectrum of the normal equations, G = V diag(λ) Vᵀ and c = Vᵀ b, where each trial costs n
operations: |Z - H S w|² = |Z|² - Σ c²(λ + 2α)/(λ + α)², |w|² = Σ c²/(λ + α)², and the trace of the influence
matrix is Σ λ/(λ + α).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from observer.errors import UserError
from observer.frames import FloatArray
from observer.history.stacked import Prior, StackedProblem, accumulate

LARGEST_BYTES = 1.0e9
"""Memory limit of H and the normal equations with their temporary copies."""


class NormalEquations(NamedTuple):
    """G = (H S)ᵀ H S and b = (H S)ᵀ Z, both whitened, (n, n) and (n,) with n = T m_e; `square` is |Z|²."""

    G: FloatArray
    b: FloatArray
    square: float


def normal_equations(problem: StackedProblem, prior: Prior) -> NormalEquations:
    """Build H S and its normal equations.

    Raises `UserError` where they take more than a gigabyte.
    """
    n = problem.steps * problem.heats
    needed = 8.0 * n * (2.0 * problem.rise_K.size + 3.0 * n)
    if needed > LARGEST_BYTES:
        raise UserError(
            f"tikhonov takes {needed / 1e9:.3g} GB for {problem.steps} steps of {problem.heats} heats, and "
            f"is limited to {LARGEST_BYTES / 1e9:.3g} GB; use --method smoother, or a shorter log"
        )
    H = problem.whiten(_dense(problem, prior)).reshape(problem.rise_K.size, n)
    z = problem.whiten(problem.rise_K).ravel()
    return NormalEquations(H.T @ H, H.T @ z, float(z @ z))


def solve(
    problem: StackedProblem, prior: Prior, normal: NormalEquations, alpha: float
) -> tuple[FloatArray, FloatArray]:
    """Return w = (G + α I)⁻¹ b by Cholesky as heats (T, m_e), and their σ from S (G + α I)⁻¹ Sᵀ.

    Raises `UserError` where α is too small for the factorisation.
    """
    from scipy.linalg.lapack import dpotrf, dpotri, dpotrs  # noqa: PLC0415 - slow to import

    A = np.array(normal.G, order="F")
    A.flat[:: len(A) + 1] += alpha
    A, failed = dpotrf(A, lower=1, overwrite_a=1)
    if failed:
        raise UserError(
            f"tikhonov: a regularisation of {alpha:.3g} is too small, the equations are singular to "
            "rounding; choose a larger one"
        )
    w, _ = dpotrs(A, normal.b, lower=1)
    A, _ = dpotri(A, lower=1, overwrite_c=1)
    shape = (problem.steps, problem.heats)
    covariance = np.tril(A) + np.tril(A, -1).T
    return prior.heats(w.reshape(shape)), _sigma(prior, covariance, shape)


def _sigma(prior: Prior, covariance: FloatArray, shape: tuple[int, int]) -> FloatArray:
    """√ of the diagonal of S P Sᵀ, (T, m_e)."""
    n = len(covariance)
    half = prior.heats(covariance.reshape(*shape, n)).reshape(n, n).T
    whole = prior.heats(np.ascontiguousarray(half).reshape(*shape, n)).reshape(n, n)
    return np.sqrt(np.maximum(np.diag(whole), 0.0)).reshape(shape)


def _dense(problem: StackedProblem, prior: Prior) -> FloatArray:
    """H S as (K, s, T, m_e): the first block column, moved down by one block for each step."""
    T, s, m = problem.response_K_W.shape
    column = accumulate(np.moveaxis(problem.response_K_W, 2, 1).copy(), prior.keep)
    column = np.moveaxis(column, 1, 2)
    H = np.zeros((T + 1, s, T, m))
    for step in range(T):
        H[step + 1 :, :, step] = column[: T - step] * (prior.step_W if step else prior.first_W)
    return H


_SPAN = 12.0
"""Decades searched below the largest eigenvalue."""
_PER_DECADE = 8
_STANDSTILL = 0.02
ICO_DECADES = 12.0
ICO_TRIALS, ICO_ROUNDS, ICO_TOLERANCE = 10, 40, 1e-3


class Spectrum(NamedTuple):
    """Eigenvalues (n,), coefficients c (n,), |Z|², and the number of values in Z."""

    eigenvalues: FloatArray
    coefficients: FloatArray
    square: float
    measurements: int

    @classmethod
    def of(cls, normal: NormalEquations, measurements: int) -> Spectrum:
        """Decompose the normal equations."""
        from scipy.linalg import eigh  # noqa: PLC0415 - slow to import

        eigenvalues, vectors = eigh(normal.G, driver="evd", check_finite=False)
        return cls(np.maximum(eigenvalues, 0.0), vectors.T @ normal.b, normal.square, measurements)

    def misfit(self, alpha: float) -> float:
        """|Z - H S w|² of the solution for α."""
        e, c = self.eigenvalues, self.coefficients
        return max(self.square - float(np.sum(c**2 * (e + 2.0 * alpha) / (e + alpha) ** 2)), 0.0)

    def size(self, alpha: float) -> float:
        """|w|² of the solution for α."""
        return float(np.sum((self.coefficients / (self.eigenvalues + alpha)) ** 2))

    def freedom(self, alpha: float) -> float:
        """The effective degrees of freedom of the solution for α."""
        return float(np.sum(self.eigenvalues / (self.eigenvalues + alpha)))

    def trials(self) -> FloatArray:
        """α over the whole range that matters, ascending."""
        top = np.log10(self.eigenvalues[-1])
        return np.logspace(top - _SPAN, top + 2.0, int(_PER_DECADE * (_SPAN + 2.0)) + 1)


def by_discrepancy(spectrum: Spectrum) -> float:
    """Return the α at which the misfit is that of the noise alone. Source: Morozov (1966).

    The largest trial value if all explain the log, the smallest if none does.
    """
    from scipy.optimize import brentq  # noqa: PLC0415 - slow to import

    trials = spectrum.trials()
    wanted = float(spectrum.measurements)
    if spectrum.misfit(trials[0]) >= wanted:
        return float(trials[0])
    if spectrum.misfit(trials[-1]) <= wanted:
        return float(trials[-1])
    low, high = float(np.log(trials[0])), float(np.log(trials[-1]))

    def excess(log_alpha: float) -> float:
        return spectrum.misfit(float(np.exp(log_alpha))) - wanted

    return float(np.exp(brentq(excess, low, high, xtol=1e-6)))


def by_gcv(spectrum: Spectrum) -> float:
    """Return the α of least misfit/(M - trace)², generalised cross-validation.

    It needs no noise level. Source: Golub, Heath and Wahba (1979).
    """
    from scipy.optimize import minimize_scalar  # noqa: PLC0415 - slow to import

    def score(log_alpha: float) -> float:
        alpha = float(np.exp(log_alpha))
        return spectrum.misfit(alpha) / (spectrum.measurements - spectrum.freedom(alpha)) ** 2

    logs = np.log(spectrum.trials())
    best = int(np.argmin([score(v) for v in logs]))
    bounds = logs[max(best - 1, 0)], logs[min(best + 1, len(logs) - 1)]
    return float(np.exp(minimize_scalar(score, bounds=bounds, method="bounded").x))


def by_l_curve(spectrum: Spectrum) -> float:
    """Return the α at the corner of log |w| over log |Z - H S w|, its point of greatest curvature.

    Source: Hansen (1992), the curvature from differences along log α.
    """
    trials = spectrum.trials()
    x = 0.5 * np.log([max(spectrum.misfit(a), 1e-300) for a in trials])
    y = 0.5 * np.log([max(spectrum.size(a), 1e-300) for a in trials])
    dx, dy = np.gradient(x), np.gradient(y)
    ddx, ddy = np.gradient(dx), np.gradient(dy)
    pace = np.hypot(dx, dy)
    moves = pace > _STANDSTILL * pace.max()  # where the curve does not move, its curvature is rounding
    bend = np.where(moves, (dx * ddy - dy * ddx) / np.where(moves, pace, 1.0) ** 3, -np.inf)
    return float(trials[1 + np.argmax(bend[1:-1])])


def by_ico(
    spectrum: Spectrum,
    seed: int,
    *,
    bounds: tuple[float, float] | None = None,
    tolerance: float = ICO_TOLERANCE,
) -> tuple[float, FloatArray]:
    """Return Li's choice of α and the α kept after each round (…,), as printed.

    Draw ten values evenly in [low, high], keep the one of smallest W = |Z^α - Z|/|Z|, stop if W is below
    `tolerance`, else keep the half of the interval it lies in. W decreases with α without limit, so this ends
    at the lower bound unless the tolerance stops it. Without `bounds`, those are the largest eigenvalue and
    twelve decades below it. Source: Li et al. (2022), equations 40 to 42.
    """
    low, high = bounds or (spectrum.eigenvalues[-1] * 10.0**-ICO_DECADES, spectrum.eigenvalues[-1])
    rng = np.random.default_rng(seed)
    kept: list[float] = []
    for _ in range(ICO_ROUNDS):
        width = high - low
        drawn = low + width * rng.random(ICO_TRIALS)
        W = [np.sqrt(spectrum.misfit(float(a)) / spectrum.square) for a in drawn]
        best = int(np.argmin(W))
        kept.append(float(drawn[best]))
        if W[best] <= tolerance:
            break
        if drawn[best] - low < 0.5 * width:
            high -= 0.5 * width
        else:
            low += 0.5 * width
    return kept[-1], np.array(kept)
