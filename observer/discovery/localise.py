"""Where and when a prediction is wrong, and what its error goes with: sensor by phase by regressor."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from observer.discovery.phases import Course, courses_of
from observer.fit.hypothesis import Fit
from observer.frames import BoolArray, FloatArray
from observer.model.cycle import PHASES

LEAST_MEANS = 6
MOST = 12
BLOCK_MEANS, DRAWS = 20, 200
"""Blocks of ten minutes for the bootstrap."""


@dataclass(frozen=True, slots=True)
class Place:
    """The error of one sensor in one phase: its rms and mean (measured less predicted), and the regressor it
    goes with best, with the correlation and its 95 % interval from a block bootstrap.
    """

    sensor: str
    phase: str
    regressor: str
    rms_K: float
    mean_K: float
    correlation: float
    correlation_ci95: tuple[float, float]


def localised(fit: Fit, rows: BoolArray) -> tuple[Place, ...]:
    """Return the places where a fit misses some rows (n,) of the evidence, the worst first."""
    problem, evidence = fit.problem, fit.problem.evidence
    error_K = evidence.measured_degC - problem.predicted(fit.config)
    courses = courses_of(problem)
    names = [s.name for s in problem.config.sensor]
    phase = np.array([courses[r].phase[m] for r, m in zip(evidence.run, evidence.mean, strict=True)])
    regressors = {key: evidence.rows(values) for key, values in _regressors(fit, courses).items()}
    places = []
    for s, name in enumerate(names):
        of_sensor = rows & (evidence.sensor == s)
        key, correlation, ci95 = _goes_with(error_K, regressors, of_sensor)
        for p, phase_name in enumerate(PHASES):
            mine = of_sensor & (phase == p)
            if np.count_nonzero(mine) >= LEAST_MEANS:
                rms_K, mean_K = float(np.sqrt(np.mean(error_K[mine] ** 2))), float(error_K[mine].mean())
                places.append(Place(name, phase_name, key, rms_K, mean_K, correlation, ci95))
    return tuple(sorted(places, key=lambda place: -place.rms_K)[:MOST])


def _regressors(fit: Fit, courses: Sequence[Course]) -> dict[str, list[FloatArray]]:
    """What an error may go with: for each run (b, s)."""
    problem = fit.problem
    out: dict[str, list[FloatArray]] = {}
    for run, course in zip(problem.forward.runs, courses, strict=True):
        measured = run.ticks.measured_degC
        rise = measured - course.ambient_degC[:, None]
        one = np.ones(measured.shape[1])
        film = (course.speed_rpm / 1000.0) ** (2 / 3)
        each = {
            "speed": np.outer(course.speed_rpm, one),
            "speed^(2/3)*rise": film[:, None] * rise,
            "rise": rise,
            "position": np.outer(course.position_m, one),
            "ambient": np.outer(course.ambient_degC, one),
            "dT/dt": np.gradient(measured, axis=0) if len(measured) > 2 else 0.0 * measured,
            "working": np.outer(course.working, one),
            "running_time": np.outer(course.running_s, one),
            "time": np.outer(run.ticks.time_s, one),
        }
        for key, values in each.items():
            out.setdefault(key, []).append(values)
    return out


def _goes_with(
    error_K: FloatArray, regressors: dict[str, FloatArray], rows: BoolArray
) -> tuple[str, float, tuple[float, float]]:
    """The regressor that correlates best with an error, the correlation, and its interval."""
    error = error_K[rows]
    best, most = "none", 0.0
    for key, values in regressors.items():
        r = _correlation(error, values[rows])
        if abs(r) > abs(most):
            best, most = key, r
    if best == "none":
        return best, 0.0, (0.0, 0.0)
    values = regressors[best][rows]
    blocks = np.array_split(np.arange(len(error)), max(len(error) // BLOCK_MEANS, 2))
    rng = np.random.default_rng(0)
    draws = []
    for _ in range(DRAWS):
        index = np.concatenate([blocks[i] for i in rng.integers(len(blocks), size=len(blocks))])
        draws.append(_correlation(error[index], values[index]))
    low, high = np.quantile(draws, [0.025, 0.975]).tolist()
    return best, most, (low, high)


def _correlation(a: FloatArray, b: FloatArray) -> float:
    known = np.isfinite(a) & np.isfinite(b)
    if np.count_nonzero(known) < LEAST_MEANS:
        return 0.0
    a, b = a[known] - a[known].mean(), b[known] - b[known].mean()
    size = float(np.linalg.norm(a) * np.linalg.norm(b))
    return float(a @ b) / size if size > 0 else 0.0
