"""Likelihood of a log under the Kalman filter, and the process noise that makes the log most likely."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from observer.estimators import packing
from observer.estimators.steps import StepCache, chunks
from observer.frames import FloatArray, Inputs
from observer.kernels import record, run_kalman
from observer.model.plant import Plant

_SWEEPS = 2
_BOUNDS_W_SQRT_S = (1e-3, 1e2)


def innovations_log_likelihood(plant: Plant, inputs: Inputs) -> float:
    """Return Σ log N(ν; 0, S) over all usable measurements, each predicted from those before it.

    No gate; the frame that starts the filter does not count. Source: Schweppe (1965).
    """
    bare = plant.sensors_only()
    results = packing.empty_results(bare, len(inputs))
    running = packing.thaw(packing.initial_state(bare))
    arrays, steps = packing.pack_plant(bare), StepCache(bare)
    p, work, state = record(arrays), record(packing.scratch(arrays)), record(running)
    for part, _, table, u, step in chunks(steps, inputs.sensors_only(plant.rows.sensors)):
        run_kalman(p, table, record(u), step, state, np.inf, record(packing.cut(results, part)), work)
    started = np.flatnonzero(np.isfinite(results.innovation).any(axis=1))
    return float(results.log_likelihood[started[1:]].sum()) if len(started) else 0.0


def fit_process_noise(plant: Plant, logs: Sequence[Inputs]) -> FloatArray:
    """Return the `random_walk_W_sqrt_s` (m_e,) of the estimated heats that makes the logs most likely.

    First one factor common to all heats, then each heat in turn, twice; every one a bounded search over
    log10.
    """

    def cost(log10_walk: FloatArray) -> float:
        trial = replace(plant, random_walk_W2_s=10.0 ** (2.0 * log10_walk))
        return -sum(innovations_log_likelihood(trial, log) for log in logs)

    low, high = np.log10(_BOUNDS_W_SQRT_S)
    walk = np.clip(0.5 * np.log10(np.maximum(plant.random_walk_W2_s, 1e-300)), low, high)
    shift = least(lambda d: cost(np.clip(walk + d, low, high)), low - walk.max(), high - walk.min())
    walk = np.clip(walk + shift, low, high)
    if len(walk) > 1:
        for j in list(range(len(walk))) * _SWEEPS:
            own = np.arange(len(walk)) == j
            walk[j] = least(lambda v, own=own: cost(np.where(own, v, walk)), low, high)  # type: ignore[misc]
    return np.asarray(10.0**walk)


def least(cost: Callable[[float], float], low: float, high: float) -> float:
    """Return where a function of a logarithm to base 10 is least, to 0.02."""
    from scipy.optimize import minimize_scalar  # noqa: PLC0415  (slow to import)

    found = minimize_scalar(cost, bounds=(low, high), method="bounded", options={"xatol": 0.02})
    return float(found.x)
