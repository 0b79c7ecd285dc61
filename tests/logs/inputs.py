"""Inputs of a plant, step by step: even ones, varied ones, and those of a machine that warms."""

from __future__ import annotations

import numpy as np

from observer.frames import Inputs
from observer.model.discretise import step_matrices
from observer.model.plant import Plant
from tests.logs.plants import AMBIENT_DEGC, LENGTH_M, moving_columns
from tests.logs.rounding import firm


def inputs_of(plant, dt_s, y_degC, law_W, z, *, usable=None, columns=None, start_s=1000.0) -> Inputs:
    """Steps of lengths dt_s (K,) with readings (K, s), laws (K, m) and known inputs z (K, p) at their ends.

    What is not usable is NaN; `columns` are those of the moving nuts. Nothing is degraded or lost to turning.
    """
    K = len(dt_s)
    usable = np.ones(y_degC.shape, np.bool_) if usable is None else usable
    moving_B, moving_C = moving_columns(plant, np.full(K, LENGTH_M / 2)) if columns is None else columns
    return Inputs(
        time_s=start_s + np.cumsum(dt_s),
        dt_s=dt_s,
        y_degC=np.where(usable, y_degC, np.nan),
        usable=usable,
        quality=np.where(usable, 0, 1).astype(np.int8),
        law_W=law_W,
        law_jump_W=np.diff(law_W, axis=0, prepend=law_W[:1]),
        z_start=np.vstack([z[:1], z[:-1]]),
        z_end=z,
        moving_B=moving_B,
        moving_C=moving_C,
        degraded=np.zeros(K, np.int8),
        loss_1_s=np.zeros(K),
        loss_degC=np.zeros(K),
    )


def even_inputs(plant: Plant, steps: int, seed: int = 1) -> Inputs:
    """Inputs of an even log: noise around 20 °C, a steady law, ambient at 20 °C."""
    rng = np.random.default_rng(seed)
    dt_s = np.full(steps, 0.5)
    dt_s[0] = 0.0
    y_degC = 20.0 + 0.1 * rng.standard_normal((steps, plant.rows.sensors))
    law_W = np.full((steps, len(plant.source_names)), 9.0)
    z = np.full((steps, len(plant.known_names)), 20.0)
    none = np.zeros((steps, 0, len(plant.decay_1_s))), np.zeros((steps, 0, len(plant.rows.C)))
    return inputs_of(plant, dt_s, y_degC, law_W, z, columns=none, start_s=0.0)


def inputs(plant, steps=200, seed=0, dt_s=0.5, missing=0.1, nut_m=None, uneven=False, law_steps=True):
    """Plausible inputs: smooth noisy temperatures, laws with steps, a ramping ambient, some missing."""
    rng = np.random.default_rng(seed)
    s, m = plant.rows.sensors, plant.B.shape[1]
    dt = np.full(steps, dt_s) if not uneven else rng.choice([0.1, 0.5, 0.7, 3.0], steps)
    dt[0] = 0.0
    since_s = 1000.0 + np.cumsum(dt) - 1000.0
    rise = 0.01 * since_s[:, None] * (1 + np.arange(s)) / s
    y = AMBIENT_DEGC + 0.5 + rise + rng.normal(0, 0.05, (steps, s))
    usable = rng.random((steps, s)) >= missing
    law = np.where((np.arange(steps) // 40 % 2 == 1)[:, None] & law_steps, 20.0 + np.arange(m), 0.0)
    z = (AMBIENT_DEGC + 0.001 * since_s)[:, None]
    nut_m = np.full(steps, 0.3) if nut_m is None else nut_m
    return inputs_of(plant, dt, y, law, z, usable=usable, columns=moving_columns(plant, nut_m))


def lively(plant, steps=24, nut_m=None):
    """Known inputs that ramp, laws that are never 0, no jumps given; every step of full length."""
    u = inputs(plant, steps=steps, missing=0.0, nut_m=nut_m)
    z = np.column_stack([AMBIENT_DEGC + 0.5 * np.arange(steps), 30.0 - 0.2 * np.arange(steps)])
    u = u._replace(degraded=np.zeros(steps, dtype=np.int8), z_start=z, z_end=z + np.array([0.4, -0.1]))
    u.dt_s[:] = 0.5
    u.law_W[:] = 15.0 + 5.0 * np.sin(np.arange(steps)[:, None] + np.arange(u.law_W.shape[1]))
    u.law_jump_W[:] = 0.0
    return u


def noise(rng, shape):
    """Numbers of mean 0 and variance about 1, from sums alone."""
    return 2.0 * (rng.random(shape) + rng.random(shape) + rng.random(shape) - 1.5)


def to_and_fro(run_m, low_m=0.15 * LENGTH_M, high_m=0.8 * LENGTH_M):
    """Where a nut is that has run so far between two ends."""
    stroke_m = high_m - low_m
    along = np.mod(run_m, 2.0 * stroke_m)
    return low_m + np.minimum(along, 2.0 * stroke_m - along)


def known(plant, time_s):
    """Known inputs (K, p) at some times since the start."""
    levels = {"ambient": (20.0, 1e-3), "left": (24.0, 5e-3), "right": (22.0, -2e-3), "reference": (20.0, 0.0)}
    rows = [levels.get(name, (0.2, 1e-4)) for name in plant.known_names]
    return np.array([a for a, _ in rows]) + time_s[:, None] * np.array([b for _, b in rows])


def driven(plant, steps=60, seed=1, dt_s=0.5, missing=0.0, uneven=False, loss=False):
    """Inputs of a machine that warms: laws that come and go, an ambient that rises, a nut to and fro."""
    rng = np.random.default_rng(seed)
    s, m = plant.rows.sensors, plant.B.shape[1]
    dt = np.full(steps, dt_s)
    if uneven:
        dt = dt_s * np.array([1.0, 1.25, 0.2, 6.0])[rng.integers(0, 4, steps)]
    dt[0] = 0.0
    since_s = np.cumsum(dt)
    rise = 0.01 * since_s[:, None] * (1.0 + np.arange(s)) / s
    y = 20.5 + rise + 0.05 * noise(rng, (steps, s))
    usable = rng.random((steps, s)) >= missing
    law = np.where((np.arange(steps) // 15 % 2 == 1)[:, None], 12.0 + 3.0 * np.arange(m), 0.0)
    columns = firm(moving_columns(plant, to_and_fro(0.05 * since_s)))
    u = inputs_of(plant, dt, y, law, known(plant, since_s), usable=usable, columns=columns)
    losing = (np.arange(steps) // 10 % 2 == 1) & loss
    return u._replace(loss_1_s=np.where(losing, 2e-3, 0.0), loss_degC=np.full(steps, 18.0))


def temperatures(plant, u, heat_W, seed=0, noise_K=0.05):
    """Sensor temperatures (K, s) under heats heat_W(time since start) (m,), from rest at the ambient's
    temperature.
    """
    rng = np.random.default_rng(seed)
    x = plant.uniform * AMBIENT_DEGC
    y = np.empty(u.y_degC.shape)
    for k in range(len(u)):
        step = step_matrices(plant, float(u.dt_s[k]))
        q = heat_W(u.time_s[k] - u.time_s[0])
        x = step.decay * x + step.hold * (plant.B @ q + plant.E @ u.z_start[k])
        x += step.ramp * (plant.E @ (u.z_end[k] - u.z_start[k]))
        y[k] = plant.rows.C[: plant.rows.sensors] @ x + plant.rows.F[: plant.rows.sensors] @ u.z_end[k]
    return y + noise_K * rng.normal(size=y.shape)
