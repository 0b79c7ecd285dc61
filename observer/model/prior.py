"""What is believed of the field before the first measurement, and of its unmodelled wandering."""

from __future__ import annotations

import numpy as np

from observer.frames import FloatArray
from observer.model.rod.modes import Modes
from observer.model.rod.static import quadrature

SMOOTHNESS = 0.25
"""Correlation length of an unknown field, as a part of the screw's length."""


def smooth_field_covariance(modes: Modes) -> FloatArray:
    """Covariance (N, N) of the modal amplitudes of a random field with 1 K standard deviation everywhere.

    Half of its variance is an unknown level, half an unknown shape, smooth over a quarter of the screw.
    """
    L = modes.rod.length_m
    x, w = quadrature(modes.rod, (), panels=max(24, len(modes) // 2))
    kernel = 0.5 + 0.5 * np.exp(-0.5 * ((x[:, None] - x) / (SMOOTHNESS * L)) ** 2)
    projection = (modes.theta(x) * w[:, None]).T / modes.rod.diffusivity_m2_s
    covariance = projection @ kernel @ projection.T
    return np.asarray((covariance + covariance.T) / 2)
