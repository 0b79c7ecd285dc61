"""What the cases are made of: plants and inputs that are the same, to the last bit, on every computer.

Inputs come from sums, products and numpy's generator. The arrays of a plant hold cosines and what LAPACK made
of them: they are rounded to nine digits, so that one that differs by a rounding becomes the same again.
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Iterator
from dataclasses import fields, is_dataclass, replace
from typing import Any

import numpy as np

from benchmarks.plants import config_of
from observer.frames import EstimateBlock, Inputs
from observer.model.build import build_plant
from observer.model.rod.moving import columns_at
from tests.estimators.plants import LENGTH_M, sensors_of, source_columns

DIGITS = 9
NEGLIGIBLE = 1e-13
"""Of the largest entry of an array, below which one is nothing."""


def rounded(value: float) -> float:
    return float(f"{value:.{DIGITS - 1}e}")


def firm(value: Any) -> Any:
    """A record with every number in it rounded, and all else as it is."""
    if isinstance(value, np.ndarray) and value.dtype == np.float64:
        flat = value.ravel()
        finite = np.abs(flat[np.isfinite(flat)])
        least = NEGLIGIBLE * float(finite.max(initial=0.0))
        out = [rounded(x) if abs(x) > least or not math.isfinite(x) else 0.0 for x in flat.tolist()]
        return np.array(out).reshape(value.shape)
    if isinstance(value, float):
        return rounded(value)
    if is_dataclass(value) and not isinstance(value, type):
        return replace(value, **{f.name: firm(getattr(value, f.name)) for f in fields(value)})
    if isinstance(value, tuple):
        parts = [firm(part) for part in value]
        return type(value)._make(parts) if hasattr(value, "_make") else tuple(parts)
    return value


def arrays_of(value: Any) -> Iterator[np.ndarray]:
    """Every array and number in a record."""
    if isinstance(value, np.ndarray):
        yield value
    elif isinstance(value, bool | int | float):
        yield np.array(value)
    elif is_dataclass(value) and not isinstance(value, type):
        for f in fields(value):
            yield from arrays_of(getattr(value, f.name))
    elif isinstance(value, tuple | list):
        for part in value:
            yield from arrays_of(part)


def given(*records: Any) -> np.ndarray:
    """A digest of what a case begins with: where that differs, no other bits need be the same."""
    digest = hashlib.sha256()
    for record in records:
        for array in arrays_of(record):
            digest.update(repr((array.dtype.str, array.shape)).encode() + array.tobytes())
    return np.frombuffer(digest.digest(), np.uint8)


def described(modes=4, sensors=3, grid=3, *, moving=False, learns=False, period_s=0.5, **tables):
    """The configuration and the plant of a screw with a nut and two bearings."""
    estimator = {"period_s": period_s} | tables.pop("estimator", {})
    config = config_of(modes, sensors, grid, moving=moving, estimator=estimator, **tables)
    return config, firm(build_plant(config, nut_places=9, learns=learns))


def columns_of(plant, places_m):
    """The columns (K, M, n_x), (K, M, R) of moving nuts that stand at these places, (K,)."""
    n_x, R, K = len(plant.decay_1_s), len(plant.rows.C), len(places_m)
    B, C = np.zeros((K, len(plant.moving), n_x)), np.zeros((K, len(plant.moving), R))
    for i, nut in enumerate(plant.moving):
        if len(nut.table.mu_1_m):
            for k, place_m in enumerate(places_m):
                B[k, i], C[k, i] = columns_at(nut.table, [float(place_m)])
                B[k, i, nut.table.lag] = nut.table.lag_decay_1_s
        else:
            at_m = np.concatenate([sensors_of(plant), plant.layout.position_m])
            m = plant.B.shape[1]
            B[:, i], C[:, i] = source_columns(nut.index, places_m, plant.modes, m, plant.decay_1_s[-1], at_m)
    return firm(B), firm(C)


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
    z = known(plant, since_s)
    moving_B, moving_C = columns_of(plant, to_and_fro(0.05 * since_s))
    losing = (np.arange(steps) // 10 % 2 == 1) & loss
    return Inputs(
        time_s=1000.0 + since_s,
        dt_s=dt,
        y_degC=np.where(usable, y, np.nan),
        usable=usable,
        quality=np.where(usable, 0, 1).astype(np.int8),
        law_W=law,
        law_jump_W=np.diff(law, axis=0, prepend=law[:1]),
        z_start=np.vstack([z[:1], z[:-1]]),
        z_end=z,
        moving_B=moving_B,
        moving_C=moving_C,
        degraded=np.zeros(steps, np.int8),
        loss_1_s=np.where(losing, 2e-3, 0.0),
        loss_degC=np.full(steps, 18.0),
    )


def state_of(state) -> dict[str, np.ndarray]:
    """Every part of an estimator's state; what is one number, in one array."""
    parts = {f"state.{f.name}": np.asarray(getattr(state, f.name), dtype=float) for f in fields(state)}
    single = [name for name, part in parts.items() if part.ndim == 0]
    return {name: part for name, part in parts.items() if part.ndim} | {
        "state.rest": np.array([float(parts[name]) for name in single])
    }


def told(state, *blocks: EstimateBlock) -> dict[str, np.ndarray]:
    """The final state, and every column of the estimates of consecutive blocks, if there is any."""
    columns = {
        f.name: np.concatenate([getattr(block, f.name) for block in blocks]) for f in fields(EstimateBlock)
    }
    return {name: column for name, column in columns.items() if column.size} | state_of(state)


def words(text: object) -> np.ndarray:
    """What is said, as an array."""
    return np.frombuffer(repr(text).encode(), np.uint8)
