"""How sure an estimator would be with each of many sets of sensors, all out of those of one plant.

The covariances are those of `spread`: of a filter that knows only the sensors of a set, of the screw and the
machine the same as all, and of what is only roughly known what belongs to these. What drives the plant along
the shift, and what each sensor would read, is worked out once for all sets.
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
    """Mean σ over a shift with each of v sets: of each estimated heat (v, m_e), W; at each place of the field
    (v, g), K, and of the thermal error (v, g), µm, which is (v, 0) without an expansion coefficient.
    """

    heat_W: FloatArray
    field_K: FloatArray
    error_um: FloatArray


class _Own(NamedTuple):
    """Of v sets of up to k sensors: `sensors` (v, k), `weight_1_K` (v, k), one over the σ of a reading, 0
    where a set has fewer; `states` (v, n), which of all states each filter has, one
    beyond the last for what a sensor does not have; `held` (h,) parameters, considered only.
    """

    sensors: NDArray[np.int64]
    weight_1_K: FloatArray
    states: NDArray[np.int64]
    held: NDArray[np.int64]

    def of_states(self, P: FloatArray) -> FloatArray:
        """The parts (v, n, n) of a matrix over all states (N, N)."""
        wide = np.pad(P, ((0, 1), (0, 1)))
        return np.asarray(wide[self.states[:, :, None], self.states[:, None, :]])

    def of_readings(self, seen: FloatArray, readings: FloatArray) -> FloatArray:
        """The rows (v, f k, n) of all sensors' (f, s, N), by the σ of the mean of the `readings` (s,) in a
        step, with f rows for each that it has in one.
        """
        wide = np.pad(seen, ((0, 0), (0, 0), (0, 1)))
        own = wide[:, self.sensors[:, :, None], self.states[:, None, :]]
        weight = self.weight_1_K * np.sqrt(readings / len(seen))[self.sensors]
        own = own * weight[:, :, None]
        return np.asarray(own.swapaxes(0, 1).reshape(len(self.sensors), -1, self.states.shape[1]))


def set_sigmas(
    plant: Plant, shift: Sequence[Stage], sets: Sequence[SensorSet], every_s: FloatArray, dt_s: float
) -> SetSigmas:
    """Return the σ of a Kalman filter over a shift, in steps `dt_s`, with each of some sets of the sensors of
    a plant that knows its tolerances (`build_plant` with `learns`), read `every_s` (s,).
    """
    a = plant.parameters
    n_x = len(plant.decay_1_s)
    first = n_x + int(plant.estimated.sum())
    own = _own(plant, a, first, sets, 1.0 / np.sqrt(plant.noise_R_K2))
    n, all_sigma = own.states.shape[1], a.sigma[None, :]
    at_rest, anyhow = (
        own.of_states(start(plant, a, shift[0], all_sigma, at_rest=x)[0]) for x in (True, False)
    )
    P = np.where(_has_offsets(own, a, first)[:, None, None], at_rest, anyhow)
    Q = own.of_states(wandering(all_sigma, first, dt_s)[0])
    machine = first + a.machine
    found: list[tuple[FloatArray, FloatArray, FloatArray]] = []
    for count, now in enumerate(along(plant, a, shift, dt_s, sweeps=True), 1):
        F = np.eye(n) * now.F[-1, -1]
        F[:machine, :machine] = now.F[:machine, :machine]
        Q[:, :first, :first] = now.Q
        P[:, range(n_x, first), range(n_x, first)] += (plant.jump_uncertainty * now.jump_W) ** 2
        rows = own.of_readings(now.H + now.passing, _readings(count, every_s, dt_s))
        before = F @ P @ F.T + Q
        P = corrected(before, rows, np.ones(rows.shape[1]), None, own.held, first)
        if is_counted(count, dt_s):
            found.append(sigmas(Moment(now.plant, now.stage, now.x, rows, between(before, P)), a))
    return SetSigmas(*(np.mean(column, axis=0) for column in zip(*found, strict=True)))


def _readings(step: int, every_s: FloatArray, dt_s: float) -> FloatArray:
    """How many readings (s,) of each sensor there are in a step, from 1; of one that comes less often than
    steps do, 1 in the steps in which it comes.
    """
    rare = np.floor(step * dt_s / every_s) - np.floor((step - 1) * dt_s / every_s)
    return np.where(every_s > dt_s, rare, dt_s / every_s)


def _own(
    plant: Plant, a: LearningArrays, first: int, sets: Sequence[SensorSet], weight_1_K: FloatArray
) -> _Own:
    """What each set has of all; each sensor has as many states, in the order of their kinds."""
    most, nothing = max(len(each) for each in sets), first + len(a.kind)
    kinds = np.unique(a.kind[a.machine :])
    table = np.full((plant.rows.sensors, len(kinds)), nothing)
    for q in range(a.machine, len(a.kind)):
        table[a.of[q], np.searchsorted(kinds, a.kind[q])] = first + q
    sensors, weights = np.zeros((len(sets), most), np.int64), np.zeros((len(sets), most))
    states = np.full((len(sets), first + a.machine + most * len(kinds)), nothing)
    states[:, : first + a.machine] = np.arange(first + a.machine)
    for v, each in enumerate(sets):
        sensors[v, : len(each)], weights[v, : len(each)] = each, weight_1_K[list(each)]
        of_sensors = table[list(each)].ravel()
        states[v, first + a.machine : first + a.machine + len(of_sensors)] = of_sensors
    held_kinds = np.isin(kinds, a.kind[a.held])
    of_slots = a.machine + np.flatnonzero(np.tile(held_kinds, most))
    return _Own(sensors, weights, states, np.concatenate([a.held[a.held < a.machine], of_slots]))


def _has_offsets(own: _Own, a: LearningArrays, first: int) -> BoolArray:
    """Whether each set (v,) has a sensor with an offset, without which a filter takes no rest for rest."""
    return np.asarray(np.isin(own.states, first + np.flatnonzero(a.kind == Nuisance.OFFSET)).any(axis=1))
