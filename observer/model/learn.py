"""Extend a plant by what of the machine is only roughly known, as its configuration tells."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from dataclasses import replace

import numpy as np

from observer.config import Config
from observer.model.couple import surface_rate
from observer.model.extend import padded
from observer.model.learning import REST_K, Kind, Parameter, learning_of, no_change
from observer.model.plant import Plant
from observer.model.rod.modes import Modes
from observer.model.rod.static import Stretch
from observer.model.rod.truncation import modal_input


def with_learning(plant: Plant, config: Config, modes: Modes) -> Plant:
    """Return the plant with what its estimator learns or allows for; as it is where that is nothing."""
    known = [*_of_machine(plant, config, modes), *_of_sensors(plant, config, modes)]
    settings = config.estimator
    return with_parameters(plant, known, settings.learnt, REST_K**2 / settings.initial_sigma_K**2)


def with_parameters(
    plant: Plant, parameters: Sequence[Parameter], learnt: Collection[str], rest: float = 0.0
) -> Plant:
    """Return the plant with those parameters of which something is not known, of which those are `learnt`
    whose kind's key is among these: a further one is one more entry here.

    What they do is described on the screw's modes, lags and nodes, whatever basis the plant has. `rest` is
    how far a screw is from the air's temperature after a night, as a part of the variance of its unknown
    field.
    """
    known = [p for p in parameters if p.sigma > 0.0]
    if not known:
        return plant
    held = plant.known.left_end is not None or plant.known.right_end is not None
    learning = learning_of(
        known,
        learnt,
        len(plant.decay_1_s),
        len(plant.known_names),
        ambient=plant.known.ambient,
        rest_P=None if held else rest * plant.smooth_P,
    )
    if plant.basis is not None:
        learning = replace(learning, arrays=learning.arrays.seen_from(plant.basis.V, plant.basis.inverse))
    return replace(plant, learning=learning, layout=replace(plant.layout, learned=learning.names))


def _of_machine(plant: Plant, config: Config, modes: Modes) -> Iterator[Parameter]:
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
    for kind, sigma, change, name, value in (
        (Kind.CONVECTION, tolerance.convection if film_W_m2K > 0.0 else 0.0, film,
         "surface.convection_W_m2K", film_W_m2K),
        (Kind.CONDUCTIVITY, tolerance.conductivity, conduction,
         "screw.conductivity_W_mK", screw.conductivity_W_mK),
        (Kind.HEAT_CAPACITY, tolerance.heat_capacity, slower,
         "screw.specific_heat_J_kgK", screw.specific_heat_J_kgK),
    ):  # fmt: skip
        yield Parameter(kind, 0, sigma, change, name, value, unit=value)
    warmer = none._replace(steady=plant.E[:, air])
    yield Parameter(Kind.AMBIENT, 0, tolerance.ambient_K, warmer, "ambient.offset_K")
    ends = ((modes.rod.left, "left", 0.0), (modes.rod.right, "right", modes.rod.length_m))
    for i, (end, side, x_m) in enumerate(ends):
        if not end.prescribed:
            into = padded(modal_input(modes, Stretch(x_m, x_m)), n_x)
            loss = none._replace(into=-into, seen=padded(modes.theta(x_m)[0], n_x), known=none.known.copy())
            loss.known[air] = into
            loss_W_K = end.biot_1_m * modes.rod.conductance_W_m
            yield Parameter(Kind.END, i, tolerance.end_W_K, loss, f"boundary.{side}.loss_W_K", loss_W_K)
    for j, index in enumerate(np.flatnonzero(plant.estimated).tolist()):
        source = config.source[index]
        if source.law is not None and Kind.LAW.key in config.estimator.learnt:
            name, more, scale = f"source.{source.name}.scale", none._replace(law=index), source.scale
            yield Parameter(Kind.LAW, j, source.law_uncertainty, more, name, scale, scale)


def _of_sensors(plant: Plant, config: Config, modes: Modes) -> Iterator[Parameter]:
    """The sensors' own: what each reads too much, where it sits, how late it is."""
    n_x, tolerance = len(plant.decay_1_s), config.tolerance
    none = no_change(n_x, len(plant.known_names))
    for i, sensor in enumerate(config.sensor):
        name, offset_K = f"sensor.{sensor.name}", tolerance.offset_of_K(sensor.offset_K)
        yield Parameter(Kind.OFFSET, i, offset_K, none._replace(shift_K=1.0), f"{name}.offset_K")
        if (place_m := sensor.position_m) is not None:  # one beside the screw has no place there
            slope = none._replace(row=padded(modes.slope(place_m), n_x))
            yield Parameter(Kind.PLACE, i, tolerance.position_m, slope, f"{name}.position_m", place_m)
        late = none._replace(lag_s=tolerance.lag_s)
        yield Parameter(Kind.LAG, i, tolerance.lag_s, late, f"{name}.lag_s")
