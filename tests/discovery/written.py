"""Frozen records of a search whose residuals and predictions are written down: neither a log nor a model."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from observer.config.effects.catalogue import BY_KIND
from observer.config.machine import Config
from observer.discovery.candidates import Candidate
from observer.discovery.search import FittedCandidate
from observer.fit.evidence import Evidence
from observer.fit.hypothesis import EffectParameter, Fit
from observer.fit.problem import NuisanceColumns, Problem
from observer.frames import FloatArray
from tests.logs.machines import machine

CONFIG = machine()


def problem(fold: Sequence[int], predicted: Callable[[Config], Any] | None = None, **columns: Any) -> Problem:
    """A problem without free parameters; a row is a mean of its own, of sensor 0 unless `columns` says so."""
    n = len(fold)
    zero = np.zeros(n, dtype=np.int64)
    sensor, noise_K = columns.get("sensor", zero), columns.get("noise_K", np.ones(n))
    measured = columns.get("measured_degC", np.zeros(n))
    groups, time_s = columns.get("groups", ()), 30.0 * np.arange(n)
    evidence = Evidence(zero, np.arange(n), sensor, measured, noise_K, time_s, np.array(fold), groups)
    sensors = len(CONFIG.sensor)
    forward: Any = lambda config: [np.tile(predicted(config)[:, None], sensors)]  # type: ignore[misc]  # noqa: E731
    return Problem(CONFIG, (), forward, evidence, nuisance=columns.get("nuisance"))


def tolerance(column_K: FloatArray, whitened: FloatArray) -> NuisanceColumns:
    """One tolerance, by the change of each row with one standard deviation of it."""
    return NuisanceColumns(whitened[:, None], column_K[:, None], (None,), (None,))


def fit(of: Problem, residual: FloatArray, config: Config = CONFIG, column: FloatArray | None = None) -> Fit:
    """A fit that leaves a whitened residual; of one parameter, where its `column` is given."""
    jacobian = np.zeros((len(residual), 0)) if column is None else column[:, None]
    return Fit(of, config, (), np.zeros(0), residual, jacobian, np.ones(jacobian.shape[1]))


def left(mean_square: float, *effects: dict[str, Any], rows: int = 1000) -> Fit:
    """A fit with effects that leaves so much of each whitened row."""
    return fit(problem([0] * rows), np.full(rows, np.sqrt(mean_square)), machine(effect=list(effects)))


def trial(
    target: str, drop: float, fitted: Fit, kind: str = "sensor_bias", held_out: float = 0.5
) -> FittedCandidate:
    """An effect, by default a bias of a sensor of any name, that explains `drop`."""
    return FittedCandidate(Candidate(BY_KIND[kind], target, (), {}), fitted, drop, 0.0, held_out)


def estimated(
    config: Config, values: list[float], half_width: list[float], keys: list[tuple[int, str]]
) -> Fit:
    """A fit of effects' parameters (number, key), with values and halves of their intervals."""
    parameters = tuple(EffectParameter(effect, key, 1.0, 0.0, 2e4) for effect, key in keys)
    k = len(values)
    jacobian = np.diag(1.96 / np.array(half_width))
    return Fit(problem([0] * k), config, parameters, np.array(values), np.zeros(k), jacobian, np.ones(k))
