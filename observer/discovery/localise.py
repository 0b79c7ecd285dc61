"""Where and when a prediction is wrong, and what its error correlates with: sensor by phase by regressor.

For an unknown cause also as heat: every sensor is given a heat of its own in every window of ten minutes. The
responses are those of the model; the heats are the most likely ones under a wide prior (Tikhonov's solution),
so the largest against its standard deviation shows where and when something unmodelled happened.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from observer.config import Config
from observer.discovery.phases import Course, courses_of
from observer.fit.hypothesis import Fit
from observer.frames import BoolArray, FloatArray
from observer.model.cycle import PHASES
from observer.tables.sections import Sensor, Source

LEAST_MEANS = 6
MOST = 12
BLOCK_MEANS, DRAWS = 20, 200
"""Blocks of ten minutes for the bootstrap."""


@dataclass(frozen=True, slots=True)
class ErrorLocation:
    """The error of one sensor in one phase: its rms and mean (measured minus predicted), and the regressor it
    correlates with best, with the correlation and its 95 % interval from a block bootstrap.
    """

    sensor: str
    phase: str
    regressor: str
    rms_K: float
    mean_K: float
    correlation: float
    correlation_ci95: tuple[float, float]


def localised(fit: Fit, rows: BoolArray) -> tuple[ErrorLocation, ...]:
    """Return where a fit is wrong on some rows (n,) of the evidence, the worst first."""
    problem, evidence = fit.problem, fit.problem.evidence
    error_K = problem.error_K(fit.config)
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
                places.append(ErrorLocation(name, phase_name, key, rms_K, mean_K, correlation, ci95))
    return tuple(sorted(places, key=lambda place: -place.rms_K)[:MOST])


def _regressors(fit: Fit, courses: Sequence[Course]) -> dict[str, list[FloatArray]]:
    """What an error may correlate with: for each run (b, s)."""
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


WINDOW_S = 600.0
PRIOR_W = 10.0
LEAST_SIGMA = 4.0
"""Windows next to the worst one with at least this significance belong to the same event."""


class Event(NamedTuple):
    """Where and when something unmodelled was largest.

    The sensor nearest by, phase, run (from 0), and time within the run; the latent heat with its standard
    deviation; and the error (measured minus predicted) at that sensor, mean over that time.
    """

    sensor: str
    phase: str
    run: int
    from_s: float
    to_s: float
    heat_W: float
    sigma_W: float
    error_K: float


def event(fit: Fit) -> Event:
    """Return the event that a fit explains worst, over all runs."""
    problem = fit.problem
    error_K = problem.error_K(fit.config)
    found = [_in_run(fit, i, error_K) for i in range(len(problem.forward.runs))]
    return max(found, key=lambda e: abs(e.heat_W) / e.sigma_W)


def _in_run(fit: Fit, run: int, error_K: FloatArray) -> Event:
    problem, evidence = fit.problem, fit.problem.evidence
    mine = evidence.run == run
    ticks = problem.forward.runs[run].ticks
    window = np.maximum(np.ceil(ticks.time_s / WINDOW_S - 1e-9).astype(int) - 1, 0)
    windows, sensors = int(window.max()) + 1, len(problem.config.sensor)
    forward = problem.forward
    here = forward(fit.config)[run]
    steps = [forward(_one_watt_at(fit.config, sensor))[run] - here for sensor in fit.config.sensor]
    G = np.zeros((len(evidence.run), sensors * windows))
    mean, sensor = evidence.mean[mine], evidence.sensor[mine]
    for w in range(windows):
        begin = int(np.argmax(window >= w))
        end = int(np.argmax(window > w)) if (window > w).any() else len(window)
        for j, step in enumerate(steps):
            pulse = _later(step, begin) - _later(step, end)
            G[mine, j * windows + w] = pulse[mean, sensor]
    A, b = evidence.whitened(G)[mine], evidence.whitened(error_K)[mine]
    P = np.linalg.inv(A.T @ A + np.eye(A.shape[1]) / PRIOR_W**2)
    q, sigma = (P @ (A.T @ b)).reshape(sensors, windows), np.sqrt(np.diag(P)).reshape(sensors, windows)
    worst, at = np.unravel_index(int(np.argmax(np.abs(q / sigma))), q.shape)
    first, last = int(at), int(at)
    same = (np.abs(q[worst] / sigma[worst]) > LEAST_SIGMA) & (np.sign(q[worst]) == np.sign(q[worst, at]))
    while first > 0 and same[first - 1]:
        first -= 1
    while last + 1 < windows and same[last + 1]:
        last += 1
    inside = mine & (evidence.sensor == worst)
    inside &= (evidence.time_s > first * WINDOW_S) & (evidence.time_s <= (last + 1) * WINDOW_S)
    course = courses_of(problem)[run]
    phase = course.phase[window == at]
    return Event(
        sensor=problem.config.sensor[int(worst)].name,
        phase=PHASES[int(np.bincount(phase).argmax())] if len(phase) else PHASES[0],
        run=run,
        from_s=first * WINDOW_S,
        to_s=min((last + 1) * WINDOW_S, float(ticks.time_s[-1])),
        heat_W=float(q[worst, at]),
        sigma_W=float(sigma[worst, at]),
        error_K=float(error_K[inside].mean()) if inside.any() else 0.0,
    )


def _one_watt_at(config: Config, sensor: Sensor) -> Config:
    """The configuration with 1 W where a sensor sits, on the screw or on a node."""
    if sensor.position_m is not None:
        where = {"shape": "point", "position_m": sensor.position_m}
    else:
        where = {"shape": "node", "nodes": {sensor.on: 1.0}}
    one = Source(name="one_watt", heat_W=1.0, estimate=False, **where)  # type: ignore[arg-type]
    return config.model_copy(update={"source": (*config.source, one)})


def _later(step: FloatArray, by: int) -> FloatArray:
    """The response to a step, delayed by so many means."""
    return np.vstack([np.zeros((by, step.shape[1])), step[: len(step) - by]])
