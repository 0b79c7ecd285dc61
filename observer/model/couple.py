"""Extend a plant by the terms that couple its states: bodies and lagging sensors get states of their own."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from observer.effects.terms import Body, Fade, Lag, Radiation, StretchFilm, Term
from observer.frames import FloatArray
from observer.model.coupling import no_coupling
from observer.model.plant import OFFSET, Plant, Rows
from observer.model.rod.modes import Modes
from observer.model.rod.static import quadrature
from observer.sections import Screw

STEFAN_BOLTZMANN_W_M2K4 = 5.670374419e-8


def with_coupling(plant: Plant, modes: Modes, screw: Screw, terms: Sequence[Term]) -> Plant:
    """Return the plant with the couplings of `terms`; terms of other kinds are passed over.

    New states come after the lags of the sources: one per body, in °C, then one per lagging sensor, in °C.
    """
    bodies = [t for t in terms if isinstance(t, Body)]
    lags = [t for t in terms if isinstance(t, Lag) and t.time_constant_s > 0]
    films = [t for t in terms if isinstance(t, StretchFilm)]
    fades = [t for t in terms if isinstance(t, Fade)]
    first, sensors = len(plant.decay_1_s), [plant.layout.sensors.index(t.sensor) for t in lags]
    seen = np.vstack([_under(plant, modes, bodies), plant.rows.C[sensors]])
    lag_F = np.where(_offsets(plant), 0.0, plant.rows.F[sensors])
    plant = _extended(plant, seen, sensors, len(bodies))
    n_x, m, N = len(plant.decay_1_s), len(plant.source_names), plant.modes
    length_m = modes.rod.length_m
    mean = _padded(modes.integral(0.0, length_m)[0] / length_m, n_x)
    uniform = _padded(plant.uniform[:N], n_x)
    film, film_ambient = _films(modes, films, n_x, surface_rate(screw))
    fade_1_K, fade_degC = np.zeros(m), np.zeros(m)
    for fade in fades:
        fade_1_K[plant.source_names.index(fade.source)] = fade.per_K
        fade_degC[plant.source_names.index(fade.source)] = fade.reference_degC
    emissivity = sum(t.emissivity for t in terms if isinstance(t, Radiation))
    coupling = no_coupling(n_x, m, len(plant.known_names), N)._replace(
        active=1,
        conductance_W_m=modes.rod.conductance_W_m,
        uniform=uniform,
        mean=mean,
        radiation=emissivity * STEFAN_BOLTZMANN_W_M2K4 * surface_rate(screw),
        film=film,
        film_ambient=film_ambient,
        body_state=np.arange(first, first + len(bodies)),
        body_source=np.array([plant.source_names.index(b.source) for b in bodies], dtype=np.int64),
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


def _under(plant: Plant, modes: Modes, bodies: Sequence[Body]) -> FloatArray:
    """Rows (b, n_x) of the mean temperature under the sources at which bodies stand."""
    rows = np.zeros((len(bodies), len(plant.decay_1_s)))
    for i, body in enumerate(bodies):
        B = plant.B[: plant.modes, plant.source_names.index(body.source)]
        rows[i, : plant.modes] = modes.rod.conductance_W_m * B
    return rows


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
    at = np.arange(n_x - e, n_x - e + bodies)
    prior[at, at] += np.diag(plant.smooth_P).max() * 0.25
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
        rows=Rows(C, F, plant.rows.sensors, plant.rows.grid),
        moving=moving,
        uniform=np.concatenate([plant.uniform, np.ones(e)]),
        prior_P=prior,
        smooth_P=smooth,
        field_noise_Q=_tall(_wide(plant.field_noise_Q, n_x), n_x),
    )


def _films(
    modes: Modes, films: Sequence[StretchFilm], n_x: int, rate: float
) -> tuple[FloatArray, FloatArray]:
    """Σ extra P/(ρcA) · (1/α) ∫ θ_i θ_j dx over each stretch, and the same of θ_i times 1 °C of ambient."""
    if not films:
        return np.zeros((0, 0)), np.zeros(0)
    matrix, ambient = np.zeros((n_x, n_x)), np.zeros(n_x)
    N = len(modes)
    for film in films:
        nodes, weights = quadrature(modes.rod, [film.from_m, film.to_m])
        inside = (nodes >= film.from_m) & (nodes <= film.to_m)
        theta = modes.theta(nodes[inside])
        scale = film.extra_W_m2K * rate / modes.rod.diffusivity_m2_s
        weighed = theta * (scale * weights[inside])[:, None]
        matrix[:N, :N] += weighed.T @ theta
        ambient[:N] += weighed.sum(axis=0)
    return matrix, ambient


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
