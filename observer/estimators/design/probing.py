"""The effect of a planned probing on σ: one update of the covariance by a displacement's row."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from observer.frames import FloatArray
from observer.model.learning import Nuisance
from observer.model.plant import Plant


class ProbingWorth(NamedTuple):
    """Effect of one reading of a displacement.

    Attributes:
        before_um: σ of the thermal error before it, µm, (g,).
        after_um: σ after it, µm, (g,).
    """

    before_um: FloatArray
    after_um: FloatArray


def probing_worth(plant: Plant, P: FloatArray, sensor: int) -> ProbingWorth:
    """Return the σ of the thermal error before and after one reading of a displacement.

    σ² − (c P h)²/(h P hᵀ + R) with h the row of the reading, its zero included, and c those of the error
    (Kalman 1960).

    Args:
        plant: The model with the thermal error as output.
        P: Covariance of an estimator's states: the plant's, the heats' and the learnt parameters, (n, n).
        sensor: Number of the displacement sensor.

    Raises:
        ValueError: If play in a support makes the error a nonlinear function of the state.
    """
    rows = plant.rows
    if rows.restraint is not None and not rows.restraint.linear:
        raise ValueError("with play in a support the error has no constant rows")
    n_x, first = len(plant.decay_1_s), len(P) - plant.learnt
    h, C = np.zeros(len(P)), np.zeros((rows.grid, len(P)))
    h[:n_x], C[:, :n_x] = rows.C[sensor], rows.C[rows.error_slice][: rows.grid]
    kinds = plant.parameters
    h[first + np.flatnonzero((kinds.kind == Nuisance.OFFSET) & (kinds.of == sensor))] = 1.0
    g = P @ h
    before_um2 = np.einsum("ga,ab,gb->g", C, P, C)
    taken_um2 = (C @ g) ** 2 / (h @ g + plant.noise_R_K2[sensor])
    return ProbingWorth(
        np.sqrt(np.maximum(before_um2, 0.0)), np.sqrt(np.maximum(before_um2 - taken_um2, 0.0))
    )
