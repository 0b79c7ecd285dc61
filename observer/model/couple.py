"""Extend a plant by the terms that couple its states: bodies and lagging sensors get states of their own."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from observer.effects.terms import Body, Fade, Lag, Radiation, StretchFilm, Term
from observer.frames import FloatArray
from observer.model.coupling import no_coupling
from observer.model.plant import OFFSET, Plant
from observer.model.rod.modes import Modes
from observer.model.rod.sources import mean_stretch
from observer.model.rod.static import Stretch, ambient_field, end_field, quadrature, source_field
from observer.model.rod.truncation import contributions
from observer.sections import Description, Screw

STEFAN_BOLTZMANN_W_M2K4 = 5.670374419e-8
NEGLIGIBLE = 1e-9
"""Rate of a film's shape against the largest, below which it is left out."""


def with_coupling(plant: Plant, modes: Modes, machine: Description, terms: Sequence[Term]) -> Plant:
    """Return the plant with the couplings of `terms`; terms of other kinds are passed over.

    New states come after the lags of the sources: one per body, in °C, then one per lagging sensor, in °C.
    """
    bodies = [t for t in terms if isinstance(t, Body)]
    lags = [t for t in terms if isinstance(t, Lag) and t.time_constant_s > 0]
    fades = [t for t in terms if isinstance(t, Fade)]
    names, m, p = plant.source_names, len(plant.source_names), len(plant.known_names)
    body_source = [names.index(b.source) for b in bodies]
    first, sensors = len(plant.decay_1_s), [plant.layout.sensors.index(t.sensor) for t in lags]
    watched = dict.fromkeys([*body_source, *(names.index(t.source) for t in fades)])
    under_C, under_F = np.zeros((m, first)), np.zeros((m, p))
    for j in watched:
        under_C[j, plant.lag_slice], under_F[j] = _dropped_under(plant, modes, machine, j)
    rows = under_C[body_source]
    rows[:, : plant.modes] += modes.rod.conductance_W_m * plant.B[: plant.modes, body_source].T
    seen = np.vstack([rows, plant.rows.C[sensors]])
    lag_F = np.where(_offsets(plant), 0.0, plant.rows.F[sensors])
    plant = _extended(plant, seen, sensors, len(bodies))
    n_x, N = len(plant.decay_1_s), plant.modes
    film_1_s, film_shape, film_ambient = _films(modes, terms, surface_rate(machine.screw))
    fade_1_K, fade_degC = np.zeros(m), np.zeros(m)
    for fade in fades:
        fade_1_K[names.index(fade.source)] = fade.per_K
        fade_degC[names.index(fade.source)] = fade.reference_degC
    emissivity = sum(t.emissivity for t in terms if isinstance(t, Radiation))
    coupling = no_coupling(n_x, m, p, N)._replace(
        active=1,
        conductance_W_m=modes.rod.conductance_W_m,
        under_C=_wide(under_C, n_x),
        under_F=under_F,
        uniform=_padded(plant.uniform[:N], n_x),
        mean=_padded(modes.integral(0.0, modes.rod.length_m)[0] / modes.rod.length_m, n_x),
        radiation=emissivity * STEFAN_BOLTZMANN_W_M2K4 * surface_rate(machine.screw),
        film_1_s=film_1_s,
        film_shape=film_shape,
        film_ambient=film_ambient,
        body_state=np.arange(first, first + len(bodies)),
        body_source=np.array(body_source, dtype=np.int64),
        body_capacity_J_K=np.array([b.capacity_J_K for b in bodies]),
        body_conductance_W_K=np.array([b.conductance_W_K for b in bodies]),
        lag_state=np.arange(first + len(bodies), n_x),
        lag_rate_1_s=np.array([1 / t.time_constant_s for t in lags]),
        lag_C=_wide(seen[len(bodies) :], n_x),
        lag_F=lag_F,
        fade_1_K=fade_1_K,
        fade_degC=fade_degC,
    )
    return replace(plant, coupling=coupling)


def surface_rate(screw: Screw) -> float:
    """P/(ρ c A) = 4/(ρ c d): the rate of loss per film coefficient, 1/s per W/m²K."""
    return 4 / (screw.density_kg_m3 * screw.specific_heat_J_kgK * screw.diameter_m)


def _dropped_under(
    plant: Plant, modes: Modes, machine: Description, source: int
) -> tuple[FloatArray, FloatArray]:
    """What the dropped modes hold of the mean temperature under a source, per W of each (m,) and per °C of
    each known input (p,).

    Near a nut that moves it is left out: its footprint is long against what the dropped modes see.
    """
    m, p = len(plant.source_names), len(plant.known_names)
    if any(moving.index == source for moving in plant.moving):
        return np.zeros(m), np.zeros(p)
    rod, stretches = modes.rod, [mean_stretch(s, machine.screw) for s in machine.source]
    nodes, weights = _inside(modes, stretches[source], stretches)
    kept = weights @ modes.theta(nodes)
    of_heats = [
        float(weights @ source_field(rod, s, nodes) - kept @ contributions(modes, s)) for s in stretches
    ]
    known = np.zeros(p)
    for q, name in enumerate(plant.known_names):
        if name in ("ambient", "left", "right"):
            steady = ambient_field(rod, nodes) if name == "ambient" else end_field(rod, name, nodes)
            decay = modes.decay_1_s
            settled = np.where(decay > 0, plant.E[: plant.modes, q] / np.where(decay > 0, decay, 1.0), 0.0)
            known[q] = weights @ steady - kept @ settled
    return np.array(of_heats), known


def _inside(modes: Modes, own: Stretch, kinks: Sequence[Stretch]) -> tuple[FloatArray, FloatArray]:
    """Nodes and weights of the mean over a stretch, of fields with kinks at the ends of others."""
    if own.width_m == 0:
        return np.array([own.a_m]), np.ones(1)
    breaks = [x for s in (own, *kinks) for x in (s.a_m, s.b_m)]
    nodes, weights = quadrature(modes.rod, breaks)
    inside = (nodes > own.a_m) & (nodes < own.b_m)
    return nodes[inside], weights[inside] / own.width_m


def _offsets(plant: Plant) -> FloatArray:
    """Which known inputs (p,) are a sensor's offset."""
    return np.array([name.startswith(OFFSET) for name in plant.known_names])


def _extended(plant: Plant, seen: FloatArray, sensors: Sequence[int], bodies: int) -> Plant:
    """The plant with one more state per row of `seen` (e, n_x), whose value it starts at."""
    if not len(seen):
        return plant
    e, n_x = len(seen), len(plant.decay_1_s) + len(seen)
    J = np.vstack([np.eye(len(plant.decay_1_s)), seen])
    prior, smooth = J @ plant.prior_P @ J.T, J @ plant.smooth_P @ J.T
    own = np.arange(n_x - e, n_x - e + bodies)  # a body need not be as warm as the screw it touches
    prior[own, own] += smooth[own, own]
    C, F = _wide(plant.rows.C, n_x), plant.rows.F.copy()
    for i, sensor in enumerate(sensors):
        C[sensor] = 0.0
        C[sensor, n_x - len(sensors) + i] = 1.0
        F[sensor] = np.where(_offsets(plant), F[sensor], 0.0)
    moving = tuple(
        replace(
            s,
            table=replace(
                s.table,
                mean_B=_padded(s.table.mean_B, n_x),
                mean_C=_without(s.table.mean_C, sensors),
                table_C=_without(s.table.table_C, sensors),
            ),
            ends_B=_padded(s.ends_B, n_x),
            ends_C=_without(s.ends_C, sensors),
        )
        for s in plant.moving
    )
    return replace(
        plant,
        decay_1_s=_padded(plant.decay_1_s, n_x),
        B=_tall(plant.B, n_x),
        E=_tall(plant.E, n_x),
        rows=replace(plant.rows, C=C, F=F),
        moving=moving,
        uniform=np.concatenate([plant.uniform, np.ones(e)]),
        prior_P=prior,
        smooth_P=smooth,
        field_noise_Q=_tall(_wide(plant.field_noise_Q, n_x), n_x),
    )


def _films(modes: Modes, terms: Sequence[Term], rate: float) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Films along stretches: rates (f,), the shapes (f, N) that decay at them, the ambient's input (N,).

    The rates are the eigenvalues of Σ extra P/(ρcA) · (1/α) ∫ θ_i θ_j dx over the stretches.
    """
    films = [t for t in terms if isinstance(t, StretchFilm)]
    N = len(modes)
    if not films:
        return np.zeros(0), np.zeros((0, N)), np.zeros(0)
    matrix, ambient = np.zeros((N, N)), np.zeros(N)
    for film in films:
        nodes, weights = quadrature(modes.rod, [film.from_m, film.to_m])
        inside = (nodes >= film.from_m) & (nodes <= film.to_m)
        theta = modes.theta(nodes[inside])
        scale = film.extra_W_m2K * rate / modes.rod.diffusivity_m2_s
        weighed = theta * (scale * weights[inside])[:, None]
        matrix += weighed.T @ theta
        ambient += weighed.sum(axis=0)
    rates, shapes = np.linalg.eigh(matrix)
    felt = np.abs(rates) > NEGLIGIBLE * np.abs(rates).max()
    return rates[felt], np.ascontiguousarray(shapes[:, felt].T), ambient


def _padded(vector: FloatArray, size: int) -> FloatArray:
    return np.concatenate([vector, np.zeros(size - len(vector))])


def _wide(matrix: FloatArray, columns: int) -> FloatArray:
    return np.hstack([matrix, np.zeros((len(matrix), columns - matrix.shape[1]))])


def _tall(matrix: FloatArray, rows: int) -> FloatArray:
    return np.vstack([matrix, np.zeros((rows - len(matrix), matrix.shape[1]))])


def _without(columns: FloatArray, sensors: Sequence[int]) -> FloatArray:
    """A lag's output column, or a table of them, with those sensors' entries at zero."""
    out = columns.copy()
    out[..., list(sensors)] = 0.0
    return out
