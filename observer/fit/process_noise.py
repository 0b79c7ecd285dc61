"""Process noise of the heats and of the field, by maximum likelihood from the logs.

Both must be estimated. If the field were taken to follow the model exactly, model errors could only appear as
jumping heats. The gate would then reject correct sensors.

No parameter is learnt meanwhile: errors that one log's parameters could absorb are left to the noise, because
the next day may differ by that much. Considered parameters are excluded as well. They would give all
innovations one common error, and the product of their densities would not be a likelihood.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from observer.config.machine import Config
from observer.estimators import packing
from observer.estimators.steps import StepCache, chunks
from observer.fit.evidence import FITTED_SHARE, MARGIN_SHARE
from observer.fit.parameters import thermal_only
from observer.fit.runs import prepare_all, thinned
from observer.frames import FloatArray, FrameBlock, Inputs
from observer.kernels import record, run_kalman
from observer.model.build import build_plant
from observer.model.drive import Drive
from observer.model.plant import Plant

MOST_ROWS = 3000
"""In all runs together: the filter runs some eighty times."""
CLOSEST_S = 2.0
"""Least time between two rows used: heats and field change more slowly than that."""
FIELD_BOUNDS_K_SQRT_S, HEAT_BOUNDS_W_SQRT_S = (1e-4, 0.1), (1e-3, 1e2)
AT_BOUND = 0.5
"""A noise that ends above this part of its bound is not determined by the log."""
_SWEEPS = 2
FIELD = "estimator.field_noise_K_sqrt_s"


def fit_noise(
    config: Config,
    runs: Sequence[Sequence[FrameBlock]],
    progress: Callable[[int], None] = lambda _evaluations: None,
) -> dict[str, float]:
    """Return the most likely process noise of the field and of each estimated heat.

    The last of several runs, or the end of a single one, is held back. First the field's noise is fitted,
    then the heats', then the field's again.

    Args:
        config: The calibrated configuration; displacement sensors are left out.
        runs: Frames of each log.
        progress: Called after each run of the filter with the number of runs.

    Returns:
        Values by the keys `estimator.field_noise_K_sqrt_s` and `source.<name>.random_walk_W_sqrt_s`. Empty if
        the configured noise makes the held-back part more likely, or if a noise ends near its upper bound.

    Raises:
        LogError: If an input or every sensor of a log has no value.
    """
    config = thermal_only(config)
    configured, unit_Q = build_plant(config), _unit_field_noise(config)
    parts = evidence_of_noise(config, configured, runs)
    evaluations = 0

    def cost(plant: Plant) -> float:
        nonlocal evaluations
        evaluations += 1
        progress(evaluations)
        return -sum(innovations_log_likelihood(plant, log) for log in parts.fitted)

    def with_field_noise(plant: Plant) -> tuple[Plant, float]:
        def at(log10_noise: float) -> Plant:
            return replace(plant, field_noise_Q=10.0 ** (2.0 * log10_noise) * unit_Q)

        log10_noise = least(lambda v: cost(at(v)), *np.log10(FIELD_BOUNDS_K_SQRT_S).tolist())
        return at(log10_noise), 10.0**log10_noise

    plant, _ = with_field_noise(configured)
    walks = fit_process_noise(plant, cost)
    plant, noise = with_field_noise(replace(plant, random_walk_W2_s=walks**2))
    before, after = (innovations_log_likelihood(p, parts.held_back) for p in (configured, plant))
    largest = max(noise / FIELD_BOUNDS_K_SQRT_S[1], float(np.max(walks)) / HEAT_BOUNDS_W_SQRT_S[1])
    if after < before or largest > AT_BOUND:
        return {}
    names = [f"source.{s.name}.random_walk_W_sqrt_s" for s in config.source if s.estimate and not s.follows]
    return {FIELD: noise} | dict(zip(names, walks.tolist(), strict=True))


class NoiseEvidence(NamedTuple):
    """The rows of logs for a fit of noise.

    Attributes:
        fitted: Rows that are fitted, run by run.
        held_back: Rows that judge the fit.
    """

    fitted: list[Inputs]
    held_back: Inputs


def evidence_of_noise(config: Config, plant: Plant, runs: Sequence[Sequence[FrameBlock]]) -> NoiseEvidence:
    """Return the evidence in some runs for the process noise.

    Rows closer than the estimator's period or `CLOSEST_S` are thinned. A long part is cut to the stretch
    around the largest change of heat.

    Args:
        config: The configuration, without displacement sensors.
        plant: Its model.
        runs: Frames of each log.
    """
    drive = Drive(config, plant)
    close = [
        thinned(run.frames, max(config.estimator.period_s, CLOSEST_S)) for run in prepare_all(config, runs)
    ]
    logs = [drive.run(drive.initial(), frames)[1] for frames in close]
    if len(logs) == 1:
        rows = len(logs[0])
        end, begin = round(FITTED_SHARE * rows), round((FITTED_SHARE + MARGIN_SHARE) * rows)
        logs = [logs[0].part(0, end), logs[0].part(begin)]
    *fitted, held_back = logs
    rows_a_log = MOST_ROWS // len(fitted)
    return NoiseEvidence([liveliest(log, rows_a_log) for log in fitted], liveliest(held_back, MOST_ROWS))


def liveliest(inputs: Inputs, rows: int) -> Inputs:
    """Return at most `rows` consecutive steps, the largest change of heat by law a third into them.

    Args:
        inputs: Steps of one log.
        rows: Largest number of steps; a shorter log is returned whole.
    """
    change = np.abs(inputs.law_jump_W).sum(axis=1)
    begin = int(np.clip(np.argmax(change) - rows // 3, 0, max(len(inputs) - rows, 0)))
    return inputs.part(begin, begin + rows)


def _unit_field_noise(config: Config) -> FloatArray:
    """The covariance rate (n_x, n_x) of a field noise of 1 K/√s."""
    settings = config.estimator.model_copy(update={"field_noise_K_sqrt_s": 1.0})
    return build_plant(config.model_copy(update={"estimator": settings})).field_noise_Q


def fit_process_noise(plant: Plant, cost: Callable[[Plant], float]) -> FloatArray:
    """Return the random walks of the estimated heats for which a cost is least.

    First one factor common to all heats is sought, then each heat in turn, twice. Each search is bounded and
    over the logarithm.

    Args:
        plant: The model; its random walks are the start.
        cost: Returns the negative log likelihood of a plant.

    Returns:
        `random_walk_W_sqrt_s` of each estimated heat, W/√s, (m_e,), within `HEAT_BOUNDS_W_SQRT_S`.
    """

    def cost_of(log10_walk: FloatArray) -> float:
        return cost(replace(plant, random_walk_W2_s=10.0 ** (2.0 * log10_walk)))

    low, high = np.log10(HEAT_BOUNDS_W_SQRT_S)
    walk = np.clip(0.5 * np.log10(np.maximum(plant.random_walk_W2_s, 1e-300)), low, high)
    shift = least(lambda d: cost_of(np.clip(walk + d, low, high)), low - walk.max(), high - walk.min())
    walk = np.clip(walk + shift, low, high)
    if len(walk) > 1:
        for j in list(range(len(walk))) * _SWEEPS:
            is_heat = np.arange(len(walk)) == j
            walk[j] = least(lambda v, is_heat=is_heat: cost_of(np.where(is_heat, v, walk)), low, high)  # type: ignore[misc]
    return np.asarray(10.0**walk)


def innovations_log_likelihood(plant: Plant, inputs: Inputs) -> float:
    """Return Σ log N(ν; 0, S) over all usable measurements, each predicted from those before it.

    The filter has no gate and starts anew. The frame that starts it does not count. Source: Schweppe (1965).

    Args:
        plant: The model without uncertain parameters.
        inputs: Steps of one log.

    Returns:
        The log likelihood; 0 if no step has a usable measurement.
    """
    bare = plant.sensors_only()
    results = packing.empty_results(bare, len(inputs))
    running = packing.thaw(packing.initial_state(bare))
    arrays, steps = packing.pack_plant(bare), StepCache(bare)
    p, work, state = record(arrays), record(packing.scratch(arrays)), record(running)
    for part, _, table, u, step in chunks(steps, inputs.sensors_only(plant.rows.sensors)):
        batch = record(packing.Batch(p, table, u, step))
        run_kalman(batch, state, record(packing.cut(results, part)), work)
    started = np.flatnonzero(np.isfinite(results.innovation).any(axis=1))
    return float(results.log_likelihood[started[1:]].sum()) if len(started) else 0.0


def least(cost: Callable[[float], float], low: float, high: float) -> float:
    """Return where a function of a logarithm to base 10 is least, to 0.05, by Brent's bounded search.

    Args:
        cost: The function, with one minimum in the range.
        low: Lower end of the logarithm.
        high: Upper end.
    """
    from scipy.optimize import minimize_scalar  # noqa: PLC0415  (slow to import)

    minimum = minimize_scalar(cost, bounds=(low, high), method="bounded", options={"xatol": 0.05})
    return float(minimum.x)
