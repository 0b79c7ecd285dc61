"""Linear least squares of whitened measurements, the one form that every fit of this project takes.

The measurements are b = A θ + T z + e. The parameters θ are sought. The errors e have variance 1, and so have
the nuisance parameters z. `Marginal` takes T z out of all columns. `LinearFit` then gives θ, its covariance
and the remaining squares. Both are pure functions of arrays without units: whitening divides by the noise.

Sources: Lawson and Hanson (1974) for the triangle; Bierman (1977) for a prior as further rows.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from observer.frames import FloatArray

LEAST_SINGULAR = 1e-8
"""Directions with a singular value below this share of the largest are not determined: their step is 0."""


class Marginal(NamedTuple):
    """The map (I + T Tᵀ)^{-1/2} = I − Q diag(1 − 1/√(1 + σ²)) Qᵀ for nuisances T = Q diag(σ) Vᵀ, (n, t).

    The squares of mapped residuals are those that remain with the most probable z, plus |z|².

    Attributes:
        Q: Left singular vectors of T, (n, min(n, t)).
        taken: 1 − 1/√(1 + σ²), the part of each direction that the nuisances take.
    """

    Q: FloatArray
    taken: FloatArray

    @classmethod
    def of(cls, T: FloatArray) -> Marginal:
        """Return the map for the whitened changes T (n, t) by one standard deviation of each nuisance."""
        Q, sigma, _ = np.linalg.svd(T, full_matrices=False)
        return cls(Q, 1 - 1 / np.sqrt(1 + sigma**2))

    def __call__(self, columns: FloatArray) -> FloatArray:
        """Return columns (n,) or (n, c) mapped."""
        return np.asarray(columns - (self.Q * self.taken) @ (self.Q.T @ columns))


class LinearFit(NamedTuple):
    """The sum of squares |b − A θ|² in the form |d − R θ|² + `floor`.

    Attributes:
        R: Upper triangle (r, p), r ≤ p.
        d: Right side (r,).
        floor: Squares that no θ removes.
    """

    R: FloatArray
    d: FloatArray
    floor: float = 0.0

    @classmethod
    def of(cls, A: FloatArray, b: FloatArray, prior_weight: FloatArray | float = 0.0) -> LinearFit:
        """Return the fit of A (n, p) to b (n,), by a QR decomposition of [A, b].

        Args:
            A: Whitened derivatives.
            b: Whitened measurements.
            prior_weight: One over the standard deviation of each parameter about 0 before the fit, (p,); 0
                where nothing is known of it.
        """
        p = A.shape[1]
        rows = np.column_stack([A, b])
        if np.any(prior_weight):
            weights = np.diag(np.broadcast_to(prior_weight, p))
            rows = np.vstack([rows, np.column_stack([weights, np.zeros(p)])])
        triangle = np.asarray(np.linalg.qr(rows, mode="r"))
        return cls(triangle[:p, :p], triangle[:p, p], float(np.sum(triangle[p:, p] ** 2)))

    @classmethod
    def of_information(cls, information: FloatArray, gradient: FloatArray) -> LinearFit:
        """Return the fit with given normal equations, by a Cholesky decomposition.

        Its `floor` is unknown and stands as 0.

        Args:
            information: Aᵀ A with any prior, (p, p).
            gradient: Aᵀ b, (p,).

        Raises:
            numpy.linalg.LinAlgError: `information` is not positive definite.
        """
        R = np.asarray(np.linalg.cholesky(information).T)
        return cls(R, np.asarray(np.linalg.solve(R.T, gradient)))

    @property
    def step(self) -> FloatArray:
        """The shortest θ (p,) with the least sum of squares; undetermined directions stay 0."""
        return np.asarray(np.linalg.lstsq(self.R, self.d, rcond=LEAST_SINGULAR)[0])

    @property
    def covariance(self) -> FloatArray:
        """The covariance (p, p) of θ, by the pseudo-inverse; undetermined directions have no variance in
        it.
        """
        return np.asarray(np.linalg.pinv(self.R.T @ self.R))

    @property
    def sigma(self) -> FloatArray:
        """The standard deviation (p,) of each parameter."""
        return np.sqrt(np.maximum(np.diag(self.covariance), 0.0))

    @property
    def deviance(self) -> float:
        """The least sum of squares, |d − R θ|² + `floor` at `step`."""
        return self.floor + float(np.sum((self.d - self.R @ self.step) ** 2))

    def bounded_step(self, low: FloatArray, high: FloatArray, damping: float = 0.0) -> FloatArray:
        """Return the θ (p,) between bounds that minimises |b − A θ|² + `damping` |D θ|².

        D are the lengths of A's columns (Levenberg 1944; Marquardt 1963). θ = 0 is always allowed, and bounds
        are met to 1e-12.

        Args:
            low: Lower bounds (p,).
            high: Upper bounds (p,).
            damping: 0 for none.
        """
        from scipy.optimize import lsq_linear  # noqa: PLC0415 - slow to import

        damped = np.diag(np.sqrt(damping) * np.linalg.norm(self.R, axis=0))
        b = np.concatenate([self.d, np.zeros(len(damped))])
        bounds = np.minimum(low, 0.0) - 1e-12, np.maximum(high, 0.0) + 1e-12
        return np.asarray(lsq_linear(np.vstack([self.R, damped]), b, bounds=bounds).x)


def unabsorbed(A: FloatArray, columns: FloatArray) -> FloatArray:
    """Return the part of columns that no combination of the columns of A can make.

    Args:
        A: Basis (n, p), of full rank.
        columns: (n,) or (n, c); the result has the same shape.
    """
    Q = np.linalg.qr(A)[0]
    for _ in range(2):  # twice is enough (Giraud, Langou & Rozložník 2005)
        columns = columns - Q @ (Q.T @ columns)
    return columns
