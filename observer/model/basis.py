"""The coordinates in which a plant decays by itself, whatever couples its states for good: x = V ξ.

Links at fixed places, films along stretches and sensors that lag make the generator a full matrix. In its own
modes it is diagonal again, so that a step is exact and as cheap as that of a screw alone. What couples states
by the moment alone (nuts that move, films of speed, radiation) is left to the step (`coupling`).
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from observer.frames import FloatArray
from observer.kernels.layout import packed
from observer.model.coupling import Coupling, no_coupling
from observer.model.generator import generator
from observer.model.plant import Basis, Plant

APART = 1e-8
"""How far the rates of the sources' lags are taken apart, which are all the same, and those of sensors."""


class Constant(NamedTuple):
    """What a plant's states do to each other for good: `A` (n_x, n_x) and `E` (n_x, p), added to those of the
    plant, 1/s; the states that `follow` others and act on none.
    """

    A: FloatArray
    E: FloatArray
    follow: tuple[int, ...] = ()


def diagonalised(plant: Plant, constant: Constant) -> Plant:
    """Return the plant in its own modes, with what is constant in it: nothing of it is left to the step."""
    plant = replace(plant, E=plant.E + constant.E)
    if not constant.A.any():
        return plant
    return turned(plant, *own_modes(plant, constant.A - np.diag(plant.decay_1_s), constant.follow))


def own_modes(plant: Plant, A: FloatArray, follow: tuple[int, ...] = ()) -> tuple[FloatArray, FloatArray]:
    """Return V (n_x, n_x) of a generator A (n_x, n_x), and the rates (n_x,), 1/s, at which its columns decay.

    Screw, nodes and lags are passive and sensors only follow: the rates are real. Each mode has the place of
    the state that takes most part in it (Pérez-Arriaga et al. 1982), and is 1 there.
    """
    from scipy.optimize import linear_sum_assignment  # noqa: PLC0415  (start-up: a screw alone needs none)

    alike = [*range(len(A))[plant.lag_slice], *follow]
    A = A.copy()
    A[alike, alike] *= 1.0 + APART * np.arange(len(alike))
    rates, V = np.linalg.eig(A)
    rates, V = rates.real, V.real
    own, mode = linear_sum_assignment(-np.abs(V * np.linalg.inv(V).T))
    V = V[:, mode[np.argsort(own)]]
    return V / np.diag(V), np.maximum(-rates[mode[np.argsort(own)]], 0.0)


def turned(plant: Plant, V: FloatArray, decay_1_s: FloatArray) -> Plant:
    """Return the plant with the states ξ, x = V ξ, that decay at given rates (n_x,)."""
    basis = Basis(V, np.asarray(np.linalg.inv(V), dtype=np.float64), plant.decay_1_s)
    inverse = basis.inverse

    def both(P: FloatArray) -> FloatArray:
        return np.asarray(inverse @ P @ inverse.T)

    learning = plant.learning
    if learning is not None:
        arrays = learning.arrays.seen_from(V, inverse)
        learning = replace(learning, arrays=arrays._replace(rest_P=both(arrays.rest_P)))
    rows = replace(plant.rows, C=plant.rows.C @ V)
    # what a row sees of a moving nut's lag beside the lag itself stays as the nut moves
    moving = []
    for s in plant.moving:
        lag = plant.modes + s.index
        beside = rows.C[:, lag] - plant.rows.C[:, lag] * V[lag, lag]
        moving.append(
            s.with_table(turn=inverse, table_C=s.table.table_C + beside, mean_C=s.table.mean_C + beside)
        )
    return replace(
        plant,
        decay_1_s=decay_1_s,
        B=inverse @ plant.B,
        E=inverse @ plant.E,
        rows=rows,
        moving=tuple(moving),
        uniform=inverse @ plant.uniform,
        prior_P=both(plant.prior_P),
        smooth_P=both(plant.smooth_P),
        field_noise_Q=both(plant.field_noise_Q),
        coupling=_coupling(plant, basis),
        learning=learning,
        basis=basis,
    )


def _coupling(plant: Plant, basis: Basis) -> Coupling:
    """What couples states by the moment, in the new ones."""
    c, (V, inverse, _) = plant.coupling, basis
    N, beside = plant.modes, np.arange(plant.modes, len(V))
    links = c.links._replace(C=c.links.C @ V, B=c.links.B @ inverse.T)
    spreads = c.spreads._replace(row=c.spreads.row @ V[:N], into=c.spreads.into @ inverse[:, :N].T)
    own: Coupling = packed(
        c._replace(
            metric=V[:N].T @ V[:N],
            beside=V[beside],
            beside_into=inverse[:, beside].T,
            under_C=c.under_C @ V,
            uniform=inverse @ c.uniform,
            mean=c.mean @ V,
            links=links,
            spreads=spreads,
        )
    )
    return own


def frozen(plant: Plant) -> tuple[Plant, FloatArray]:
    """Return a plant that nothing couples any more, in its own modes with nuts over their strokes, and V
    (n_x, n_x), its states in the plant's; losses of the moment are left out. For designs that place poles.
    """
    none = no_coupling(len(plant.decay_1_s), len(plant.source_names), len(plant.known_names), plant.modes)
    V, decay_1_s = own_modes(plant, generator(plant))
    return turned(replace(plant, moving=(), learning=None, coupling=none), V, decay_1_s), V
