"""What is believed of the field before the first measurement, and of its unmodelled wandering."""

from __future__ import annotations

from collections.abc import Iterator
from functools import lru_cache

import numpy as np

from observer.frames import FloatArray
from observer.model.rod.modes import Modes, held_s
from observer.model.rod.static import NODES, quadrature

SMOOTHNESS = 0.25
"""Correlation length of an unknown field, as a part of the screw's length."""
PAST = (1e-3, 1e-2, 1e-1)
"""How long sources may have been on before the start, in diffusion times L²/α (a minute to hours on 1 m)."""


def smooth_field_covariance(modes: Modes) -> FloatArray:
    """Covariance (N, N) of the modal amplitudes of a random field with 1 K standard deviation everywhere.

    Half of its variance is an unknown level, half an unknown shape, smooth over a quarter of the screw.
    """
    x, w = quadrature(modes.rod.length_m, (), panels=max(24, len(modes) // 2))
    kernel = _smooth_kernel(len(x), modes.rod.length_m)
    projection = (modes.theta(x) * w[:, None]).T / modes.rod.diffusivity_m2_s
    covariance = projection @ kernel @ projection.T
    return np.asarray((covariance + covariance.T) / 2)


@lru_cache(maxsize=4)
def _smooth_kernel(nodes: int, length_m: float) -> FloatArray:
    """The field's covariance between the nodes of the quadrature; the same for every material and film."""
    x, _ = quadrature(length_m, (), panels=nodes // NODES)
    return np.asarray(0.5 + 0.5 * np.exp(-0.5 * ((x[:, None] - x) / (SMOOTHNESS * length_m)) ** 2))


def past_heat_covariance(modes: Modes, inputs: FloatArray, sigma_W: FloatArray) -> FloatArray:
    """Covariance (N, N) of the modal amplitudes left by heats of unknown size before the start.

    A machine that has been running is not smoothly warm: the screw is hottest at the bearings. Each source,
    `inputs` (N, m) in its units of B, was on for each of three times, independently, with the
    σ of its unknown heat now, `sigma_W` (m,): r_n = b_n (1 − e^{−Λ_n t})/Λ_n.
    """
    covariance = np.zeros((len(modes), len(modes)))
    for gathered in gathered_s(modes.decay_1_s, modes.rod.length_m, modes.rod.diffusivity_m2_s):
        response = inputs * gathered * sigma_W
        covariance += response @ response.T
    return covariance


def gathered_s(decay_1_s: FloatArray, length_m: float, diffusivity_m2_s: float) -> Iterator[FloatArray]:
    """Yield what one watt or unit has made of modes (n,) after each of the times in `PAST`, (n, 1), s."""
    decay = decay_1_s[:, None]
    for share in PAST:
        t = share * length_m**2 / diffusivity_m2_s
        yield held_s(decay, t)
