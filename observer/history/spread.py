"""How far off a method is that gives no covariance: by its errors on simulated logs whose heats are known."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from observer.frames import FloatArray
from observer.history.conjugate_gradient import Convolution
from observer.history.stacked import Prior, StackedProblem

REPLICAS, REPLICAS_LONG, LONG = 24, 6, 3000
"""How many logs are drawn; few where a log of more than 3000 steps holds many times to average over."""
_SMOOTHED_SHARE = 0.05


def spread(
    problem: StackedProblem,
    walk: Prior,
    H: Convolution,
    find: Callable[[FloatArray], FloatArray],
    seed: int,
) -> FloatArray:
    """Return the root mean square error (T, m_e) of a method over logs drawn from the configured prior.

    `find` makes heats (T, m_e) of Z (K, s). Heats, the field at the start and the noise are drawn anew for
    each of 24 logs, or of 6 where they are long, all of this log's length and gaps: what noise, stopping
    early and blind sensors do is in it, as far as the configured walk is true of this machine's heats.
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
    """Running means over a twentieth of the log: a few replicas tell a variance to 30 % at best."""
    reach = max(int(_SMOOTHED_SHARE * len(variance)) // 2, 1)
    total = np.vstack([np.zeros((1, variance.shape[1])), np.cumsum(variance, axis=0)])
    row = np.arange(len(variance))
    low, high = np.maximum(row - reach, 0), np.minimum(row + reach + 1, len(variance))
    return np.asarray((total[high] - total[low]) / (high - low)[:, None])
