"""Where and when a prediction is wrong, and with which regressor its error correlates: by sensor and phase.

For an unknown cause the error is also expressed as heat. Every sensor gets a latent heat in every window of
ten minutes; the model gives the responses. The most likely heats under a wide prior are Tikhonov's solution.
The largest, relative to its standard deviation, shows where and when something unmodelled happened.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from observer.config.machine import Config
from observer.config.sections import Source
from observer.config.sensors import Sensor
from observer.fit.hypothesis import Fit
from observer.fit.linear import LinearFit
from observer.fit.problem import Problem
from observer.fit.runs import Run
from observer.fit.steps import SteppedRun
from observer.frames import BoolArray, FloatArray
from observer.model.cycle import DWELL_S, FAST, PHASES


@dataclass(frozen=True)
class Course:
    """One run in b means of half a minute.

    Attributes:
        phase: Number of the phase in `PHASES`, (b,).
        speed_rpm: Magnitude of the speed of the first source that has one, rpm, (b,).
        running_s: Time for which the machine has worked, s, (b,).
        working: Whether it works, (b,).
        ambient_degC: Temperature of the air, °C, (b,).
        position_m: Position of the first nut, m, (b,).
    """

    phase: NDArray[np.int64]
    speed_rpm: FloatArray
    running_s: FloatArray
    working: NDArray[np.bool_]
    ambient_degC: FloatArray
    position_m: FloatArray


def course_of(config: Config, run: SteppedRun) -> Course:
    """Return the operation of the machine in a run.

    A machine works while speed or power exceeds 2 % of the largest value in the run.

    Args:
        config: The machine.
        run: The run.
    """
    ticks, frames = run.ticks, run.run.frames
    starts = np.flatnonzero(np.diff(ticks.mean, prepend=-1))

    def mean(channel: str | None, default: float) -> FloatArray:
        if channel is None:
            return np.full(len(starts), default)
        values = np.abs(frames.values[:, frames.channels.index(channel)])
        values = np.where(np.isfinite(values), values, 0.0)
        rows = np.append(ticks.first, len(frames))[np.append(starts, len(ticks.first))]
        return np.asarray(np.add.reduceat(values, rows[:-1]) / np.maximum(np.diff(rows), 1))

    speed = mean(next((s.speed_channel for s in config.source if s.speed_channel), None), 0.0)
    power = sum((mean(s.power_channel, 0.0) for s in config.source if s.power_channel), np.zeros(len(speed)))
    working = _on(speed) | _on(power)
    fixed_degC = config.ambient.temperature_degC or 20.0
    nut = next((s.position_channel for s in config.source if s.position_channel), None)
    period_s = np.diff(ticks.time_s, prepend=0.0)
    return Course(
        phase=_phases(working, ticks.time_s, _mean_of_known(ticks.measured_degC)),
        speed_rpm=speed,
        running_s=np.cumsum(np.where(working, period_s, 0.0)),
        working=working,
        ambient_degC=mean(config.ambient.channel, fixed_degC),
        position_m=mean(nut, 0.0),
    )


def _on(values: FloatArray) -> NDArray[np.bool_]:
    """Return where a speed or power is not negligible, (b,)."""
    return np.asarray(values > 0.02 * max(values.max(initial=0.0), 1e-9))


def _phases(working: NDArray[np.bool_], time_s: FloatArray, level_degC: FloatArray) -> NDArray[np.int64]:
    """Return the index into `PHASES` of every mean, (b,)."""
    phase = np.zeros(len(working), dtype=np.int64)
    if not working.any():
        return phase
    rate = np.gradient(_filled(level_degC), time_s) if len(time_s) > 2 else np.zeros(len(time_s))
    smooth = np.convolve(rate, np.ones(5) / 5)[2 : 2 + len(rate)]  # "same" is five long for fewer than five
    fast = smooth > FAST * max(float(smooth.max()), 1e-9)
    begin = int(np.argmax(working))
    phase[begin:] = np.where(fast[begin:], PHASES.index("heat_up"), PHASES.index("steady"))
    edges = np.flatnonzero(np.diff(np.concatenate([[True], working[begin:], [True]]).astype(int))) + begin
    for off, on in zip(edges[::2], edges[1::2], strict=False):
        works_after = on < len(working)
        short = works_after and time_s[on - 1] - time_s[off] < DWELL_S
        phase[off:on] = PHASES.index("dwell" if short else "cool_down")
    return phase


def _mean_of_known(values: FloatArray) -> FloatArray:
    """Return the mean of each row (b, s) over its finite values, NaN without any."""
    count = np.isfinite(values).sum(axis=1)
    return np.where(count > 0, np.nansum(values, axis=1) / np.maximum(count, 1), np.nan)


def _filled(values: FloatArray) -> FloatArray:
    """Return the values (b,) with missing ones interpolated."""
    finite = np.isfinite(values)
    if not finite.any():
        return np.zeros_like(values)
    index = np.arange(len(values))
    return np.asarray(np.interp(index, index[finite], values[finite]))


def courses_of(problem: Problem) -> tuple[Course, ...]:
    """Return the course of every run of a problem."""
    return tuple(course_of(problem.config, run) for run in problem.forward.runs)


TELLING_S = 1800.0
"""Least duration of the longest log for slow effects to be identifiable."""
WARM_SIGMA = 20.0
"""Least rise of some sensor, in units of its noise."""
SPEEDS_APART = 0.1
"""Relative difference below which two speeds count as one."""
LASTS_MEANS = 6
"""A speed or a rest counts if it lasts three minutes."""


def missing_excitation(config: Config, runs: Sequence[Run], courses: Sequence[Course]) -> tuple[str, ...]:
    """Return the excitation that the logs lack, a clause for each; empty if nothing is missing.

    Required are half an hour, a rise of 20 σ of noise, two speeds and a rest.

    Args:
        config: The machine.
        runs: The prepared logs.
        courses: Operation of the machine in each of them.
    """
    out = []
    longest_s = max(run.duration_s for run in runs)
    if longest_s < TELLING_S:
        out.append(f"the longest log lasts {longest_s / 60:.0f} min, and {TELLING_S / 60:.0f} min are needed")
    rise = max(float(np.nanmax(np.abs(r.measured_degC - r.start_degC), initial=0.0)) for r in runs)
    least_K = WARM_SIGMA * max(s.noise for s in config.sensor)
    if rise < least_K:
        out.append(f"no sensor moves by more than {rise:.2f} K, and {least_K:.1f} K are needed")
    turning = any(s.speed_channel is not None for s in config.source)
    speeds = speeds_rpm(courses)
    if turning and len(speeds) == 0:
        out.append("the screw never turns")
    if turning and len(speeds) == 1:
        out.append(f"the screw turns at {speeds[0]:.0f} rpm only, so effects of speed are not identifiable")
    if not any(np.count_nonzero(~c.working) >= LASTS_MEANS for c in courses):
        out.append("the machine never rests, so effects that act at rest are not identifiable")
    return tuple(out)


def speeds_rpm(courses: Sequence[Course]) -> list[float]:
    """Return the speeds at which the screw turned for three minutes or more, rpm, in increasing order.

    Speeds within a tenth of each other count as one, given as their median.
    """
    speeds: FloatArray = np.sort(np.concatenate([c.speed_rpm[c.working] for c in courses]))
    out: list[float] = []
    while len(speeds):
        near = speeds <= speeds[0] * (1 + SPEEDS_APART)
        if speeds[0] > 0 and np.count_nonzero(near) >= LASTS_MEANS:
            out.append(float(np.median(speeds[near])))
            speeds = speeds[~near]
        else:
            speeds = speeds[1:]
    return out


LEAST_MEANS = 6
MOST = 12
BLOCK_MEANS, DRAWS = 20, 200
"""Blocks of ten minutes for the bootstrap."""


@dataclass(frozen=True, slots=True)
class ErrorLocation:
    """The error of one sensor in one phase, measured minus predicted.

    Attributes:
        sensor: Name of the sensor.
        phase: Name of the phase.
        regressor: The quantity that the sensor's error correlates with best, over all phases.
        rms_K: Root mean square, K.
        mean_K: Mean, K.
        correlation: Correlation with the regressor, -1 to 1.
        correlation_ci95: Its 95 % interval from a block bootstrap.
    """

    sensor: str
    phase: str
    regressor: str
    rms_K: float
    mean_K: float
    correlation: float
    correlation_ci95: tuple[float, float]


def localised(fit: Fit) -> tuple[ErrorLocation, ...]:
    """Return where a fit is wrong on the rows that it may use, the worst first, at most twelve places.

    Phases with fewer than six means are left out.
    """
    problem, evidence = fit.problem, fit.problem.evidence
    error_K = problem.error_K(fit.config)
    courses = courses_of(problem)
    names = [s.name for s in problem.config.sensor]
    phase = np.array([courses[r].phase[m] for r, m in zip(evidence.run, evidence.mean, strict=True)])
    regressors = {key: evidence.rows(values) for key, values in _regressors(fit, courses).items()}
    places = []
    for s, name in enumerate(names):
        of_sensor = evidence.used & (evidence.sensor == s)
        key, correlation, ci95 = _goes_with(error_K, regressors, of_sensor)
        for p, phase_name in enumerate(PHASES):
            counted = of_sensor & (phase == p)
            if np.count_nonzero(counted) >= LEAST_MEANS:
                rms_K, mean_K = float(np.sqrt(np.mean(error_K[counted] ** 2))), float(error_K[counted].mean())
                places.append(ErrorLocation(name, phase_name, key, rms_K, mean_K, correlation, ci95))
    return tuple(sorted(places, key=lambda place: -place.rms_K)[:MOST])


def _regressors(fit: Fit, courses: Sequence[Course]) -> dict[str, list[FloatArray]]:
    """Return the regressors of an error by name, (b, s) for each run."""
    problem = fit.problem
    out: dict[str, list[FloatArray]] = {}
    for run, course in zip(problem.forward.runs, courses, strict=True):
        measured = run.ticks.measured_degC
        rise = measured - course.ambient_degC[:, None]
        one = np.ones(measured.shape[1])
        film = (course.speed_rpm / 1000.0) ** (2 / 3)
        by_name = {
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
        for key, values in by_name.items():
            out.setdefault(key, []).append(values)
    return out


def _goes_with(
    error_K: FloatArray, regressors: dict[str, FloatArray], rows: BoolArray
) -> tuple[str, float, tuple[float, float]]:
    """Return the regressor that correlates best with an error, the correlation, and its 95 % interval."""
    error = error_K[rows]
    best, strongest = "none", 0.0
    for key, values in regressors.items():
        r = _correlation(error, values[rows])
        if abs(r) > abs(strongest):
            best, strongest = key, r
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
    return best, strongest, (low, high)


def _correlation(a: FloatArray, b: FloatArray) -> float:
    finite = np.isfinite(a) & np.isfinite(b)
    if np.count_nonzero(finite) < LEAST_MEANS:
        return 0.0
    a, b = a[finite] - a[finite].mean(), b[finite] - b[finite].mean()
    size = float(np.linalg.norm(a) * np.linalg.norm(b))
    return float(a @ b) / size if size > 0 else 0.0


WINDOW_S = 600.0
PRIOR_W = 10.0
LEAST_SIGMA = 4.0
"""Windows next to the worst one with at least this significance belong to the same event."""


class Event(NamedTuple):
    """The largest unmodelled heat: where and when it occurred.

    Attributes:
        sensor: Name of the nearest sensor.
        phase: Name of the phase.
        run: Number of the run, from 0.
        from_s: Beginning within the run, s.
        to_s: End within the run, s.
        heat_W: Latent heat of the worst window, W.
        sigma_W: Its σ, W.
        error_K: Mean of measured minus predicted at that sensor over that time, K.
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
    """Return the event that a fit explains worst, over all runs, by the ratio of heat to σ.

    Each sensor has a latent heat in each window of ten minutes, with a prior of 10 W.
    """
    problem = fit.problem
    error_K = problem.error_K(fit.config)
    events = [_in_run(fit, i, error_K) for i in range(len(problem.forward.runs))]
    return max(events, key=lambda e: abs(e.heat_W) / e.sigma_W)


def _in_run(fit: Fit, run: int, error_K: FloatArray) -> Event:
    problem, evidence = fit.problem, fit.problem.evidence
    of_run = evidence.run == run
    ticks = problem.forward.runs[run].ticks
    window = np.maximum(np.ceil(ticks.time_s / WINDOW_S - 1e-9).astype(int) - 1, 0)
    windows, sensors = int(window.max()) + 1, len(problem.config.sensor)
    forward = problem.forward
    predicted = forward(fit.config)[run]
    steps = [forward(_one_watt_at(fit.config, sensor))[run] - predicted for sensor in fit.config.sensor]
    G = np.zeros((len(evidence.run), sensors * windows))
    mean, sensor = evidence.mean[of_run], evidence.sensor[of_run]
    for w in range(windows):
        begin = int(np.argmax(window >= w))
        end = int(np.argmax(window > w)) if (window > w).any() else len(window)
        for j, step in enumerate(steps):
            pulse = _delayed(step, begin) - _delayed(step, end)
            G[of_run, j * windows + w] = pulse[mean, sensor]
    A, b = evidence.whitened(G)[of_run], evidence.whitened(error_K)[of_run]
    linear = LinearFit.of(A, b, 1.0 / PRIOR_W)
    q, sigma = (values.reshape(sensors, windows) for values in (linear.step, linear.sigma))
    worst, at = np.unravel_index(int(np.argmax(np.abs(q / sigma))), q.shape)
    first, last = int(at), int(at)
    same = (np.abs(q[worst] / sigma[worst]) > LEAST_SIGMA) & (np.sign(q[worst]) == np.sign(q[worst, at]))
    while first > 0 and same[first - 1]:
        first -= 1
    while last + 1 < windows and same[last + 1]:
        last += 1
    inside = of_run & (evidence.sensor == worst)
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
    """Return the configuration with 1 W at a sensor's position, on the screw or on a node."""
    if sensor.position_m is not None:
        location = {"shape": "point", "position_m": sensor.position_m}
    else:
        location = {"shape": "node", "nodes": {sensor.on: 1.0}}
    one = Source(name="one_watt", heat_W=1.0, estimate=False, **location)  # type: ignore[arg-type]
    return config.model_copy(update={"source": (*config.source, one)})


def _delayed(step: FloatArray, by: int) -> FloatArray:
    """Return the response to a step, delayed by `by` means."""
    return np.vstack([np.zeros((by, step.shape[1])), step[: len(step) - by]])
