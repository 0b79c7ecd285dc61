"""Intervals of fitted parameters when the residuals are coloured, as those of a real screw always are."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from observer.frames import FloatArray


def covariance(
    jacobian: FloatArray, residual: FloatArray, lengths: Sequence[int]
) -> tuple[FloatArray, float]:
    """Return the covariance (p, p) of a least-squares fit, and the degrees of freedom left.

    P = H⁻¹ (Σ_t J_tᵀ D S D J_t) H⁻¹ with H = JᵀJ, S (s, s) the residuals' covariance between sensors and
    D = diag √τ, τ the time over which each sensor's residual resembles itself, in samples. With white
    residuals it is the textbook's s² H⁻¹. (A sandwich estimate; White 1980, with Geyer's 1992 sum for τ.)

    It holds at the values of the parameters that were not fitted; what is wrong with those is not in it.

    Takes `jacobian` (n, s, p), `residual` (n, s) and the number of samples of each run.
    """
    n, _, p = jacobian.shape
    tau = correlation_time(residual, lengths)
    S = residual.T @ residual / n
    coloured = S * np.sqrt(np.outer(tau, tau))
    middle = np.einsum("nap,ab,nbq->pq", jacobian, coloured, jacobian, optimize=True)
    H_inverse = np.linalg.inv(np.einsum("nap,naq->pq", jacobian, jacobian))
    freedom = max(float(np.sum(n / tau)) - p, 1.0)
    return np.asarray(H_inverse @ middle @ H_inverse), freedom


def correlation_time(residual: FloatArray, lengths: Sequence[int]) -> FloatArray:
    """Return 1 + 2 Σ ρ_k of each sensor's residual (n, s) in samples, (s,); at least 1.

    The autocorrelation is summed in pairs of lags while a pair is positive (Geyer 1992): beyond, it
    is noise. Lags do not cross from one run to the next.
    """
    parts = np.split(residual, np.cumsum(lengths)[:-1])
    tau = np.ones(residual.shape[1])
    for i in range(len(tau)):
        rho = _autocorrelation([part[:, i] for part in parts])
        pairs = rho[1 : len(rho) - 1 : 2] + rho[2::2]
        stop = np.flatnonzero(pairs <= 0)
        tau[i] = max(1.0, 1.0 + 2.0 * float(np.sum(pairs[: stop[0] if len(stop) else None])))
    return tau


def half_width(cov: FloatArray, freedom: float) -> FloatArray:
    """Return half the width (p,) of the 95 % intervals by Student's t."""
    from scipy.special import stdtrit  # noqa: PLC0415 - slow to import

    return np.asarray(float(stdtrit(freedom, 0.975)) * np.sqrt(np.diag(cov)))


def _autocorrelation(parts: Sequence[FloatArray]) -> FloatArray:
    """ρ_0 … of a signal about zero, up to half the longest run, an odd number of lags."""
    lags = max(len(part) for part in parts) // 4 * 2 + 1
    total = np.zeros(lags)
    for part in parts:
        spectrum = np.fft.rfft(part, 2 * len(part))
        own = np.fft.irfft(np.abs(spectrum) ** 2)[: min(len(part), lags)]
        total[: len(own)] += own
    return np.asarray(total / total[0] if total[0] > 0 else np.eye(1, lags)[0])
