"""Process noise of the heats and of the field, by maximum likelihood from the logs.

Both must be estimated: if the field were taken to follow the model exactly, model errors could only show as
jumping heats, and the gate would then reject correct sensors.

No parameter is learnt meanwhile: what one log's parameters could absorb is left to the noise, since the next
day may differ by that much. Considered parameters are excluded as well: innovations would then share one
error throughout, and their product would be no likelihood.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from observer.config import Config
from observer.estimators import packing
from observer.estimators.steps import StepCache, chunks
from observer.fit.parameters import thermal_only
from observer.fit.runs import prepare_all
from observer.frames import FloatArray, FrameBlock, Inputs
from observer.kernels import record, run_kalman
from observer.model.build import build_plant
from observer.model.drive import Drive
from observer.model.plant import Plant

MOST_ROWS = 3000
"""In all runs together: the filter runs some eighty times."""
FIELD_BOUNDS_K_SQRT_S, HEAT_BOUNDS_W_SQRT_S = (1e-4, 0.1), (1e-3, 1e2)
_SWEEPS = 2
FIELD = "estimator.field_noise_K_sqrt_s"


def fit_noise(config: Config, runs: Sequence[Sequence[FrameBlock]]) -> dict[str, float]:
    """Return the most likely `estimator.field_noise_K_sqrt_s` and `source.<name>.random_walk_W_sqrt_s`.

    Call it with the calibrated configuration. Of a long run only the part around the largest change of
    heat is used, of its thermocouples only. First the field's noise is fitted, then the heats', then the
    field's again. Raises `LogError` as `prepare` does.
    """
    config = thermal_only(config)
    plant, unit_Q = build_plant(config), _unit_field_noise(config)
    drive = Drive(config, plant)
    prepared = prepare_all(config, runs)
    each = MOST_ROWS // len(prepared)
    logs = [liveliest(drive.run(drive.initial(), run.frames)[1], each) for run in prepared]

    def with_field_noise(plant: Plant) -> tuple[Plant, float]:
        noise = _most_likely_field_noise(plant, unit_Q, logs)
        return replace(plant, field_noise_Q=noise**2 * unit_Q), noise

    plant, _ = with_field_noise(plant)
    walks = fit_process_noise(plant, logs)
    _, noise = with_field_noise(replace(plant, random_walk_W2_s=walks**2))
    names = [f"source.{s.name}.random_walk_W_sqrt_s" for s in config.source if s.estimate and not s.follows]
    return {FIELD: noise} | dict(zip(names, walks.tolist(), strict=True))


def liveliest(inputs: Inputs, rows: int) -> Inputs:
    """Return at most `rows` consecutive steps, the largest change of heat by law a third into them."""
    change = np.abs(inputs.law_jump_W).sum(axis=1)
    begin = int(np.clip(np.argmax(change) - rows // 3, 0, max(len(inputs) - rows, 0)))
    return inputs.part(begin, begin + rows)


def _unit_field_noise(config: Config) -> FloatArray:
    """The covariance rate (n_x, n_x) of a field noise of 1 K/√s."""
    settings = config.estimator.model_copy(update={"field_noise_K_sqrt_s": 1.0})
    return build_plant(config.model_copy(update={"estimator": settings})).field_noise_Q


def _most_likely_field_noise(plant: Plant, unit_Q: FloatArray, logs: Sequence[Inputs]) -> float:
    def cost(log10_noise: float) -> float:
        trial = replace(plant, field_noise_Q=10.0 ** (2.0 * log10_noise) * unit_Q)
        return -sum(innovations_log_likelihood(trial, log) for log in logs)

    return float(10.0 ** least(cost, *np.log10(FIELD_BOUNDS_K_SQRT_S).tolist()))


def fit_process_noise(plant: Plant, logs: Sequence[Inputs]) -> FloatArray:
    """Return the `random_walk_W_sqrt_s` (m_e,) of the estimated heats that makes the logs most likely.

    First one factor common to all heats, then each heat in turn, twice; each by a bounded search over log10.
    """

    def cost(log10_walk: FloatArray) -> float:
        trial = replace(plant, random_walk_W2_s=10.0 ** (2.0 * log10_walk))
        return -sum(innovations_log_likelihood(trial, log) for log in logs)

    low, high = np.log10(HEAT_BOUNDS_W_SQRT_S)
    walk = np.clip(0.5 * np.log10(np.maximum(plant.random_walk_W2_s, 1e-300)), low, high)
    shift = least(lambda d: cost(np.clip(walk + d, low, high)), low - walk.max(), high - walk.min())
    walk = np.clip(walk + shift, low, high)
    if len(walk) > 1:
        for j in list(range(len(walk))) * _SWEEPS:
            own = np.arange(len(walk)) == j
            walk[j] = least(lambda v, own=own: cost(np.where(own, v, walk)), low, high)  # type: ignore[misc]
    return np.asarray(10.0**walk)


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


def least(cost: Callable[[float], float], low: float, high: float) -> float:
    """Return where a function of a logarithm to base 10 is least, to 0.02."""
    from scipy.optimize import minimize_scalar  # noqa: PLC0415  (slow to import)

    found = minimize_scalar(cost, bounds=(low, high), method="bounded", options={"xatol": 0.02})
    return float(found.x)
