"""Extend a plant by what of the machine is only roughly known, as its configuration tells."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from observer.config import Config
from observer.model.couple import surface_rate
from observer.model.extend import padded
from observer.model.learning import (
    REST_K,
    Change,
    Kind,
    Learning,
    LearningArrays,
    no_change,
    stacked,
)
from observer.model.plant import Plant
from observer.model.rod.modes import Modes
from observer.model.rod.static import Stretch
from observer.model.rod.truncation import modal_input


class _Parameter(NamedTuple):
    """One parameter: how it is told is `value` + `unit` · its state, and `change` is what it does."""

    key: str
    kind: Kind
    of: int
    sigma: float
    name: str
    change: Change
    value: float = 0.0
    unit: float = 1.0


def with_learning(plant: Plant, config: Config, modes: Modes) -> Plant:
    """Return the plant with what its estimator learns or allows for; as it is where that is nothing."""
    known = [*_of_machine(plant, config, modes), *_of_sensors(plant, config, modes)]
    known = [p for p in known if p.sigma > 0.0]
    if not known:
        return plant
    learnt = [i for i, p in enumerate(known) if p.key in config.estimator.learnt]
    n_x = len(plant.decay_1_s)
    arrays = LearningArrays(
        machine=sum(p.kind <= Kind.LAW for p in known),
        kind=np.array([p.kind for p in known], np.int64),
        of=np.array([p.of for p in known], np.int64),
        sigma=np.array([p.sigma for p in known]),
        held=np.array([i for i in range(len(known)) if i not in learnt], np.int64),
        **stacked([p.change for p in known], n_x, len(plant.known_names)),
        ambient=plant.known.ambient,
        rests=int(plant.known.left_end is None and plant.known.right_end is None),
        rest_P=REST_K**2 / config.estimator.initial_sigma_K**2 * plant.smooth_P,
        V=np.zeros((0, 0)),
        inverse=np.zeros((0, 0)),
    )
    told = [known[i] for i in learnt]
    learning = Learning(
        arrays,
        tuple(p.name for p in told),
        np.array(learnt, np.int64),
        np.array([p.value for p in told]),
        np.array([p.unit for p in told]),
    )
    return replace(plant, learning=learning, layout=replace(plant.layout, learned=learning.names))


def _of_machine(plant: Plant, config: Config, modes: Modes) -> Iterator[_Parameter]:
    """The machine's own: film, material, ambient, ends, and the scale of every law."""
    tolerance, screw = config.tolerance, config.screw
    n_x, none = len(plant.decay_1_s), no_change(len(plant.decay_1_s), len(plant.known_names))
    film_1_s, air = modes.rod.diffusivity_m2_s * modes.rod.fin_1_m**2, plant.known.ambient
    own = np.arange(n_x) < len(modes)
    passive = none._replace(
        rate_1_s=np.where(own, -plant.decay_1_s, 0.0), known=np.where(own, plant.E.T, 0.0)
    )
    film = none._replace(rate_1_s=np.where(own, -film_1_s, 0.0), known=none.known.copy())
    film.known[air] = np.where(own, film_1_s * plant.uniform, 0.0)
    conduction = none._replace(rate_1_s=passive.rate_1_s - film.rate_1_s, known=passive.known - film.known)
    # with more of it, all that warms or cools is slower
    slower = none._replace(rate_1_s=-passive.rate_1_s, known=-passive.known, heats=np.where(own, -1.0, 0.0))
    film_W_m2K = film_1_s / surface_rate(screw)
    k, c = screw.conductivity_W_mK, screw.specific_heat_J_kgK
    of_film = tolerance.convection if film_W_m2K > 0.0 else 0.0
    yield _Parameter(
        "convection", Kind.CONVECTION, 0, of_film, "surface.convection_W_m2K", film, film_W_m2K, film_W_m2K
    )
    yield _Parameter(
        "conductivity",
        Kind.CONDUCTIVITY,
        0,
        tolerance.conductivity,
        "screw.conductivity_W_mK",
        conduction,
        k,
        k,
    )
    yield _Parameter(
        "heat_capacity",
        Kind.HEAT_CAPACITY,
        0,
        tolerance.heat_capacity,
        "screw.specific_heat_J_kgK",
        slower,
        c,
        c,
    )
    warmer = none._replace(steady=plant.E[:, air])
    yield _Parameter("ambient_K", Kind.AMBIENT, 0, tolerance.ambient_K, "ambient.offset_K", warmer)
    for i, (end, side, x_m) in enumerate(
        ((modes.rod.left, "left", 0.0), (modes.rod.right, "right", modes.rod.length_m))
    ):
        if not end.prescribed:
            into = padded(modal_input(modes, Stretch(x_m, x_m)), n_x)
            loss = none._replace(into=-into, seen=padded(modes.theta(x_m)[0], n_x), known=none.known.copy())
            loss.known[air] = into
            name, loss_W_K = f"boundary.{side}.loss_W_K", end.biot_1_m * modes.rod.conductance_W_m
            yield _Parameter("end_W_K", Kind.END, i, tolerance.end_W_K, name, loss, loss_W_K)
    estimated = np.flatnonzero(plant.estimated).tolist()
    for j, index in enumerate(estimated):
        source = config.source[index]
        if source.law is not None and "law" in config.estimator.learnt:
            name, more, scale = f"source.{source.name}.scale", none._replace(law=index), source.scale
            yield _Parameter("law", Kind.LAW, j, source.law_uncertainty, name, more, scale, scale)


def _of_sensors(plant: Plant, config: Config, modes: Modes) -> Iterator[_Parameter]:
    """The sensors' own: what each reads too much, where it sits, how late it is."""
    n_x, tolerance = len(plant.decay_1_s), config.tolerance
    none = no_change(n_x, len(plant.known_names))
    for i, sensor in enumerate(config.sensor):
        name, offset_K = f"sensor.{sensor.name}", tolerance.offset_of_K(sensor.offset_K)
        more = none._replace(shift_K=1.0)
        yield _Parameter("offset_K", Kind.OFFSET, i, offset_K, f"{name}.offset_K", more)
        if (place_m := sensor.position_m) is not None:  # one beside the screw has no place there
            slope = none._replace(row=padded(modes.slope(place_m), n_x))
            sigma_m = tolerance.position_m
            yield _Parameter("position_m", Kind.PLACE, i, sigma_m, f"{name}.position_m", slope, place_m)
        late = none._replace(lag_s=tolerance.lag_s)
        yield _Parameter("lag_s", Kind.LAG, i, tolerance.lag_s, f"{name}.lag_s", late)
