"""Fit the free parameters of a configuration to logs: a fit without effects, with noise as it is configured.

The heat of every source comes from its law, nothing corrects the prediction on the way (an estimator would
absorb what is wrong), and the parameters minimise the weighted squares of what is left of the 30 s means.
Pure: logs come in as frames. (Output-error method; Ljung 1999, §7.)
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from observer.config import Config
from observer.errors import LogError
from observer.fit.evidence import even
from observer.fit.forward import Forward
from observer.fit.hypothesis import MOST_STEP
from observer.fit.identifiability import Obstacle, describe, distinguishable
from observer.fit.interval import covariance, half_width
from observer.fit.minimise import Range, Stop, minimise
from observer.fit.parameters import free_keys, kind_of, replaced
from observer.fit.problem import Problem
from observer.fit.runs import LEAST_S, Run, prepare
from observer.frames import FloatArray, FrameBlock

EXACT = Stop(steps=100, little=1e-6, small=1e-3)
AT_BOUND = 1e-4
"""Distance from a bound, in natural scales."""
Progress = Callable[[int, float], None]


class Fitted(NamedTuple):
    """A parameter, the value it had, the one that fits best, and its 95 % interval."""

    key: str
    unit: str
    before: float
    value: float
    ci95: tuple[float, float]


@dataclass(frozen=True, slots=True)
class Gap:
    """Root mean square of measurement minus open-loop prediction, 30 s means, in K."""

    before_rms_K: float
    after_rms_K: float


@dataclass(frozen=True, slots=True)
class Calibration:
    """What a calibration found.

    `config` carries the fitted values; `obstacles` says which free parameters these logs cannot tell (these
    keep their values) or tell badly, and why. `gap` is over all sensors, `per_sensor` by name.
    """

    config: Config
    fitted: tuple[Fitted, ...]
    obstacles: tuple[Obstacle, ...]
    gap: Gap
    per_sensor: dict[str, Gap]

    @property
    def values(self) -> dict[str, float]:
        """The fitted values by key."""
        return {f.key: f.value for f in self.fitted}


def calibrate(
    config: Config, runs: Sequence[Sequence[FrameBlock]], progress: Progress = lambda _count, _rms_K: None
) -> Calibration:
    """Fit the free parameters of a configuration to one or more runs, each with its own initial state.

    `progress(evaluations, rms_K)` is called after each prediction. Raises `ConfigError` where a free key
    does not exist, `LogError` where the logs are too short, or tell none of the parameters.
    """
    keys = free_keys(config)
    prepared = [prepare(config, blocks, f"log {i + 1}") for i, blocks in enumerate(runs)]
    _long_enough(prepared)
    evaluations = 0

    def watch(predicted: Sequence[FloatArray]) -> None:
        nonlocal evaluations
        evaluations += 1
        progress(evaluations, _rms(np.vstack(_missed(prepared, predicted))))

    forward = Forward(config, prepared, watch, by_row=True)
    evidence = even(forward.runs, np.array([s.noise_K for s in config.sensor]))
    whole = Problem(config, keys, forward, evidence)
    told, obstacles = distinguishable(config, keys, whole.derivatives(config).columns, prepared)
    if not told:
        raise LogError(" ".join(["the logs tell none of the free parameters:", *map(describe, obstacles)]))
    problem = replace(whole, keys=told)
    after = _fitted(problem)
    fitted = _intervals(problem, after)
    before_K, after_K = (_missed(prepared, forward(c)) for c in (config, after))
    overall, per_sensor = _gaps(config, before_K, after_K)
    return Calibration(after, fitted, obstacles + _doubts(problem, fitted), overall, per_sensor)


def _fitted(problem: Problem) -> Config:
    """The configuration with the parameters that minimise the weighted squares of the residuals, checked."""
    low, high = (bound / problem.scale for bound in problem.bounds)

    def at(u: FloatArray) -> Config:
        return problem.with_free(problem.config, u * problem.scale)

    found = minimise(
        lambda u: problem.residual(at(u)),
        lambda u: problem.derivatives(at(u)).columns,
        lambda columns: columns,
        np.clip(problem.free_values(problem.config) / problem.scale, low, high),
        Range(low, high, np.full(len(low), MOST_STEP)),
        EXACT,
    )
    best = problem.free_values(at(found.theta)).tolist()
    return replaced(problem.config, dict(zip(problem.keys, best, strict=True)))


def _intervals(problem: Problem, after: Config) -> tuple[Fitted, ...]:
    """The fitted parameters with 95 % intervals that allow for residuals which resemble their neighbours."""
    means, sensors = [len(run.ticks.time_s) for run in problem.forward.runs], len(after.sensor)
    residual, J = (
        problem.evidence.laid_out(columns, means, sensors)
        for columns in (problem.residual(after), problem.derivatives(after).columns)
    )
    reach = half_width(*covariance(J, residual, means)) * problem.scale
    before, values = problem.free_values(problem.config), problem.free_values(after)
    low, high = (np.clip(values + sign * reach, *problem.bounds).tolist() for sign in (-1, 1))
    each = zip(problem.keys, before.tolist(), values.tolist(), zip(low, high, strict=True), strict=True)
    return tuple(Fitted(key, kind_of(key).unit, was, value, ci95) for key, was, value, ci95 in each)


def _doubts(problem: Problem, fitted: Sequence[Fitted]) -> tuple[Obstacle, ...]:
    """What is fitted but not to be relied on: values at their bounds, intervals as wide as the parameter."""
    doubts = []
    for f, scale, low, high in zip(fitted, problem.scale, *problem.bounds, strict=True):
        if min(abs(f.value - low), abs(f.value - high)) < AT_BOUND * scale:
            reason = f"the fit runs into its bound of {f.value:.5g} {f.unit}"
            doubts.append(Obstacle(f.key, reason, "check the model and the log"))
        elif f.ci95[1] - f.ci95[0] > 2 * scale:
            reason = "its interval is as wide as the parameter itself"
            doubts.append(Obstacle(f.key, reason, "add longer or livelier runs"))
    return tuple(doubts)


def _missed(runs: Sequence[Run], predicted: Sequence[FloatArray]) -> list[FloatArray]:
    """Measured minus predicted 30 s means of each run, (b, s); NaN where nothing was measured."""
    return [run.measured_degC - p for run, p in zip(runs, predicted, strict=True)]


def _gaps(
    config: Config, before_K: Sequence[FloatArray], after_K: Sequence[FloatArray]
) -> tuple[Gap, dict[str, Gap]]:
    before, after = np.vstack(before_K), np.vstack(after_K)
    per_sensor = {
        s.name: Gap(_rms(before[:, i]), _rms(after[:, i]))
        for i, s in enumerate(config.sensor)
        if np.isfinite(before[:, i]).any()
    }
    return Gap(_rms(before), _rms(after)), per_sensor


def _rms(residual_K: FloatArray) -> float:
    return float(np.sqrt(np.nanmean(residual_K**2)))


def _long_enough(runs: Sequence[Run]) -> None:
    longest = max((run.duration_s for run in runs), default=0.0)
    if longest < LEAST_S:
        raise LogError(
            f"the longest log lasts {longest:.0f} s and a calibration needs {LEAST_S:.0f} s at the least; "
            "record from a standstill through warming up to cooling down"
        )
