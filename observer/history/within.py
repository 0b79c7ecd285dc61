"""What is only roughly known of a machine, beside its heats: what a log says of it, and what it leaves open.

A tolerance changes the sensors by d_i θ_i, θ_i of variance 1 and d_i (K, s) known. The smoother is linear in
what the sensors read, so it is run once for each d_i, and the rest is small: with Σ the covariance of all
readings without tolerances, D the d_i as columns, and M what the smoother makes of them,

    S = (I + Dᵀ Σ⁻¹ D)⁻¹,   θ = S Dᵀ Σ⁻¹ (y − ŷ),   q = q̂(y − D θ),   P = P̂ + M S Mᵀ.

What is considered only (Schmidt 1966) keeps θ = 0, and the identity in its block of S, since it is no better
known afterwards: a model that is off by hundredths of a kelvin would else find places, ends and material
wrongly, and be sure of it. The smoothed residual is R Σ⁻¹ (y − ŷ). Sources: Rosenberg (1973) for regression
beside a filter; de Jong (1991), sections 3 and 5, for the smoother and its covariance.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from observer.frames import FloatArray, Inputs
from observer.history.changes import Changes
from observer.history.smoother import smooth_changes
from observer.model.plant import Plant
from observer.tables.estimator import EstimatorSettings


class Within(NamedTuple):
    """What the learnt tolerances most probably do to the sensors (K, s), K, and the variance (K, m_e), W²,
    that all of them leave to the heats.
    """

    sensor_K: FloatArray
    variance_W2: FloatArray


def most_probable(
    plant: Plant, settings: EstimatorSettings, blocks: Sequence[Inputs], changes: Changes
) -> Within:
    """Return what the readings of consecutive blocks that the gate lets pass say of tolerances, of which
    there is one at least.
    """
    information, M = smooth_changes(plant, settings, blocks, changes.sensor_K)
    S = np.linalg.inv(np.eye(len(information)) + information[:, 1:])
    theta = np.where(changes.learnt, S @ information[:, 0], 0.0)
    held = np.ix_(~changes.learnt, ~changes.learnt)
    S[held] = np.eye(len(information))[held]
    variance = np.sum(M @ S * M, axis=2)
    return Within(changes.sensor_K @ theta, np.maximum(variance, 0.0))


def less(blocks: Sequence[Inputs], change_K: FloatArray) -> list[Inputs]:
    """Return the blocks with readings that are less by changes (K, s)."""
    out, begin = [], 0
    for block in blocks:
        out.append(block._replace(y_degC=block.y_degC - change_K[begin : begin + len(block)]))
        begin += len(block)
    return out
