"""What is only roughly known of a machine, beside its heats: what a log tells of it, and what it leaves open.

A tolerance changes the sensors by d_i θ_i, θ_i of variance 1 and d_i (K, s) known. The smoother is linear in
what the sensors read, so it is run once for each d_i, and the rest is small: with Σ the covariance of all
readings without tolerances, D the d_i as columns, and M what the smoother makes of them,

    S = (I + Dᵀ Σ⁻¹ D)⁻¹,   θ = S Dᵀ Σ⁻¹ (y − ŷ),   q = q̂(y − D θ),   P = P̂ + M S Mᵀ.

What is considered only (Schmidt 1966) keeps θ = 0, and the identity in its block of S, since it is no better
known afterwards: a model that is off by hundredths of a kelvin would else tell places, ends and material
wrongly, and be sure of it. The smoothed residual is R Σ⁻¹ (y − ŷ). Sources: Rosenberg (1973) for regression
beside a filter; de Jong (1991), sections 3 and 5, for the smoother and its covariance.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from observer.frames import BoolArray, FloatArray, Inputs
from observer.history.smoother import smooth_heats
from observer.model.plant import Plant
from observer.tables.estimator import EstimatorSettings

_OPEN_GATE = 1e9


class Change(NamedTuple):
    """What one standard deviation of a tolerance does to the sensors (K, s), K; and whether it is learnt."""

    sensor_K: FloatArray
    learnt: bool


class Within(NamedTuple):
    """What the learnt tolerances most probably do to the sensors (K, s), K, and the variance (K, m_e), W²,
    that all of them leave to the heats.
    """

    sensor_K: FloatArray
    variance_W2: FloatArray


def most_probable(
    plant: Plant,
    settings: EstimatorSettings,
    blocks: Sequence[Inputs],
    used: BoolArray,
    changes: Sequence[Change],
) -> Within:
    """Return what the `used` readings (K, s) of consecutive blocks tell of tolerances, of which there is one
    at least.
    """
    settings = settings.model_copy(update={"gate_sigma": _OPEN_GATE})
    weight_1_K2 = used / plant.noise_R_K2

    def smoothed(more_K: FloatArray) -> tuple[FloatArray, FloatArray]:
        """The heats (K, m_e), and Σ⁻¹ times the readings about their mean (K s,)."""
        history = smooth_heats(plant, settings, with_readings(blocks, np.where(used, more_K, np.nan)))
        return history.heat_W, np.where(used, history.residual_K * weight_1_K2, 0.0).ravel()

    heat_W, told = smoothed(np.zeros(used.shape))
    D = np.array([np.where(used, change.sensor_K, 0.0).ravel() for change in changes])
    M, G = [], np.empty((len(D), len(D)))
    for i, change in enumerate(changes):
        moved_W, moved = smoothed(change.sensor_K)
        M.append(heat_W - moved_W)
        G[i] = D @ (moved - told)
    S = np.linalg.inv(np.eye(len(D)) + 0.5 * (G + G.T))
    learnt = np.array([change.learnt for change in changes])
    theta = np.where(learnt, S @ (D @ told), 0.0)
    held = np.ix_(~learnt, ~learnt)
    S[held] = np.eye(len(D))[held]
    variance = np.einsum("ikj,il,lkj->kj", M, S, M, optimize=True)
    return Within(np.reshape(theta @ D, used.shape), np.maximum(variance, 0.0))


def with_readings(blocks: Sequence[Inputs], more_K: FloatArray) -> list[Inputs]:
    """Return the blocks with changed readings, `more_K` (K, s) in all; where that is NaN there are none."""
    out, begin = [], 0
    for block in blocks:
        more = more_K[begin : begin + len(block)]
        begin += len(block)
        out.append(block._replace(y_degC=block.y_degC + more, usable=block.usable & np.isfinite(more)))
    return out
