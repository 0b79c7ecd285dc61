"""Fit the free parameters of a configuration to logs: a hypothesis without effects.

The heat of every source comes from its law. The prediction is open loop, because an estimator would absorb
model errors. The parameters minimise the weighted squares of the residuals of the 30 s means (output-error
method; Ljung 1999, §7).

Nuisance parameters vary within their tolerances, and intervals include their uncertainty. So an offset or a
loss at an end is not mistaken for film or heat. A free parameter is fitted within its physical range, with
its tolerance as a prior. Pure: logs come in as frames.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from observer.config.machine import Config
from observer.config.sections import law_channels
from observer.errors import LogError
from observer.fit.evidence import gather
from observer.fit.forward import Forward
from observer.fit.hypothesis import Fit, FittedParameter, fit_null
from observer.fit.linear import unabsorbed
from observer.fit.parameters import FILM, free_keys, replaced
from observer.fit.prior import prior_of
from observer.fit.problem import Problem
from observer.fit.run_in import running_in_of
from observer.fit.runs import BLOCK_S, Run, calibration_tick_s, prepare_all, refuse_short
from observer.fit.tolerance import calibration_tolerances, remaining_tolerances, tolerances
from observer.frames import BoolArray, FloatArray, FrameBlock

MOST_WORSE = 1.05
"""Largest ratio by which the error of one sensor may grow if the error of all sensors together falls."""
SEEN_SIGMA = 3.0
"""A change by its natural scale must change some 30 s mean by this many standard deviations of its noise."""
APART = 0.01
"""Sine of the angle below which one parameter's effect counts as a linear combination of others'."""


class Obstacle(NamedTuple):
    """A free parameter that is not identifiable from the logs, or poorly determined.

    Attributes:
        key: Its key in the configuration, such as `source.nut.torque_Nm`.
        reason: Clause that says why.
        remedy: Clause that says what to do.
    """

    key: str
    reason: str
    remedy: str


def describe(obstacle: Obstacle) -> str:
    """Return an obstacle as a sentence: key, reason, remedy."""
    return f"{obstacle.key}: {obstacle.reason}; {obstacle.remedy}."


def distinguishable(
    config: Config, keys: tuple[str, ...], jacobian: FloatArray, runs: Sequence[Run]
) -> tuple[tuple[str, ...], tuple[Obstacle, ...]]:
    """Split the free parameters into identifiable ones and others.

    A parameter is identifiable if its effect is visible and not a linear combination of those before it. The
    latter is judged by the angle, so that a parameter's size does not matter.

    Args:
        config: The machine.
        keys: The p free parameters, in the order in which they take precedence.
        jacobian: Whitened derivatives of the prediction, in σ per natural scale, (n, p).
        runs: The logs, which give the reasons.

    Returns:
        Keys of the identifiable parameters, and an obstacle for each of the others.
    """
    identified: list[str] = []
    obstacles: list[Obstacle] = []
    for key, column in zip(keys, jacobian.T, strict=True):
        if float(np.max(np.abs(column))) < SEEN_SIGMA:
            obstacles.append(_unseen(config, key, runs))
            continue
        before = jacobian[:, [keys.index(k) for k in identified]]
        if np.linalg.norm(unabsorbed(before, column)) < APART * np.linalg.norm(column):
            obstacles.append(_mixed(key, column, identified, before))
            continue
        identified.append(key)
    return tuple(identified), tuple(obstacles)


def _mixed(key: str, column: FloatArray, identified: Sequence[str], others: FloatArray) -> Obstacle:
    """The obstacle of a parameter confounded with others, which are named by their shares."""
    share = np.linalg.lstsq(others, column)[0] * np.linalg.norm(others, axis=0) / np.linalg.norm(column)
    partners = [k for k, s in zip(identified, np.abs(share), strict=True) if s > 0.1]
    fewer = "one of the two" if len(partners) == 1 else "some of them"
    reason = f"its effect on the sensors is confounded with that of {' and '.join(partners)}"
    return Obstacle(key, reason, f"free only {fewer}")


def _unseen(config: Config, key: str, runs: Sequence[Run]) -> Obstacle:
    """The obstacle of a parameter without a visible effect."""
    if key.startswith("source."):
        source = next(s for s in config.source if key.startswith(f"source.{s.name}."))
        channels = law_channels(source, config.source)
        if channels and not any(_moves(run, channel) for run in runs for channel in channels):
            channel = channels[0]
            return Obstacle(
                key, f"{channel} stays at 0 in these logs", f"add a run in which {channel} is not 0"
            )
        return Obstacle(
            key, "its heat reaches no sensor", "add a run with more heat, or a sensor closer to it"
        )
    if key == FILM:
        return Obstacle(
            key,
            f"the screw stays within {max(map(_swing_K, runs)):.1f} K of its start",
            "add a run that warms the screw up and lets it cool",
        )
    return Obstacle(key, "it changes no sensor in these logs", "remove it from [calibrate] free")


def _moves(run: Run, channel: str) -> bool:
    values = run.frames.values[:, run.frames.channels.index(channel)]
    return bool(np.nanmax(np.abs(values), initial=0.0) > 0)


def _swing_K(run: Run) -> float:
    return float(np.nanmax(np.abs(run.measured_degC - run.start_degC), initial=0.0))


AT_BOUND = 1e-4
"""Distance from a bound, in natural scales."""
Progress = Callable[[int, float], None]


@dataclass(frozen=True, slots=True)
class ErrorRms:
    """Root mean square of measurement minus open-loop prediction, 30 s means.

    Attributes:
        before_rms_K: With the configured values, in `unit`.
        after_rms_K: With the fitted values, in `unit`.
        unit: `K`, or `um` for a displacement sensor.
    """

    before_rms_K: float
    after_rms_K: float
    unit: str = "K"


@dataclass(frozen=True, slots=True)
class HeldBack:
    """The open-loop error on the held-back part of the logs, before and after a fit to the other part.

    Attributes:
        seconds: Length of that part, s; 0 for an error over the whole logs.
        error: Error over all thermocouples.
        per_sensor: Error by sensor name, without sensors that have no value there.
    """

    seconds: float
    error: ErrorRms
    per_sensor: dict[str, ErrorRms]


@dataclass(frozen=True, slots=True)
class Calibration:
    """The result of a calibration.

    Attributes:
        config: The configuration with the fitted values, or the configured one if `kept` is not None.
        fitted: The fitted parameters with 95 % intervals, also if the configured values are kept.
        left: Remaining tolerances and the running-in of heats, by the configuration's keys.
        obstacles: Free parameters that keep their values because the logs do not identify them. Also fitted
            ones that are poorly determined.
        error: Error over all thermocouples and the whole logs.
        per_sensor: The same by sensor name.
        held_back: Error on the held-back part after the fit to the other part.
        kept: Sentence that says why the configured values are kept; None if the fitted ones are better.
    """

    config: Config
    fitted: tuple[FittedParameter, ...]
    left: dict[str, float]
    obstacles: tuple[Obstacle, ...]
    error: ErrorRms
    per_sensor: dict[str, ErrorRms]
    held_back: HeldBack
    kept: str | None = None

    @property
    def values(self) -> dict[str, float]:
        """The fitted values by key."""
        return {f.key: f.value for f in self.fitted}

    @property
    def written(self) -> dict[str, float]:
        """The configured values that come from the fit, by key: empty if the configured ones are kept."""
        return {} if self.kept is not None else self.values | self.left


def calibrate(
    config: Config, runs: Sequence[Sequence[FrameBlock]], progress: Progress = lambda _count, _rms_K: None
) -> Calibration:
    """Fit the free parameters of a configuration to one or more runs, each with its own initial state.

    The last of several runs, or the end of a single one, is held back at first. If a fit to the other part
    predicts the held-back part worse than the configured values do, the fit is repeated without losses at the
    ends and friction that settles. Short logs cannot distinguish these from heat. If that is worse too, the
    configured values are kept. Otherwise the fit is continued on all runs.

    Args:
        config: The machine, with `[calibrate] free`. Heats without a law count as 0 W.
        runs: Frames of each log, in order of time.
        progress: Called after each prediction with the number of predictions and the current rms error in K.

    Returns:
        The fitted configuration with intervals, errors and obstacles.

    Raises:
        ConfigError: If a free key does not exist, or nothing is free.
        LogError: If all logs are shorter than five minutes, if an input has no value, or if no parameter is
            identifiable.
    """
    keys = free_keys(config)
    prepared = prepare_all(config, runs)
    refuse_short(prepared, "a calibration")
    evaluations = 0

    def watch(predicted: Sequence[FloatArray]) -> None:
        nonlocal evaluations
        evaluations += 1
        progress(evaluations, _rms(np.vstack(_missed(forward, predicted))))

    forward = Forward(config, prepared, watch, tick_s=calibration_tick_s(prepared))
    noise_K = np.array([s.noise for s in config.sensor])
    evidence = gather(forward.runs, noise_K, proves=False)
    whole = Problem(config, keys, forward, evidence, tolerances_of=calibration_tolerances, prior_of=prior_of)
    white = replace(whole, evidence=replace(evidence, groups=()))
    identified, obstacles = distinguishable(config, keys, white.derivatives(config).columns, prepared)
    if not identified:
        why = " ".join(map(describe, obstacles))
        raise LogError(f"none of the free parameters is identifiable from the logs: {why}")
    whole = replace(whole, keys=identified)
    trial = replace(whole, evidence=gather(forward.runs, noise_K))
    for scope in (calibration_tolerances, tolerances):
        fit, held_back, why_kept = _judged(
            replace(whole, tolerances_of=scope), replace(trial, tolerances_of=scope)
        )
        if why_kept is None:
            break
    else:  # nothing is written; what the whole logs say is shown
        fit = fit_null(replace(whole, tolerances_of=calibration_tolerances), config)
    fitted = fit.free_parameters
    overall, per_sensor = _errors(whole, fit.config, whole.evidence.used)
    left = remaining_tolerances(config, fit.relative_sigma) | running_in_of(fit, prepared)
    after = config if why_kept is not None else replaced(config, {f.key: f.value for f in fitted})
    all_obstacles = obstacles + _doubts(fit.problem, fitted)
    return Calibration(after, fitted, left, all_obstacles, overall, per_sensor, held_back, why_kept)


def _judged(whole: Problem, trial: Problem) -> tuple[Fit, HeldBack, str | None]:
    """Fit to the part of the logs that is not held back, and judge the fit on the held-back part.

    If it predicts that part no worse than the configured values do, the fit continues on the whole logs.

    Returns:
        The last fit, its judgement, and why the configured values are kept or None.
    """
    config = whole.config
    fit = fit_null(trial, config)
    held_back = _held_back(trial, fit.config)
    why_kept = _why_kept(config, held_back)
    if why_kept is None:
        fit = fit_null(whole, fit.config)
        held_back_after = _held_back(trial, fit.config)
        whole_logs = HeldBack(0.0, *_errors(whole, fit.config, whole.evidence.used))
        why_kept = _why_kept(config, held_back_after) or _why_kept(config, whole_logs)
    return fit, held_back, why_kept


def _held_back(trial: Problem, after: Config) -> HeldBack:
    """The error on the held-back part, before and after a fit to the other part."""
    evidence, seconds = trial.evidence, 0.0
    proof = evidence.proof
    for run in np.unique(evidence.run[proof]):
        time_s = evidence.time_s[proof & (evidence.run == run)]
        seconds += float(np.ptp(time_s)) + BLOCK_S
    return HeldBack(seconds, *_errors(trial, after, proof))


def _why_kept(config: Config, judged: HeldBack) -> str | None:
    """Return why the configured values are kept where the error after a fit is larger; None where it is not.

    It may be larger over all thermocouples, or clearly larger at one of them and beyond its noise. A
    displacement may gain what thermocouples lose, by the larger factor: K and µm have no common measure. Over
    the whole logs (0 held-back seconds) only the error of all thermocouples counts.
    """
    error, per_sensor = judged.error, judged.per_sensor
    part = f"the {judged.seconds / 60.0:.0f} min of log that were held back" if judged.seconds else "the logs"
    if not per_sensor:
        return f"the configured values are kept: no sensor has a value in {part}"
    um = np.array([(e.before_rms_K, e.after_rms_K) for e in per_sensor.values() if e.unit != "K"])
    before, after = np.sqrt(np.mean(um**2, axis=0)) if len(um) else (1.0, 1.0)
    worse = error.after_rms_K * after > error.before_rms_K * before
    place, shown = "", error
    if not worse and judged.seconds and not len(um):
        for sensor in config.sensor:
            error_s = per_sensor.get(sensor.name)
            if error_s is not None and error_s.after_rms_K > max(
                MOST_WORSE * error_s.before_rms_K, sensor.noise
            ):
                worse, place, shown = True, f" at {sensor.name}", error_s
    if not worse:
        return None
    return (
        f"the configured values are kept: fitted ones predict {part} worse, {shown.after_rms_K:.3g} K rms"
        f"{place} instead of {shown.before_rms_K:.3g} K; record a longer log, from a cold start through "
        "warming up to cooling down, and correct the estimated values in the configuration"
    )


def _doubts(problem: Problem, fitted: Sequence[FittedParameter]) -> tuple[Obstacle, ...]:
    """Fitted parameters that are unreliable: values at their bounds, intervals as wide as the parameter."""
    doubts = []
    for f, scale, low, high in zip(fitted, problem.scale, *problem.bounds, strict=True):
        if min(abs(f.value - low), abs(f.value - high)) < AT_BOUND * scale:
            reason = f"the fit stops at its bound of {f.value:.5g} {f.unit}"
            doubts.append(Obstacle(f.key, reason, "check the model and the log"))
        elif f.ci95[1] - f.ci95[0] > 2 * scale:
            reason = "its interval is as wide as the parameter itself"
            doubts.append(Obstacle(f.key, reason, "add longer runs, or runs with more excitation"))
    return tuple(doubts)


def _missed(forward: Forward, predicted: Sequence[FloatArray]) -> list[FloatArray]:
    """Measured minus predicted 30 s means of each run, (b, s); NaN where nothing was measured."""
    return [run.ticks.measured_degC - p for run, p in zip(forward.runs, predicted, strict=True)]


def _errors(problem: Problem, after: Config, rows: BoolArray) -> tuple[ErrorRms, dict[str, ErrorRms]]:
    """The errors on some rows (n,) before and after a fit: over all thermocouples, and by sensor."""
    before_K, after_K = (problem.error_K(c)[rows] for c in (problem.config, after))
    sensor = problem.evidence.sensor[rows]
    sensors = problem.config.sensor
    per_sensor = {
        s.name: ErrorRms(_rms(before_K[sensor == i]), _rms(after_K[sensor == i]), s.unit)
        for i, s in enumerate(sensors)
        if (sensor == i).any()
    }
    thermal = np.array([s.kind == "temperature" for s in sensors])[sensor]
    return ErrorRms(_rms(before_K[thermal]), _rms(after_K[thermal])), per_sensor


def _rms(residual_K: FloatArray) -> float:
    return float(np.sqrt(np.nanmean(residual_K**2))) if residual_K.size else 0.0
