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
from observer.history.smoother import smooth_changes
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
    open_gate = settings.model_copy(update={"gate_sigma": _OPEN_GATE})
    D = np.stack([np.where(used, change.sensor_K, 0.0) for change in changes], axis=2)
    read = with_readings(blocks, np.where(used, 0.0, np.nan))
    told, M = smooth_changes(plant, open_gate, read, D)
    S = np.linalg.inv(np.eye(len(told)) + told[:, 1:])
    learnt = np.array([change.learnt for change in changes])
    theta = np.where(learnt, S @ told[:, 0], 0.0)
    held = np.ix_(~learnt, ~learnt)
    S[held] = np.eye(len(told))[held]
    variance = np.sum(M @ S * M, axis=2)
    return Within(D @ theta, np.maximum(variance, 0.0))


def with_readings(blocks: Sequence[Inputs], more_K: FloatArray) -> list[Inputs]:
    """Return the blocks with changed readings, `more_K` (K, s) in all; where that is NaN there are none."""
    out, begin = [], 0
    for block in blocks:
        more = more_K[begin : begin + len(block)]
        begin += len(block)
        out.append(block._replace(y_degC=block.y_degC + more, usable=block.usable & np.isfinite(more)))
    return out
