"""Lathe's conjugate gradients, for the whole history at once, with products by fast Fourier transform.

Minimises |Z - H S w|² over the same unknowns as `tikhonov`, from w = 0. H is Toeplitz: embedded in a
circulant it is a product of spectra, and so is its transpose, which gives the exact gradient in one product
in place of two simulations for each unknown. What regularises is the number of iterations: the descent ends
as soon as the misfit is what the noise alone may make, or does not get better any more.
Sources: direction, factor and step of Lathe's equations 13 to 17, for a linear plant those of Fletcher and
Reeves (1964); the discrepancy principle of Alifanov (1974).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from observer.frames import FloatArray
from observer.history.stacked import Prior, StackedProblem

_ITERATIONS = 1000
_REST = 1e-10
_PATIENCE, _WORTH_IT = 20, 1e-3
"""A descent goes on while twenty iterations still take a thousandth off the misfit."""


class Descent(NamedTuple):
    """Where a descent ended: the heats (T, m_e), the misfit |Z - H Q|², iterations, and if it was enough."""

    heat_W: FloatArray
    misfit: float
    iterations: int
    reached: bool


class Convolution:
    """H as a product of spectra. Source: Strang (1986) for the circulant embedding."""

    def __init__(self, response_K_W: FloatArray) -> None:
        """Transform the first block column, `response_K_W` (T, s, m_e), once."""
        from scipy import fft  # noqa: PLC0415 - slow to import

        self._fft = fft
        self._T = len(response_K_W)
        self._length = fft.next_fast_len(2 * self._T, real=True)
        self._spectrum = fft.rfft(response_K_W, self._length, axis=0)

    def forward(self, heat_W: FloatArray) -> FloatArray:
        """H Q: sensors (T + 1, s) from heats (T, m_e); nothing has come of them at the first row."""
        heats = self._fft.rfft(heat_W, self._length, axis=0)
        rows = np.einsum("fsm,fm->fs", self._spectrum, heats)
        out = np.zeros((self._T + 1, rows.shape[1]))
        out[1:] = self._fft.irfft(rows, self._length, axis=0)[: self._T]
        return out

    def adjoint(self, rows_K: FloatArray) -> FloatArray:
        """Hᵀ e: heats (T, m_e) from sensors (T + 1, s)."""
        rows = self._fft.rfft(rows_K[1:], self._length, axis=0)
        heats = np.einsum("fsm,fs->fm", self._spectrum.conj(), rows)
        return np.asarray(self._fft.irfft(heats, self._length, axis=0)[: self._T])


def descend(problem: StackedProblem, prior: Prior, H: Convolution, rise_K: FloatArray) -> Descent:
    """Return the first heats on the way to the minimum of |Z - H S w|² that explain Z to its noise.

    `rise_K` (K, s) is Z; it stands apart from the problem so that a simulated one can take its place.
    """
    w = np.zeros((problem.steps, problem.heats))
    error = problem.whiten(rise_K)
    direction, before, first = np.zeros_like(w), 0.0, 0.0
    # white noise of variance 1 has a square of M ± √(2 M); 95 % of logs are below this
    enough = problem.measurements + 2.0 * np.sqrt(2.0 * problem.measurements)
    misfits = [float(np.vdot(error, error))]
    while misfits[-1] > enough and len(misfits) <= _ITERATIONS:
        if len(misfits) > _PATIENCE and misfits[-1] > (1.0 - _WORTH_IT) * misfits[-1 - _PATIENCE]:
            break
        gradient = -prior.adjoint(H.adjoint(problem.whiten_adjoint(error)))
        steepness = float(np.vdot(gradient, gradient))
        first = first or steepness
        if steepness <= _REST**2 * first:
            break
        direction = gradient + (steepness / before if before else 0.0) * direction
        change = problem.whiten(H.forward(prior.heats(direction)))
        step = float(np.vdot(gradient, direction) / np.vdot(change, change))
        w -= step * direction
        error += step * change
        before = steepness
        misfits.append(float(np.vdot(error, error)))
    return Descent(prior.heats(w), misfits[-1], len(misfits) - 1, misfits[-1] <= enough)
