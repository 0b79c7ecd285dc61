"""Carries an estimate from one model of a screw into another, by means of field and heats.

States of two models differ in number and meaning; the temperature at a place and the watts of a source do
not. The new estimator starts from its sensors. Its distribution of field and heats, y = H x, is then replaced
by that of the old one. The distribution of x given y stays: p(x) = ∫ p(x | y) p_old(y) dy (Jeffrey 1965,
probability kinematics). Using the old estimate as a measurement would count the prior twice. Learnt
parameters of the old model are not carried, because they compensate for its own errors.
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
"""σ in K and W by which two models may differ where the old model claims certainty.

An example is the shape of the field near a source of heat.
"""


class Carried(NamedTuple):
    """An estimate that does not depend on its model: field, heats and lagged heats.

    Attributes:
        position_m: Places of the field on the screw, m, (g,).
        heats: Names of the estimated sources.
        lags: Names of all sources, whose lags carry the part of the field beyond the modes.
        value: Field, °C, then heats, W, then lagged heats, W, (r,).
        covariance: Their covariance in the same order, (r, r).
    """

    position_m: FloatArray
    heats: tuple[str, ...]
    lags: tuple[str, ...]
    value: FloatArray
    covariance: FloatArray


def carry_from(
    plant: Plant, state: EstimatorState, inputs: Inputs, estimate: EstimateBlock
) -> Carried | None:
    """Return the estimate after a step as field, heats and lagged heats.

    Variances that a bank adds to the published σ are added to the covariance.

    Args:
        plant: The model of the estimate.
        state: State of its estimator after the step.
        inputs: Inputs of the step; only the last one is used.
        estimate: Estimates of the step; only the last one is used.

    Returns:
        The estimate, or None before the start or where it is not finite.
    """
    heats, lags = plant.layout.sources, plant.source_names
    value = np.concatenate(
        [estimate.field_degC[-1], estimate.heat_W[-1], plant.lag_rows @ state.x_hat[: len(plant.decay_1_s)]]
    )
    if not (state.started and np.isfinite(value).all() and np.isfinite(state.P).all()):
        return None
    H = _rows(plant, inputs, estimate.law_W[-1], heats, lags)
    covariance = H @ state.P @ H.T
    sigma = np.concatenate([estimate.field_sigma_K[-1], estimate.heat_sigma_W[-1]])
    extra_variance = np.maximum(sigma**2 - np.diag(covariance)[: len(sigma)], 0.0)  # of the bank
    covariance[np.arange(len(sigma)), np.arange(len(sigma))] += extra_variance
    return Carried(plant.layout.position_m, heats, lags, value, covariance)


def carry_into(
    plant: Plant, estimator: CarriesOver, carried: Carried, inputs: Inputs
) -> EstimatorState | None:
    """Return the state of another model's estimator with the same field and heats.

    The new estimator takes one step of zero length with the finite readings. The result then has the mean and
    covariance of `carried` in field, common heats and common lags. Parameters that are considered keep their
    values.

    Args:
        plant: The other model.
        estimator: Its estimator.
        carried: The old estimate.
        inputs: Inputs of one step of the other model.

    Returns:
        The state, or None if the places of the field differ, no heat has the same name, or no sensor has a
        value.
    """
    sources = plant.layout.sources
    heats = tuple(name for name in sources if name in carried.heats)
    lags = tuple(name for name in plant.source_names if name in carried.lags)
    if not heats or not np.array_equal(plant.layout.position_m, carried.position_m):
        return None
    state, estimate = estimator.run(
        estimator.initial(), inputs._replace(usable=np.isfinite(inputs.y_degC), dt_s=np.zeros(1))
    )
    if not state.started:
        return None
    law_W = estimate.law_W[-1]
    H, selected = _rows(plant, inputs, law_W, heats, lags), _places(carried, heats, lags)
    offsets = [
        plant.rows.F[plant.rows.field_slice] @ inputs.z_end[-1],
        [law_W[sources.index(name)] for name in heats],
        np.zeros(len(lags)),
    ]
    nu = carried.value[selected] - np.concatenate(offsets) - H @ state.x_hat
    considered = np.zeros(0, np.int64)
    if plant.learning is not None:
        considered = len(plant.decay_1_s) + len(sources) + plant.learning.arrays.considered
    x, P = _replaced(state.x_hat, state.P, H, nu, carried.covariance[np.ix_(selected, selected)], considered)
    return estimator.at(state, x, P, _linearisation_point(plant, inputs, x, state.around))


def _rows(
    plant: Plant, inputs: Inputs, law_W: FloatArray, heats: tuple[str, ...], lags: tuple[str, ...]
) -> FloatArray:
    """Return H (r, n): field, deviations of heats from their laws, and lagged heats by the states (n,)."""
    n_x, sources = len(plant.decay_1_s), plant.layout.sources
    first_parameter = n_x + len(sources)
    C = columns_in_place(plant, inputs, -1)[1][plant.rows.field_slice]
    H = np.zeros((len(C) + len(heats) + len(lags), first_parameter + plant.learnt))
    H[: len(C), :n_x] = C
    for row, name in enumerate(heats, len(C)):
        j = sources.index(name)
        H[row, n_x + j] = 1.0
        if plant.learning is not None:
            kind, of = plant.learning.arrays.kind, plant.learning.arrays.of
            H[row, first_parameter + np.flatnonzero((kind == Nuisance.LAW) & (of == j))] = law_W[j]
    for row, name in enumerate(lags, len(C) + len(heats)):
        H[row, :n_x] = plant.lag_rows[plant.source_names.index(name)]
    return H


def _places(carried: Carried, heats: tuple[str, ...], lags: tuple[str, ...]) -> list[int]:
    """Return the indices of the whole field, of these heats and of these lags in `Carried.value`."""
    g, m = len(carried.position_m), len(carried.heats)
    return [
        *range(g),
        *(g + carried.heats.index(name) for name in heats),
        *(g + m + carried.lags.index(name) for name in lags),
    ]


def _replaced(
    x: FloatArray, P: FloatArray, H: FloatArray, nu: FloatArray, R: FloatArray, considered: NDArray[np.int64]
) -> tuple[FloatArray, FloatArray]:
    """Return state and covariance with the distribution of H x replaced: shifted by `nu`, covariance R.

    The `considered` states keep their values (Schmidt 1966).
    """
    S = H @ P @ H.T + APART**2 * np.eye(len(H))
    scale = 1.0 / np.sqrt(np.diag(S))  # kelvins and watts of very different size stand in it
    G = np.linalg.solve(scale[:, None] * S * scale, scale[:, None] * (H @ P)).T * scale
    G[considered] = 0.0
    left = np.eye(len(x)) - G @ H
    after = left @ P @ left.T + G @ (R + APART**2 * np.eye(len(H))) @ G.T
    return x + G @ nu, 0.5 * (after + after.T)


def _linearisation_point(
    plant: Plant, inputs: Inputs, x: FloatArray, linearisation_point: FloatArray
) -> FloatArray:
    """Return the linearisation point of the parameters (`EstimatorState.around`) at the new state."""
    if plant.learning is None:
        return linearisation_point
    n_x, n = len(plant.decay_1_s), len(plant.decay_1_s) + len(plant.layout.sources)
    sensors = plant.rows.sensor_slice
    C = columns_in_place(plant, inputs, -1)[1][sensors]
    read_degC = C @ x[:n_x] + plant.rows.F[sensors] @ inputs.z_end[-1]
    return np.concatenate([x[:n], read_degC, read_degC])
