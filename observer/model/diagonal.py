"""A coupled plant in coordinates that decay by themselves, for designs that place poles: x = V ξ."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from scipy.optimize import linear_sum_assignment

from observer.frames import FloatArray
from observer.model.coupling import no_coupling
from observer.model.generator import generator
from observer.model.plant import Plant

APART = 1e-8
"""How far the rates of the sources' lags are taken apart, which are all the same, and those of sensors."""


class Diagonal(NamedTuple):
    """A plant of which nothing couples the states, and `V` (n_x, n_x) for the states it was made from."""

    plant: Plant
    V: FloatArray

    def back(self, K: FloatArray) -> FloatArray:
        """Return a gain (n, s) of [ξ | δ] as one of [x | δ]."""
        n_x = len(self.V)
        return np.vstack([self.V @ K[:n_x], K[n_x:]])


def diagonal(plant: Plant) -> Diagonal:
    """Return the plant in its own modes: nuts over their strokes, losses of the moment left out."""
    n_x = len(plant.decay_1_s)
    if not plant.coupling.lasting:
        return Diagonal(plant, np.eye(n_x))
    V, rate_1_s = own_modes(plant)
    inverse = np.linalg.inv(V)

    def turned(P: FloatArray) -> FloatArray:
        return np.asarray(inverse @ P @ inverse.T)

    own = replace(
        plant,
        decay_1_s=rate_1_s,
        B=inverse @ plant.B,
        E=inverse @ plant.E,
        rows=replace(plant.rows, C=plant.rows.C @ V),
        moving=(),
        uniform=inverse @ plant.uniform,
        prior_P=turned(plant.prior_P),
        smooth_P=turned(plant.smooth_P),
        field_noise_Q=turned(plant.field_noise_Q),
        coupling=no_coupling(n_x, len(plant.source_names), len(plant.known_names), plant.modes),
        learning=None,
    )
    return Diagonal(own, V)


def own_modes(plant: Plant) -> tuple[FloatArray, FloatArray]:
    """Return V (n_x, n_x) and the rates (n_x,), 1/s, at which its columns decay.

    Screw, nodes and lags are passive and sensors only follow: the rates are real. Each mode has the place of
    the state that takes most part in it (Pérez-Arriaga et al. 1982), and is 1 there.
    """
    A, n_x = generator(plant), len(plant.decay_1_s)
    alike = np.concatenate([np.arange(n_x)[plant.lag_slice], plant.coupling.lags.state]).astype(np.int64)
    A[alike, alike] *= 1.0 + APART * np.arange(len(alike))
    rates, V = np.linalg.eig(A)
    rates, V = rates.real, V.real
    own, mode = linear_sum_assignment(-np.abs(V * np.linalg.inv(V).T))
    V = V[:, mode[np.argsort(own)]]
    return V / np.diag(V), np.maximum(-rates[mode[np.argsort(own)]], 0.0)
