"""What no effect explains, as heat: which stretch of the screw takes in how many watts too many, and when.

Every sensor is given a heat of its own in every window of ten minutes. The responses are those of the model;
the heats are the most likely ones under a wide prior (Tikhonov's solution), so the largest against its
standard deviation says where and when something happened that the model does not have.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from observer.config import Config
from observer.discovery.phases import courses_of
from observer.fit.hypothesis import Fit
from observer.frames import FloatArray
from observer.model.cycle import PHASES
from observer.tables.sections import Sensor, Source

WINDOW_S = 600.0
PRIOR_W = 10.0
LEAST_SIGMA = 4.0
"""Windows beside the worst one that stand out so far belong to the same event."""


class Event(NamedTuple):
    """Where and when something unmodelled was largest.

    The sensor nearest by, phase, run (from 0), and time within the run; the latent heat with its standard
    deviation; and the error (measured less predicted) at that sensor, mean over that time.
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
    error_K = problem.evidence.measured_degC - problem.predicted(fit.config)
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
    """The response to a step that comes so many means later."""
    return np.vstack([np.zeros((by, step.shape[1])), step[: len(step) - by]])
