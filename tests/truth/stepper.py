"""Implicit stepping of C dT/dt = −K T + f for a symmetric banded K, many right-hand sides at once.

TR-BDF2 (Bank et al., 1985) with γ = 2 − √2: second order, L-stable, both stages share one matrix, and a load
constant over the step enters with exactly its energy.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from scipy.linalg import cho_solve_banded, cholesky_banded

from tests.truth.bar import FloatArray

GAMMA = 2.0 - math.sqrt(2.0)
WEIGHT = 1.0 / (GAMMA * (2.0 - GAMMA))


@dataclass(frozen=True)
class Network:
    """Heat capacities and conductances of a mesh.

    `capacity_J_K` (n,); `bands_W_K` (b + 1, n), the lower diagonals of K (row 0 is the diagonal), as in
    `scipy.linalg.cholesky_banded(lower=True)`.
    """

    capacity_J_K: FloatArray
    bands_W_K: FloatArray
    _factors: dict[float, FloatArray] = field(default_factory=dict, repr=False)

    def conduct(self, temperature_K: FloatArray) -> FloatArray:
        """K T for temperatures (n, R)."""
        heat = self.bands_W_K[0][:, None] * temperature_K
        for offset in range(1, len(self.bands_W_K)):
            band = self.bands_W_K[offset][: -offset or None, None]
            if not band.any():
                continue
            heat[offset:] += band * temperature_K[:-offset]
            heat[:-offset] += band * temperature_K[offset:]
        return heat

    def step(self, temperature_K: FloatArray, load_W: FloatArray, dt_s: float) -> FloatArray:
        """Temperatures (n, R) after `dt_s` under a load (n, R) that is constant over the step."""
        dt_s = float(dt_s)
        factor = self._factor(dt_s)
        stored = self.capacity_J_K[:, None] * temperature_K
        half_s = 0.5 * GAMMA * dt_s
        middle = stored - half_s * self.conduct(temperature_K) + GAMMA * dt_s * load_W
        middle = cho_solve_banded((factor, True), middle, overwrite_b=True, check_finite=False)
        last = self.capacity_J_K[:, None] * (WEIGHT * middle) - ((1.0 - GAMMA) ** 2 * WEIGHT) * stored
        last += half_s * load_W
        return np.asarray(cho_solve_banded((factor, True), last, overwrite_b=True, check_finite=False))

    def _factor(self, dt_s: float) -> FloatArray:
        if dt_s not in self._factors:
            matrix = 0.5 * GAMMA * dt_s * self.bands_W_K
            matrix[0] += self.capacity_J_K
            self._factors[dt_s] = cholesky_banded(matrix, lower=True)
        return self._factors[dt_s]
