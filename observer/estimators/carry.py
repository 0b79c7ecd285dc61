"""An estimate carried from one model of a screw into another: as what it says of field and heats.

States of two models are of different number and meaning; the temperature at a place and the watts of a source
are not. The new estimator starts as ever, from one look at its sensors. What it then takes for the law of
field and heats, y = H x, is replaced by that of the old one, and what is open when they are known stays as it
was: p(x) = ∫ p(x | y) p_old(y) dy (Jeffrey 1965, probability kinematics). A correction by what the old one
says, as if that were a measurement, would count the prior twice. What the old model has learnt of itself is
not carried, since that was to make up for what it lacked.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from observer.estimators.protocol import CarriesOver, EstimatorState
from observer.estimators.specification import columns_in_place
from observer.frames import EstimateBlock, FloatArray, Inputs
from observer.model.learning import Nuisance
from observer.model.plant import Plant

APART = 0.05
"""In K and W: how far two models may be apart in what the old one takes for certain, such as the shape that a
heat gives the field near its source."""


class Carried(NamedTuple):
    """What an estimate says whatever its model: of the field at `position_m` (g,), and of heats and lagged
    heats by the names of their sources; `value` (r,) in °C and W, `covariance` (r, r) in this order.
    """

    position_m: FloatArray
    heats: tuple[str, ...]
    lags: tuple[str, ...]
    value: FloatArray
    covariance: FloatArray


def carry_from(
    plant: Plant, state: EstimatorState, inputs: Inputs, estimate: EstimateBlock
) -> Carried | None:
    """What is known after a step with these inputs and this estimate, None where that is nothing."""
    heats, lags = plant.layout.sources, plant.source_names
    value = np.concatenate(
        [estimate.field_degC[-1], estimate.heat_W[-1], plant.lag_rows @ state.x_hat[: len(plant.decay_1_s)]]
    )
    if not (state.started and np.isfinite(value).all() and np.isfinite(state.P).all()):
        return None
    H = _rows(plant, inputs, estimate.law_W[-1], heats, lags)
    covariance = H @ state.P @ H.T
    sigma = np.concatenate([estimate.field_sigma_K[-1], estimate.heat_sigma_W[-1]])
    beyond = np.maximum(sigma**2 - np.diag(covariance)[: len(sigma)], 0.0)  # what a bank adds beside P
    covariance[np.arange(len(sigma)), np.arange(len(sigma))] += beyond
    return Carried(plant.layout.position_m, heats, lags, value, covariance)


def carry_into(plant: Plant, estimator: CarriesOver, known: Carried, inputs: Inputs) -> EstimatorState | None:
    """The state of another model's estimator that knows the same; `inputs` are those of one step.

    None where the places of the field are others, no heat has the name it had, or no sensor has a value.
    """
    sources = plant.layout.sources
    heats = tuple(name for name in sources if name in known.heats)
    lags = tuple(name for name in plant.source_names if name in known.lags)
    if not heats or not np.array_equal(plant.layout.position_m, known.position_m):
        return None
    state, estimate = estimator.run(
        estimator.initial(), inputs._replace(usable=np.isfinite(inputs.y_degC), dt_s=np.zeros(1))
    )
    if not state.started:
        return None
    law_W = estimate.law_W[-1]
    H, said = _rows(plant, inputs, law_W, heats, lags), _places(known, heats, lags)
    beside = [
        plant.rows.F[plant.rows.field_slice] @ inputs.z_end[-1],
        [law_W[sources.index(name)] for name in heats],
        np.zeros(len(lags)),
    ]
    nu = known.value[said] - np.concatenate(beside) - H @ state.x_hat
    held = np.zeros(0, np.int64)
    if plant.learning is not None:
        held = len(plant.decay_1_s) + len(sources) + plant.learning.arrays.held
    x, P = _replaced(state.x_hat, state.P, H, nu, known.covariance[np.ix_(said, said)], held)
    return estimator.at(state, x, P, _around(plant, inputs, x, state.around))


def _rows(
    plant: Plant, inputs: Inputs, law_W: FloatArray, heats: tuple[str, ...], lags: tuple[str, ...]
) -> FloatArray:
    """What field, heats beyond their laws and lagged heats are of the states (n,) of an estimator."""
    n_x, sources = len(plant.decay_1_s), plant.layout.sources
    own = n_x + len(sources)
    C = columns_in_place(plant, inputs, -1)[1][plant.rows.field_slice]
    H = np.zeros((len(C) + len(heats) + len(lags), own + plant.learnt))
    H[: len(C), :n_x] = C
    for row, name in enumerate(heats, len(C)):
        j = sources.index(name)
        H[row, n_x + j] = 1.0
        if plant.learning is not None:
            kind, of = plant.learning.arrays.kind, plant.learning.arrays.of
            H[row, own + np.flatnonzero((kind == Nuisance.LAW) & (of == j))] = law_W[j]
    for row, name in enumerate(lags, len(C) + len(heats)):
        H[row, :n_x] = plant.lag_rows[plant.source_names.index(name)]
    return H


def _places(known: Carried, heats: tuple[str, ...], lags: tuple[str, ...]) -> list[int]:
    """Which of the values are of the whole field, of these heats, and of these lags."""
    g, m = len(known.position_m), len(known.heats)
    return [
        *range(g),
        *(g + known.heats.index(name) for name in heats),
        *(g + m + known.lags.index(name) for name in lags),
    ]


def _replaced(
    x: FloatArray, P: FloatArray, H: FloatArray, nu: FloatArray, R: FloatArray, held: NDArray[np.int64]
) -> tuple[FloatArray, FloatArray]:
    """A state and its covariance with what they say of H x replaced: moved by `nu`, with the covariance R.

    What is `held` is considered only, and keeps its value (Schmidt 1966).
    """
    S = H @ P @ H.T + APART**2 * np.eye(len(H))
    scale = 1.0 / np.sqrt(np.diag(S))  # kelvins and watts of very different size stand in it
    G = np.linalg.solve(scale[:, None] * S * scale, scale[:, None] * (H @ P)).T * scale
    G[held] = 0.0
    left = np.eye(len(x)) - G @ H
    after = left @ P @ left.T + G @ (R + APART**2 * np.eye(len(H))) @ G.T
    return x + G @ nu, 0.5 * (after + after.T)


def _around(plant: Plant, inputs: Inputs, x: FloatArray, around: FloatArray) -> FloatArray:
    """Where the effects of what is learnt are taken (`EstimatorState.around`): at the new state."""
    if plant.learning is None:
        return around
    n_x, n = len(plant.decay_1_s), len(plant.decay_1_s) + len(plant.layout.sources)
    sensors = plant.rows.sensor_slice
    C = columns_in_place(plant, inputs, -1)[1][sensors]
    read_degC = C @ x[:n_x] + plant.rows.F[sensors] @ inputs.z_end[-1]
    return np.concatenate([x[:n], read_degC, read_degC])
