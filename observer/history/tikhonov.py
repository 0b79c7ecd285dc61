"""Li's batch identification: the stacked equation Z = H Q solved at once, regularised after Tikhonov.

The heats are Q = S w, where S makes the configured prior out of independent numbers w of variance 1
(`Prior`), and w minimises |Z - H S w|² + α |w|². With α = 1 that is the most probable history under the
prior, the one the smoother finds. Order 0 is Li's own: S is diagonal, and his parameter is α times the
noise's variance over the prior's. Everything is dense: time grows with the cube of the log's length, memory
with its square.
Source: Li et al. (2022), equations 36 to 39.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from observer.errors import UserError
from observer.frames import FloatArray
from observer.history.stacked import Prior, StackedProblem, accumulate

LARGEST_BYTES = 1.0e9
"""What H and the normal equations, with the copies made on the way, may take."""


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
