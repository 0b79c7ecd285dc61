"""The σ of an estimator with each of many sets of sensors of one plant.

The covariances are those of `spread`, for a filter with only the sensors of a set and their parameters. All
filters share screw and machine. Inputs along the shift and rows of the sensors are computed once for all
sets.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from observer.estimators.design.along import along
from observer.estimators.design.spread import (
    Moment,
    between,
    corrected,
    is_counted,
    sigmas,
    start,
    wandering,
)
from observer.frames import BoolArray, FloatArray
from observer.model.cycle import Stage
from observer.model.learning import LearningArrays, Nuisance
from observer.model.plant import Plant

SensorSet = tuple[int, ...]
"""Sensors chosen together, by their numbers, in increasing order."""


class SetSigmas(NamedTuple):
    """Mean σ over a shift with each of v sets.

    Attributes:
        heat_W: σ of each estimated heat, W, (v, m_e).
        field_K: σ of the field, K, (v, g).
        error_um: σ of the thermal error, µm, (v, g), or (v, 0) without an expansion coefficient.
    """

    heat_W: FloatArray
    field_K: FloatArray
    error_um: FloatArray


class _SetArrays(NamedTuple):
    """Arrays of v sets of up to k sensors: their indices `sensors` (v, k).

    Readings have weights `weight_1_K` (v, k), one over their σ, 0 where a set has fewer sensors. Filters have
    the states `states` (v, n) of all N states; index N marks a parameter that a sensor lacks. Parameters in
    `considered` (h,) are not learnt.
    """

    sensors: NDArray[np.int64]
    weight_1_K: FloatArray
    states: NDArray[np.int64]
    considered: NDArray[np.int64]

    def of_states(self, P: FloatArray) -> FloatArray:
        """Return the parts (v, n, n) of a matrix over all states (N, N)."""
        wide = np.pad(P, ((0, 1), (0, 1)))
        return np.asarray(wide[self.states[:, :, None], self.states[:, None, :]])

    def of_readings(self, rows: FloatArray, readings: FloatArray) -> FloatArray:
        """Return the rows (v, f k, n) of the sets from those of all sensors (f, s, N), in units of σ.

        The σ is that of the mean of a step's `readings` (s,). Each sensor has one row for each of f phases.
        """
        wide = np.pad(rows, ((0, 0), (0, 0), (0, 1)))
        set_rows = wide[:, self.sensors[:, :, None], self.states[:, None, :]]
        weight = self.weight_1_K * np.sqrt(readings / len(rows))[self.sensors]
        set_rows = set_rows * weight[:, :, None]
        return np.asarray(set_rows.swapaxes(0, 1).reshape(len(self.sensors), -1, self.states.shape[1]))


def set_sigmas(
    plant: Plant, shift: Sequence[Stage], sets: Sequence[SensorSet], every_s: FloatArray, dt_s: float
) -> SetSigmas:
    """Return the mean σ of a Kalman filter over a shift with each of many sets of sensors.

    The means exclude the first ten minutes. A set whose sensors have no offset starts from the general prior
    instead of a screw at rest.

    Args:
        plant: The model with all candidate sensors and its tolerances (`build_plant` with `learns`).
        shift: Stages of constant heats.
        sets: The v sets, each with numbers of sensors in increasing order.
        every_s: Time between readings of each sensor, s, (s,).
        dt_s: Length of a step, s.
    """
    a = plant.parameters
    n_x = len(plant.decay_1_s)
    first = n_x + int(plant.estimated.sum())
    arrays = _set_arrays(plant, a, first, sets, 1.0 / np.sqrt(plant.noise_R_K2))
    n, all_sigma = arrays.states.shape[1], a.sigma[None, :]
    at_rest, anyhow = (
        arrays.of_states(start(plant, a, shift[0], all_sigma, at_rest=x)[0]) for x in (True, False)
    )
    P = np.where(_has_offsets(arrays, a, first)[:, None, None], at_rest, anyhow)
    Q = arrays.of_states(wandering(all_sigma, first, dt_s)[0])
    machine = first + a.machine
    moment_sigmas: list[tuple[FloatArray, FloatArray, FloatArray]] = []
    for count, now in enumerate(along(plant, a, shift, dt_s, sweeps=True), 1):
        F = np.eye(n) * now.F[-1, -1]
        F[:machine, :machine] = now.F[:machine, :machine]
        Q[:, :first, :first] = now.Q
        P[:, range(n_x, first), range(n_x, first)] += (plant.jump_uncertainty * now.jump_W) ** 2
        rows = arrays.of_readings(now.H + now.passing, _readings(count, every_s, dt_s))
        before = F @ P @ F.T + Q
        P = corrected(before, rows, np.ones(rows.shape[1]), None, arrays.considered, first)
        if is_counted(count, dt_s):
            moment_sigmas.append(sigmas(Moment(now.plant, now.stage, now.x, rows, between(before, P)), a))
    return SetSigmas(*(np.mean(column, axis=0) for column in zip(*moment_sigmas, strict=True)))


def _readings(step: int, every_s: FloatArray, dt_s: float) -> FloatArray:
    """Return the number of readings (s,) of each sensor in a step; steps count from 1.

    A sensor with a longer period than the steps has 1 in the steps with a reading, else 0.
    """
    rare = np.floor(step * dt_s / every_s) - np.floor((step - 1) * dt_s / every_s)
    return np.where(every_s > dt_s, rare, dt_s / every_s)


def _set_arrays(
    plant: Plant, a: LearningArrays, first: int, sets: Sequence[SensorSet], weight_1_K: FloatArray
) -> _SetArrays:
    """Return the arrays of the sets; each sensor has the same number of states, in order of their kinds."""
    most, absent = max(len(chosen) for chosen in sets), first + len(a.kind)
    kinds = np.unique(a.kind[a.machine :])
    table = np.full((plant.rows.sensors, len(kinds)), absent)
    for q in range(a.machine, len(a.kind)):
        table[a.of[q], np.searchsorted(kinds, a.kind[q])] = first + q
    sensors, weights = np.zeros((len(sets), most), np.int64), np.zeros((len(sets), most))
    states = np.full((len(sets), first + a.machine + most * len(kinds)), absent)
    states[:, : first + a.machine] = np.arange(first + a.machine)
    for v, chosen in enumerate(sets):
        sensors[v, : len(chosen)], weights[v, : len(chosen)] = chosen, weight_1_K[list(chosen)]
        of_sensors = table[list(chosen)].ravel()
        states[v, first + a.machine : first + a.machine + len(of_sensors)] = of_sensors
    held_kinds = np.isin(kinds, a.kind[a.considered])
    of_slots = a.machine + np.flatnonzero(np.tile(held_kinds, most))
    return _SetArrays(
        sensors, weights, states, np.concatenate([a.considered[a.considered < a.machine], of_slots])
    )


def _has_offsets(arrays: _SetArrays, a: LearningArrays, first: int) -> BoolArray:
    """Return whether each set (v,) has a sensor with an offset; other filters do not start from rest."""
    return np.asarray(np.isin(arrays.states, first + np.flatnonzero(a.kind == Nuisance.OFFSET)).any(axis=1))
