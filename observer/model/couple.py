"""Couple a plant with nodes and lagging sensors, which get states of their own.

Constant couplings become part of the generator (`generator`): links at fixed places, films along stretches,
lagging sensors. Time-varying couplings are applied step by step (`coupling`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from observer.config.effects.terms import Fade, Lag, Radiation, RisingFilm, SpeedLoss, StretchFilm, Term
from observer.config.sections import Description
from observer.frames import FloatArray
from observer.kernels.layout import packed
from observer.model.coupling import Fades, Links, Uneven, no_coupling
from observer.model.extend import (
    extended,
    lag_states,
    node_states,
    padded,
    wide,
    with_lagging_sensors,
    with_node_sensors,
    with_shown_part,
)
from observer.model.generator import Constant
from observer.model.network import (
    Attached,
    Exchange,
    NodeModes,
    attached,
    exchanges_of,
    node_modes,
    past_covariance,
    shapes_of_strokes,
    spreads,
)
from observer.model.plant import Plant
from observer.model.reduce import FullModel, bed_rows, dropped_under
from observer.model.rod.modes import Modes, Stretch, wetted_within
from observer.model.rod.screw import surface_rate
from observer.physics.constants import STEFAN_BOLTZMANN_W_m2K4


def with_coupling(
    plant: Plant,
    modes: Modes,
    full: FullModel,
    machine: Description,
    terms: Sequence[Term],
) -> tuple[Plant, Constant]:
    """Return the plant with the nodes beside it and its time-varying couplings, and its constant couplings.

    `terms` of other kinds are ignored. New states come after the lags of the sources. First come the
    amplitudes of the nodes' own modes; an isolated node has its temperature in °C as its state. Then comes
    one state per lagging sensor, in °C. `modes` are those of the plant, of the full model `full`.
    """
    bodies, screw = attached(machine, terms), len(plant.decay_1_s)
    sigma_W = np.array([heat.initial_sigma_W for heat in full.heats])
    network_modes, gain = node_modes(bodies.network), _place_gain(machine)
    under_C, under_F = _dropped(plant, modes, full, _watched(plant, bodies, terms))
    before = past_covariance(bodies, sigma_W, modes.rod.length_m, modes.rod.diffusivity_m2_s)
    places = under_C.copy()
    places[:, : plant.modes] += modes.rod.conductance_W_m * (plant.B[: plant.modes] * gain).T
    plant = extended(plant, node_states(plant, bodies, network_modes, places, _mean(modes, screw), before))
    plant = with_shown_part(
        with_node_sensors(plant, machine, bodies, network_modes, screw, bed_rows(full.places)),
        machine.sensor,
    )
    plant, lags = _with_lags(plant, terms)
    n_x, m, p = len(plant.decay_1_s), len(plant.source_names), len(plant.known_names)
    moving = [s.index for s in plant.moving]
    place_rows = wide(places, n_x)
    constant = Constant(np.zeros((n_x, n_x)), np.zeros((n_x, p)), tuple(range(n_x - len(lags), n_x)))
    _add_films(constant, plant, modes, terms, surface_rate(machine.screw))
    for node, source, G in bodies.ties:
        if source not in moving:
            row, passed = _passed(plant, network_modes, gain, screw, node, source)
            constant.A[...] += G * np.multiply.outer(passed, row - place_rows[source])
            constant.E[...] -= G * np.multiply.outer(passed, under_F[source])
    exchanges = exchanges_of(machine, bodies)
    _add_strokes(constant, modes, exchanges, moving)
    _add_warmed_air(constant, plant, modes, bodies, network_modes, screw)
    for state, (time_s, C, F) in zip(constant.follow, lags, strict=True):
        constant.A[state, : len(C)] += C / time_s
        constant.A[state, state] -= 1.0 / time_s
        constant.E[state] += F / time_s
    links = _links(plant, bodies, network_modes, gain, screw, moving)
    emissivity = sum(t.emissivity for t in terms if isinstance(t, Radiation))
    at_1_K_W_m2K = sum(float(t.film_W_m2K(1.0)) for t in terms if isinstance(t, RisingFilm))
    fades = _fades(plant, terms)
    varying = len(links.source) > 0 or emissivity > 0.0 or at_1_K_W_m2K > 0.0 or fades.per_K.any()
    coupling = no_coupling(n_x, m, p, plant.modes)._replace(
        active=int(varying or any(isinstance(t, SpeedLoss) for t in terms)),
        ambient=plant.known.ambient,
        conductance_W_m=modes.rod.conductance_W_m,
        place_gain=gain,
        under_C=wide(under_C, n_x),
        under_F=under_F,
        uniform=padded(plant.uniform[: plant.modes], n_x),
        mean=padded(_mean(modes, screw), n_x),
        square=modes.rod.diffusivity_m2_s / modes.rod.storage_m,
        radiation=emissivity * STEFAN_BOLTZMANN_W_m2K4 * surface_rate(machine.screw),
        rising=at_1_K_W_m2K * surface_rate(machine.screw),
        links=links,
        spreads=spreads(modes, machine, exchanges, moving),
        fades=fades,
        uneven=_uneven(modes, n_x),
    )
    return replace(plant, coupling=packed(coupling)), constant


def _watched(plant: Plant, bodies: Attached, terms: Sequence[Term]) -> set[int]:
    """The sources under which a temperature is read."""
    fading = {plant.source_names.index(t.source) for t in terms if isinstance(t, Fade)}
    return fading | {source for _, source, _ in bodies.ties}


def _place_gain(machine: Description) -> FloatArray:
    """The factor (m,) that scales a source's column to 1 W into the screw."""
    share = np.array([s.screw_share for s in machine.source])
    return np.where(share > 0, 1.0 / np.where(share > 0, share, 1.0), 0.0)


def _passed(
    plant: Plant, network_modes: NodeModes, gain: FloatArray, screw: int, node: int, source: int
) -> tuple[FloatArray, FloatArray]:
    """The row (n_x,) that reads a node, and the effect (n_x,) of 1 J from it to the screw at a source."""
    n_x, nodes = len(plant.decay_1_s), slice(screw, screw + len(network_modes.shape))
    row, passed = np.zeros(n_x), np.zeros(n_x)
    row[nodes], passed[nodes] = network_modes.shape[node], -network_modes.input[:, node]
    passed[:screw] = gain[source] * plant.B[:screw, source]
    return row, passed


def _add_warmed_air(
    constant: Constant, plant: Plant, modes: Modes, bodies: Attached, network_modes: NodeModes, screw: int
) -> None:
    """Add the exchange of the base film with air along stretches, without the dropped modes."""
    n_x, rod = len(plant.decay_1_s), modes.rod
    for node, air in bodies.air:
        into = rod.fin_1_m**2 * padded(modes.wetted(air.from_m, air.to_m), n_x)
        row, heated = np.zeros((2, n_x))
        row[screw : screw + len(network_modes.shape)], heated[screw : screw + len(network_modes.shape)] = (
            network_modes.shape[node],
            network_modes.input[:, node],
        )
        lost = into - rod.fin_1_m**2 * rod.wetted_m(air.from_m, air.to_m) * row
        constant.A[...] += np.multiply.outer(into, row)
        constant.A[...] += rod.conductance_W_m * np.multiply.outer(heated, lost)
        constant.E[:, plant.known.ambient] -= into


def _links(
    plant: Plant,
    bodies: Attached,
    network_modes: NodeModes,
    gain: FloatArray,
    screw: int,
    moving: Sequence[int],
) -> Links:
    """The links between nodes and nuts that move."""
    ties = [tie for tie in bodies.ties if tie[1] in moving]
    C, B = np.zeros((len(ties), len(plant.decay_1_s))), np.zeros((len(ties), len(plant.decay_1_s)))
    for i, (node, source, _) in enumerate(ties):
        C[i], passed = _passed(plant, network_modes, gain, screw, node, source)
        B[i] = gain[source] * plant.B[:, source] - passed
    return Links(
        source=np.array([source for _, source, _ in ties], dtype=np.int64),
        conductance_W_K=np.array([G for _, _, G in ties]),
        C=C,
        B=B,
    )


def _add_strokes(
    constant: Constant, modes: Modes, exchanges: Sequence[Exchange], moving: Sequence[int]
) -> None:
    """Add the exchange between nodes and nuts without a position channel beyond that of the mean."""
    N = len(modes)
    for shapes in shapes_of_strokes(modes, exchanges):
        if shapes.source not in moving:
            constant.A[:N, :N] -= (shapes.shape.T * shapes.rate_1_s) @ shapes.shape


def _with_lags(
    plant: Plant, terms: Sequence[Term]
) -> tuple[Plant, list[tuple[float, FloatArray, FloatArray]]]:
    """The plant with a state for each lagging sensor, and the time constants of these states.

    Each tuple holds a time constant, s, and the rows of states and of known inputs that the sensor follows.
    """
    lags = [t for t in terms if isinstance(t, Lag) and t.time_constant_s > 0]
    sensors = [plant.layout.sensors.index(t.sensor) for t in lags]
    C, F = plant.rows.C[sensors], np.where(plant.known.offset, 0.0, plant.rows.F[sensors])
    states = lag_states(C, len(plant.source_names), len(plant.known_names))
    followed = zip((t.time_constant_s for t in lags), C, F, strict=True)
    return with_lagging_sensors(extended(plant, states), sensors), list(followed)


def _fades(plant: Plant, terms: Sequence[Term]) -> Fades:
    """The decrease of friction with temperature."""
    per_K, reference_degC = np.zeros((2, len(plant.source_names)))
    for fade in (t for t in terms if isinstance(t, Fade)):
        per_K[plant.source_names.index(fade.source)] = fade.per_K
        reference_degC[plant.source_names.index(fade.source)] = fade.reference_degC
    return Fades(per_K, reference_degC)


def _mean(modes: Modes, n_x: int) -> FloatArray:
    """The row (n_x,) of the screw's mean temperature."""
    return padded(modes.stored() / modes.rod.storage_m, n_x)


def _uneven(modes: Modes, n_x: int) -> Uneven:
    """The shapes that a film cools each at its own rate: those of ∫ p θ_i θ_j dx/α."""
    if modes.rod.profile is None:
        return no_coupling(n_x, 0, 0).uneven
    rate, shape = np.linalg.eigh(modes.surface())
    row = wide(shape.T, n_x)
    return Uneven(rate, row, row)


def _dropped(plant: Plant, modes: Modes, full: FullModel, sources: set[int]) -> tuple[FloatArray, FloatArray]:
    """The temperature of the dropped modes under each of `sources`, (m, n_x) and (m, p); 0 elsewhere.

    A nut that moves is over its stroke: near a standing one, more is dropped.
    """
    m, p = len(plant.source_names), len(plant.known_names)
    of_states, of_known = np.zeros((m, len(plant.decay_1_s))), np.zeros((m, p))
    moving = {nut.index for nut in plant.moving}
    for j in sources:
        of_states[j], of_inputs = dropped_under(plant, modes, full, full.heats[j].stretch)
        if j not in moving:  # what a known end leaves there depends on the place
            of_known[j] = of_inputs
    return of_states, of_known


def _add_films(constant: Constant, plant: Plant, modes: Modes, terms: Sequence[Term], rate: float) -> None:
    """Add the films along stretches: Σ extra P/(ρcA) · (1/α) ∫ θ_i θ_j dx over the stretches."""
    N = plant.modes
    for film in (t for t in terms if isinstance(t, StretchFilm)):
        theta, weights = wetted_within(modes, Stretch(film.from_m, film.to_m))
        weighed = theta * (film.extra_W_m2K * rate / modes.rod.diffusivity_m2_s * weights)[:, None]
        constant.A[:N, :N] -= weighed.T @ theta
        constant.E[:N, plant.known.ambient] += weighed.sum(axis=0)
