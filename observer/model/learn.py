"""Extend a plant by what of the machine is only roughly known, as its configuration tells."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from observer.config import Config
from observer.model.couple import surface_rate
from observer.model.extend import padded
from observer.model.learning import Kind, Learning, LearningArrays
from observer.model.plant import Plant
from observer.model.rod.modes import Modes
from observer.model.rod.static import Stretch
from observer.model.rod.truncation import modal_input
from observer.tables.sections import Sensor


class _State(NamedTuple):
    """One state: how it is told is `value` + `unit` · state."""

    key: str
    kind: Kind
    of: int
    sigma: float
    name: str
    value: float = 0.0
    unit: float = 1.0


_REST_K = 0.1
"""How far a screw is from one temperature, and that from the air's, after a night."""


def with_learning(plant: Plant, config: Config, modes: Modes) -> Plant:
    """Return the plant with what its estimator learns or allows for; as it is where that is nothing."""
    states = [s for s in (*_of_machine(config, modes), *_of_sensors(config)) if s.sigma > 0.0]
    if not states:
        return plant
    learnt = [i for i, s in enumerate(states) if s.key in config.estimator.learnt]
    n_x, N, ends = len(plant.decay_1_s), len(modes), (0.0, modes.rod.length_m)
    slope_C = np.zeros((plant.rows.sensors, n_x))
    for i, sensor in enumerate(config.sensor):
        if sensor.position_m is not None:
            slope_C[i, :N] = modes.slope(sensor.position_m)
    share = _REST_K**2 / config.estimator.initial_sigma_K**2
    arrays = LearningArrays(
        machine=sum(s.kind <= Kind.LAW for s in states),
        kind=np.array([s.kind for s in states], np.int64),
        of=np.array([s.of for s in states], np.int64),
        sigma=np.array([s.sigma for s in states]),
        held=np.array([i for i in range(len(states)) if i not in learnt], np.int64),
        film_1_s=_film_1_s(modes),
        uniform=padded(plant.uniform[:N], n_x),
        decay_1_s=padded(plant.decay_1_s[:N], n_x),
        ends_B=np.array([padded(modal_input(modes, Stretch(x, x)), n_x) for x in ends]),
        ends_C=np.array([padded(modes.theta(x)[0], n_x) for x in ends]),
        slope_C=slope_C,
        ambient=plant.known.ambient,
        rests=int(plant.known.left_end is None and plant.known.right_end is None),
        rest_P=share * plant.smooth_P,
    )
    told = [states[i] for i in learnt]
    learning = Learning(
        arrays,
        tuple(s.name for s in told),
        np.array(learnt, np.int64),
        np.array([s.value for s in told]),
        np.array([s.unit for s in told]),
    )
    return replace(plant, learning=learning, layout=replace(plant.layout, learned=learning.names))


def _film_1_s(modes: Modes) -> float:
    """The rate at which the film alone cools the screw."""
    return modes.rod.diffusivity_m2_s * modes.rod.fin_1_m**2


def _of_machine(config: Config, modes: Modes) -> list[_State]:
    """The machine's own: film, material, ambient, ends, and the scale of every law."""
    known, screw = config.tolerance, config.screw
    film_W_m2K = _film_1_s(modes) / surface_rate(screw)
    k, c = screw.conductivity_W_mK, screw.specific_heat_J_kgK
    film = known.convection if film_W_m2K > 0.0 else 0.0
    states = [
        _State("convection", Kind.CONVECTION, 0, film, "surface.convection_W_m2K", film_W_m2K, film_W_m2K),
        _State("conductivity", Kind.CONDUCTIVITY, 0, known.conductivity, "screw.conductivity_W_mK", k, k),
        _State(
            "heat_capacity", Kind.HEAT_CAPACITY, 0, known.heat_capacity, "screw.specific_heat_J_kgK", c, c
        ),
        _State("ambient_K", Kind.AMBIENT, 0, known.ambient_K, "ambient.offset_K"),
    ]
    for i, (end, side) in enumerate(((modes.rod.left, "left"), (modes.rod.right, "right"))):
        if not end.prescribed:
            name, loss = f"boundary.{side}.loss_W_K", end.biot_1_m * modes.rod.conductance_W_m
            states.append(_State("end_W_K", Kind.END, i, known.end_W_K, name, loss))
    sources = [s for s in config.source if s.estimate]
    for j, source in enumerate(sources):
        if source.law is not None and "law" in config.estimator.learnt:
            name = f"source.{source.name}.scale"
            states.append(
                _State("law", Kind.LAW, j, source.law_uncertainty, name, source.scale, source.scale)
            )
    return states


def _of_sensors(config: Config) -> list[_State]:
    """The sensors' own."""
    known = config.tolerance
    return [
        state
        for i, sensor in enumerate(config.sensor)
        for state in (
            _State(
                "offset_K",
                Kind.OFFSET,
                i,
                known.offset_of_K(sensor.offset_K),
                f"sensor.{sensor.name}.offset_K",
            ),
            _place(i, sensor, config),
            _State("lag_s", Kind.LAG, i, known.lag_s, f"sensor.{sensor.name}.lag_s"),
        )
    ]


def _place(i: int, sensor: Sensor, config: Config) -> _State:
    """Where a sensor sits; one beside the screw has no place there."""
    sigma_m = config.tolerance.position_m if sensor.position_m is not None else 0.0
    name = f"sensor.{sensor.name}.position_m"
    return _State("position_m", Kind.PLACE, i, sigma_m, name, sensor.position_m or 0.0)
