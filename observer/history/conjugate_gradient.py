"""Conjugate gradients: over the whole history at once, or step by step as Lathe printed them.

`descend` minimises |Z - H S w|² over the same unknowns as `tikhonov`, from w = 0. H is Toeplitz: embedded in
a circulant it is a product of spectra, and so is its transpose, which gives the exact gradient in one product
in place of two simulations for each unknown. The number of iterations regularises: the descent ends as soon
as the misfit is at the noise level, or no longer improves.
Sources: direction, factor and step of Lathe's equations 13 to 17, for a linear plant those of Fletcher and
Reeves (1964); the discrepancy principle of Alifanov (1974).

Neither gives a covariance: `spread` estimates their errors from simulated logs with known heats.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from observer.frames import FloatArray
from observer.history.stacked import Prior, StackedProblem
from observer.model.discretise import step_matrices
from observer.model.plant import Plant

_ITERATIONS = 1000
_REST = 1e-10
_STEP_ITERATIONS, _STEP_REST, _DIFFERENCE_W = 50, 1e-20, 1.0
_PATIENCE, _WORTH_IT = 20, 1e-3
"""A descent continues while twenty iterations still lower the misfit by a thousandth."""


class Descent(NamedTuple):
    """The end of a descent: heats (T, m_e), misfit |Z - H Q|², iterations, and whether it reached the noise
    level.
    """

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
        """H Q: sensors (T + 1, s) from heats (T, m_e); the first row is 0."""
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
    """Return the first iterate towards the minimum of |Z - H S w|² that explains Z to its noise level.

    `rise_K` (K, s) is Z, given separately so that a simulated one can replace that of the problem.
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


REPLICAS, REPLICAS_LONG, LONG = 24, 6, 3000
"""How many logs are drawn; fewer for a log of more than 3000 steps, which averages by itself."""
_SMOOTHED_SHARE = 0.05


def spread(
    problem: StackedProblem,
    walk: Prior,
    H: Convolution,
    find: Callable[[FloatArray], FloatArray],
    seed: int,
) -> FloatArray:
    """Return the root mean square error (T, m_e) of a method over logs drawn from the configured prior.

    `find` estimates heats (T, m_e) from Z (K, s). Heats, the initial field and the noise are drawn for each
    of 24 logs, or 6 long ones, of this log's length and missing values. The error includes noise, early
    stopping and missing sensors, as far as the configured walk describes this machine's heats.
    """
    rng = np.random.default_rng(seed)
    noise_K = np.where(problem.weight_1_K > 0.0, 1.0 / np.maximum(problem.weight_1_K, 1e-300), 0.0)
    squares = np.zeros((problem.steps, problem.heats))
    replicas = REPLICAS if problem.steps <= LONG else REPLICAS_LONG
    for _ in range(replicas):
        true_W = walk.heats(rng.standard_normal(squares.shape))
        seen_K = H.forward(true_W) + problem.draw_start(rng) + noise_K * rng.standard_normal(noise_K.shape)
        squares += (find(np.where(noise_K > 0.0, seen_K, 0.0)) - true_W) ** 2
    return np.sqrt(_smoothed(squares / replicas))


def _smoothed(variance: FloatArray) -> FloatArray:
    """Running means over a twentieth of the log: a few replicas give a variance to 30 % at best."""
    reach = max(int(_SMOOTHED_SHARE * len(variance)) // 2, 1)
    total = np.vstack([np.zeros((1, variance.shape[1])), np.cumsum(variance, axis=0)])
    row = np.arange(len(variance))
    low, high = np.maximum(row - reach, 0), np.minimum(row + reach + 1, len(variance))
    return np.asarray((total[high] - total[low]) / (high - low)[:, None])


def stepwise_heats(plant: Plant, problem: StackedProblem, rise_K: FloatArray) -> FloatArray:
    """Return the heats (T, m_e) found step by step from Z, `rise_K` (K, s); `plant` has no moving sources.

    At step n only q_n is unknown: J_n = Σ_i (T_i(q) - y_i)² is minimised by conjugate gradients from the
    heats of the step before, until J_n is at the noise level; then the step is final. Nothing links the
    steps, so each must be long enough for heat to reach the sensors; otherwise noise is taken for heat. The
    gradient is that of central differences of 1 W, as printed. Source: Lathe's equations 11 to 17.
    """
    decay = np.exp(-plant.decay_1_s * problem.dt_s)
    held = step_matrices(plant, problem.dt_s).hold[:, None] * plant.B[:, plant.estimated]
    C = plant.rows.C[: plant.rows.sensors]
    out = np.empty((problem.steps, problem.heats))
    G, x, q = C @ held, np.zeros(len(held)), np.zeros(problem.heats)
    for k, (y, weight) in enumerate(zip(rise_K[1:], problem.weight_1_K[1:], strict=True)):
        x *= decay
        used = weight > 0.0
        q = _descend_step(G[used], (C @ x - y)[used], q, float(np.sum(weight[used] ** -2.0)))
        out[k] = q
        x += held @ q
    return out


def _descend_step(G: FloatArray, off_K: FloatArray, q: FloatArray, enough_K2: float) -> FloatArray:
    """Return q for which |off + G q|² is at the noise level, or as small as fifty iterations make it."""

    def misfit_K2(q: FloatArray) -> float:
        error_K = off_K + G @ q
        return float(error_K @ error_K)

    direction, before, first = np.zeros_like(q), 0.0, 0.0
    apart = _DIFFERENCE_W * np.eye(len(q))
    for _ in range(_STEP_ITERATIONS):
        if misfit_K2(q) <= enough_K2:
            break
        gradient = np.array([misfit_K2(q + d) - misfit_K2(q - d) for d in apart]) / (2.0 * _DIFFERENCE_W)
        steepness = float(gradient @ gradient)
        first = first or steepness
        if steepness <= _STEP_REST * first:
            break
        direction = gradient + (steepness / before if before else 0.0) * direction
        change_K = G @ direction
        along = float(change_K @ change_K)
        q = q - (float((off_K + G @ q) @ change_K) / along if along > 0.0 else 0.0) * direction
        before = steepness
    return q
