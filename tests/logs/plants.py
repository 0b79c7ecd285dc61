"""Small plants made by hand or from a configuration; the truth of their physics is tested elsewhere."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from observer.frames import Layout
from observer.model.build import build_plant
from observer.model.coupling import no_coupling
from observer.model.plant import MovingSource, OutputRows, Plant
from observer.model.rod.moving import NutTable, columns_at
from tests.logs.machines import config_of
from tests.logs.rounding import firm

LENGTH_M, DIAMETER_M, CONDUCTIVITY_W_MK, RHO_C_J_M3K = 0.6, 0.03, 50.0, 7800.0 * 460.0
ALPHA_M2_S = CONDUCTIVITY_W_MK / RHO_C_J_M3K
AREA_M2 = np.pi * DIAMETER_M**2 / 4
AMBIENT_DEGC = 20.0


def theta(position_m, modes):
    """Mode shapes of an insulated rod, (places, modes), normalised so that ∫θ²/α dx = 1."""
    n = np.arange(modes)
    shape = np.sqrt(2 * ALPHA_M2_S / LENGTH_M) * np.cos(
        np.outer(np.atleast_1d(position_m), n * np.pi / LENGTH_M)
    )
    shape[:, 0] = np.sqrt(ALPHA_M2_S / LENGTH_M)
    return shape


def source_columns(index, at_m, modes, sources, lag_1_s, places_m):
    """Input column (k, n_x) of a point source at `at_m` (k,) and output column (k, R) of its lag."""
    at_m = np.atleast_1d(at_m)
    B = np.zeros((len(at_m), modes + sources))
    B[:, :modes] = theta(at_m, modes) / (CONDUCTIVITY_W_MK * AREA_M2)
    B[:, modes + index] = lag_1_s
    return B, 0.02 * np.exp(-np.abs(at_m[:, None] - places_m) / 0.02)


def empty_table(n_x, rows):
    """A nut's table with nothing in it: the columns of what moves are given to these plants."""
    none = np.zeros(0)
    return NutTable(
        none,
        none,
        none,
        1.0,
        0.05,
        LENGTH_M,
        LENGTH_M,
        0,
        1.0,
        np.zeros((2, rows)),
        np.zeros(n_x),
        np.zeros(rows),
    )


def rod(
    sensors_m=(0.05, 0.2, 0.42, 0.55),
    sources_m=(0.0, 0.3, 0.6),
    modes=8,
    film_W_m2K=15.0,
    moving=(),
    estimated=None,
    noise_K=0.05,
    walk_W_sqrt_s=0.2,
    heat_rate_1_s=0.0,
    grid=5,
    lag_gain=True,
    law_uncertainty=0.2,
    initial_sigma_W=30.0,
    initial_sigma_K=2.0,
):
    """Insulated rod with point sources and surface loss; the lags carry an invented remainder."""
    m, s = len(sources_m), len(sensors_m)
    estimated = np.ones(m, dtype=bool) if estimated is None else np.array(estimated)
    loss = film_W_m2K * np.pi * DIAMETER_M / (RHO_C_J_M3K * AREA_M2)
    decay = ALPHA_M2_S * (np.arange(modes + 1) * np.pi / LENGTH_M) ** 2 + loss
    lag = decay[modes]
    position_m = np.linspace(0, LENGTH_M, grid)
    places = np.concatenate([sensors_m, position_m])

    B, C = np.zeros((modes + m, m)), np.zeros((len(places), modes + m))
    C[:, :modes] = theta(places, modes)
    for j, at_m in enumerate(sources_m):
        column, remainder = source_columns(j, at_m, modes, m, lag, places)
        B[:, j], C[:, modes + j] = column[0], remainder[0] * lag_gain

    uniform = np.zeros(modes + m)
    uniform[0] = np.sqrt(LENGTH_M / ALPHA_M2_S)
    E = (loss * uniform)[:, None]
    smooth = np.zeros((modes + m, modes + m))
    smooth[:modes, :modes] = np.diag(LENGTH_M / ALPHA_M2_S / (1.0 + np.arange(modes) ** 2) ** 1.5)
    m_e = int(estimated.sum())
    names = tuple(f"q{j}" for j in range(m))
    return Plant(
        layout=Layout(
            tuple(n for n, e in zip(names, estimated, strict=True) if e),
            position_m,
            tuple(f"t{i}" for i in range(s)),
            False,
        ),
        decay_1_s=np.concatenate([decay[:modes], np.full(m, lag)]),
        B=B,
        E=E,
        rows=OutputRows(C, np.full((len(places), 1), 0.0), s, grid),
        moving=tuple(
            MovingSource(j, "nut_position_m", empty_table(modes + m, len(places)), 0.0) for j in moving
        ),
        uniform=uniform,
        prior_P=initial_sigma_K**2 * smooth,
        smooth_P=initial_sigma_K**2 * smooth,
        noise_R_K2=np.full(s, noise_K**2),
        thermal=np.ones(s, dtype=np.bool_),
        estimated=estimated,
        random_walk_W2_s=np.full(m_e, walk_W_sqrt_s**2),
        heat_decay_1_s=np.full(m_e, heat_rate_1_s),
        law_uncertainty=np.full(m_e, law_uncertainty),
        initial_sigma_W=np.full(m_e, initial_sigma_W),
        field_noise_Q=np.zeros((modes + m, modes + m)),
        mode_index=tuple(range(1, modes + 1)),
        source_names=names,
        known_names=("ambient",),
        diffusion_rate_1_s=ALPHA_M2_S / LENGTH_M**2,
        dropped_rate_1_s=1.0,
        coupling=no_coupling(modes + m, m, 1),
    )


def small(moving=(), grid=3, **changes):
    """Two of three heats estimated, and two known inputs that the rows see directly as well."""
    estimated, sensors_m = (True, False, True), (0.05, 0.3, 0.55)
    plant = rod(sensors_m, modes=4, estimated=estimated, moving=moving, grid=grid, **changes)
    F = 0.1 + 0.05 * np.resize(np.arange(5), len(plant.rows.C))
    alternating = np.where(np.arange(len(plant.E)) % 2, -0.3, 0.3)[:, None] * plant.E.max()
    return replace(
        plant,
        E=np.hstack([plant.E, alternating]),
        rows=OutputRows(plant.rows.C, np.column_stack([F, F[::-1]]), plant.rows.sensors, plant.rows.grid),
        known_names=("ambient", "end"),
        coupling=no_coupling(len(plant.E), plant.B.shape[1], 2),
    )


def sensors_of(plant):
    """Where the sensors are, read back from their rows (the first two modes give x)."""
    c = plant.rows.C[: plant.rows.sensors]
    return np.arccos(np.clip(c[:, 1] / c[:, 0] / np.sqrt(2), -1, 1)) * LENGTH_M / np.pi


def at(plant, u, k):
    """The plant with its moving columns as they are at step k."""
    B, C = plant.B.copy(), plant.rows.C.copy()
    for i, source in enumerate(plant.moving):
        B[:, source.index] = u.moving_B[k, i]
        C[:, plant.modes + source.index] = u.moving_C[k, i]
    return replace(plant, B=B, rows=OutputRows(C, plant.rows.F, plant.rows.sensors, plant.rows.grid))


def described(modes=4, sensors=3, grid=3, *, moving=False, learns=False, period_s=0.5, **tables):
    """The configuration and the plant of a screw with a nut and two bearings."""
    estimator = {"period_s": period_s} | tables.pop("estimator", {})
    config = config_of(modes, sensors, grid, moving=moving, estimator=estimator, **tables)
    return config, firm(build_plant(config, nut_places=9, learns=learns))


def moving_columns(plant, places_m):
    """The columns (K, M, n_x), (K, M, R) of moving nuts that stand at these places, (K,)."""
    n_x, R, K = len(plant.decay_1_s), len(plant.rows.C), len(places_m)
    B, C = np.zeros((K, len(plant.moving), n_x)), np.zeros((K, len(plant.moving), R))
    for i, nut in enumerate(plant.moving):
        if len(nut.table.mu_1_m):
            for k, place_m in enumerate(places_m):
                B[k, i], C[k, i] = columns_at(nut.table, [float(place_m)])
                B[k, i, plant.modes + nut.index] = nut.table.lag_decay_1_s
        else:
            at_m = np.concatenate([sensors_of(plant), plant.layout.position_m])
            m = plant.B.shape[1]
            B[:, i], C[:, i] = source_columns(nut.index, places_m, plant.modes, m, plant.decay_1_s[-1], at_m)
    return B, C
