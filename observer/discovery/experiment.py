"""The test that would separate two answers: cycles that a machine can run, ranked by their separation."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from observer.config.machine import Config
from observer.discovery.localise import courses_of
from observer.discovery.workers import IN_PROCESS, WorkerPool
from observer.fit.linear import unabsorbed
from observer.fit.problem import Problem, modelled_lags
from observer.fit.runs import prepare
from observer.frames import FloatArray, FrameBlock, NutPath
from observer.model.cycle import LEAD_M

STEP_S = 1.0
SEPARATES = 5.0
"""Least separation, in standard deviations, for a test to be worth its time."""
HOPELESS = 1.0
"""A separation below this decides nothing."""


class Phase(NamedTuple):
    """A phase of a test cycle.

    Attributes:
        duration_s: Duration, s.
        speed_rpm: Speed of the screw, rpm; 0 is rest.
        low_m: Lower end of the stroke, m.
        high_m: Upper end, m.
    """

    duration_s: float
    speed_rpm: float
    low_m: float
    high_m: float


class Habits(NamedTuple):
    """The usual operation of a machine.

    Attributes:
        usual_rpm: Median speed while it works, rpm.
        fastest_rpm: Highest speed, rpm.
        low_m: Lower end of the stroke, m.
        high_m: Upper end, m.
        lead_m: Lead of the nut, m per revolution.
        ambient_degC: Median temperature of the air, °C.
        power_W: Each channel of a power with its usual value while the machine works, W.
    """

    usual_rpm: float
    fastest_rpm: float
    low_m: float
    high_m: float
    lead_m: float
    ambient_degC: float
    power_W: tuple[tuple[str, float], ...] = ()


@dataclass(frozen=True, slots=True)
class Experiment:
    """A test cycle that separates answers.

    Attributes:
        name: Name of the cycle.
        description: Its phases in words.
        duration_s: Duration, s.
        separation_sigma: Distance of the two closest answers, in σ.
        phases: Its phases.
        cycle: Operation of the machine as frames of the configuration's channels.
        others: Names of the other cycles with their separation, the best first.
    """

    name: str
    description: str
    duration_s: float
    separation_sigma: float
    phases: tuple[Phase, ...]
    cycle: FrameBlock
    others: tuple[tuple[str, float], ...] = ()


def propose(problem: Problem, answers: Sequence[Config], pool: WorkerPool = IN_PROCESS) -> Experiment:
    """Return the cycle of the menu that best separates the two closest answers.

    Cycles that separate by `SEPARATES` are preferred; among them, the one with the most separation per time.

    Args:
        problem: Data and free parameters, which also show how the machine is run.
        answers: Configurations of at least two answers.
        pool: Where predictions run.
    """
    habits = habits_of(problem)
    cycles = list(menu(habits))
    sigmas = pool.map(separation, problem, [(answers, phases, habits) for _, _, phases in cycles])
    rated = [
        (name, text, phases, sum(p.duration_s for p in phases), sigma)
        for (name, text, phases), sigma in zip(cycles, sigmas, strict=True)
    ]
    enough = [e for e in rated if e[4] >= SEPARATES]
    best = min(enough, key=lambda e: e[3] / e[4]) if enough else max(rated, key=lambda e: e[4])
    others = sorted(((e[0], e[4]) for e in rated if e is not best), key=lambda other: -other[1])
    name, text, phases, duration_s, sigma = best
    cycle = frames_of(problem.config, phases, habits)
    return Experiment(name, text, duration_s, sigma, phases, cycle, tuple(others))


def menu(habits: Habits) -> Iterator[tuple[str, str, tuple[Phase, ...]]]:
    """Yield name, description and phases of six cycles that any machine can run, of 80 min to 4 h.

    Args:
        habits: Speeds and stroke of the machine.
    """
    low, high = habits.low_m, habits.high_m
    n, fast = habits.usual_rpm, habits.fastest_rpm
    slow = 0.4 * n
    third = (high - low) / 3

    def work(minutes: float, rpm: float, a: float = low, b: float = high) -> Phase:
        return Phase(60 * minutes, rpm, a, b)

    def rest(minutes: float) -> Phase:
        return Phase(60 * minutes, 0.0, low, high)

    yield (
        "another_speed",
        f"{fast:.0f} rpm for 40 min, rest for 20 min, {slow:.0f} rpm for 60 min, rest for 20 min",
        (rest(5), work(40, fast), rest(20), work(60, slow), rest(20)),
    )
    yield "standstill", "stand still with the drive on for 90 min, from cold", (rest(90),)
    yield (
        "moved_stroke",
        f"{n:.0f} rpm for 40 min over the left third of the stroke, rest for 40 min, then the right third",
        (rest(5), work(40, n, low, low + third), rest(40), work(40, n, high - third, high), rest(20)),
    )
    yield (
        "hot_restart",
        f"{n:.0f} rpm for 40 min, rest for 10 min, {n:.0f} rpm for 20 min, rest for 60 min",
        (rest(5), work(40, n), rest(10), work(20, n), rest(60)),
    )
    yield (
        "soak",
        f"{fast:.0f} rpm for 20 min, then stand still with the drive on for three hours",
        (work(20, fast), rest(180)),
    )
    yield (
        "rest_and_speeds",
        f"stand still with the drive on for 60 min, from cold, {fast:.0f} rpm for 40 min, rest for 40 min, "
        f"{slow:.0f} rpm for 60 min, rest for 40 min",
        (rest(60), work(40, fast), rest(40), work(60, slow), rest(40)),
    )


def habits_of(problem: Problem) -> Habits:
    """Return how the machine is usually run, from the logs.

    Without a turning screw both speeds are 1000 rpm. Without a nut the stroke is the whole screw.
    """
    config, courses = problem.config, courses_of(problem)
    speed = np.concatenate([c.speed_rpm[c.working] for c in courses])
    speed = speed[speed > 0]
    usual, fastest = (float(np.median(speed)), float(speed.max())) if len(speed) else (1000.0, 1000.0)
    nut = next((s for s in config.source if s.position_channel is not None), None)
    low, high, lead = 0.0, config.screw.length_m, LEAD_M
    if nut is not None:
        frames = [run.run.frames for run in problem.forward.runs]
        x = np.concatenate([f.values[:, f.channels.index(str(nut.position_channel))] for f in frames])
        low, high = (float(v) for v in np.nanquantile(x, [0.001, 0.999]))
        lead = nut.lead_m or _lead_m(frames[0], str(nut.position_channel), nut.speed_channel)
    ambient = float(np.median(np.concatenate([c.ambient_degC for c in courses])))
    return Habits(usual, fastest, low, high, lead, ambient, tuple(_powers_W(problem)))


def _powers_W(problem: Problem) -> Iterator[tuple[str, float]]:
    """Yield each channel of a power with its median while it is above 0, in W."""
    for channel in dict.fromkeys(s.power_channel for s in problem.config.source if s.power_channel):
        parts = [
            run.run.frames.values[:, run.run.frames.channels.index(channel)] for run in problem.forward.runs
        ]
        power_W = np.concatenate(parts)
        power_W = power_W[power_W > 0.0]
        yield channel, float(np.median(power_W)) if len(power_W) else 0.0


def _lead_m(frames: FrameBlock, position: str, speed: str | None) -> float:
    """Return the nut's lead in m per revolution, from the largest distances between samples."""
    if speed is None:
        return LEAD_M
    rpm = np.abs(frames.values[1:, frames.channels.index(speed)])
    moved_m = np.abs(np.diff(frames.values[:, frames.channels.index(position)]))
    turns = rpm / 60.0 * frames.dt_s[1:]
    valid = np.isfinite(moved_m) & (turns > 0)
    if not valid.any():
        return LEAD_M
    return float(np.quantile(moved_m[valid] / turns[valid], 0.9)) or LEAD_M


def separation(problem: Problem, answers: Sequence[Config], phases: Sequence[Phase], habits: Habits) -> float:
    """Return the distance of the two closest answers over a cycle, in σ.

    Differences that the free parameters could absorb are projected out, and the tolerances are marginalised.

    Args:
        problem: The free parameters.
        answers: Configurations of at least two answers; derivatives are taken at the first.
        phases: The cycle.
        habits: Usual operation, for lead, air and powers.
    """
    config = problem.config
    run = prepare(config, [frames_of(config, phases, habits)], "cycle")
    test = Problem.of(config, problem.keys, [run, run]).with_nuisance(answers[0])
    rows = test.evidence.proof
    marginal = test.marginal(rows, modelled_lags(answers[0]))
    slopes = marginal(test.derivatives(answers[0]).columns[rows])
    predictions = [marginal(test.evidence.whitened(test.predicted(a))[rows]) for a in answers]
    apart = np.column_stack([b - a for i, a in enumerate(predictions) for b in predictions[i + 1 :]])
    return float(np.min(np.linalg.norm(unabsorbed(slopes, apart), axis=0)))


def frames_of(config: Config, phases: Sequence[Phase], habits: Habits) -> FrameBlock:
    """Return the frames of a cycle, one per second, from a start at ambient temperature.

    All sensors read the ambient throughout, because predictions do not depend on readings after the start.

    Args:
        config: The machine, for its channels.
        phases: The cycle.
        habits: Usual operation, for lead, air and powers.
    """
    count = [round(p.duration_s / STEP_S) for p in phases]
    count[-1] += 1
    speed, low, high = (
        np.repeat([float(getattr(p, key)) for p in phases], count) for key in ("speed_rpm", "low_m", "high_m")
    )
    K = len(speed)
    position = _shuttle(speed * habits.lead_m / 60.0 * STEP_S, low, high)
    by_channel = {s.speed_channel: speed for s in config.source if s.speed_channel}
    by_channel |= {s.drive_channel: np.ones(K) for s in config.source if s.drive_channel}
    by_channel |= {s.position_channel: position for s in config.source if s.position_channel}
    by_channel |= {channel: np.where(speed > 0, power_W, 0.0) for channel, power_W in habits.power_W}
    values = np.full((K, len(config.channels)), habits.ambient_degC)
    for i, channel in enumerate(config.channels):
        if channel in by_channel:
            values[:, i] = by_channel[channel]
        elif channel.endswith("_W"):
            values[:, i] = np.where(speed > 0, 30.0, 0.0)
    time_s: FloatArray = np.arange(float(K)) * STEP_S
    offset = np.arange(K + 1, dtype=np.int64)
    moving = {s.position_channel for s in config.source if s.position_channel}
    return FrameBlock(
        channels=config.channels,
        time_s=time_s,
        dt_s=np.diff(time_s, prepend=0.0),
        values=values,
        fresh=np.ones(values.shape, dtype=bool),
        quality=np.zeros(values.shape, dtype=np.int8),
        age_s=np.zeros(values.shape),
        path=dict.fromkeys(
            moving, NutPath(time_s, position, offset, speed * habits.lead_m / 60.0, np.zeros(K))
        ),
    )


def _shuttle(travel_m: FloatArray, low_m: FloatArray, high_m: FloatArray) -> FloatArray:
    """Return the position (K,) of a nut that runs to and fro, reversing at the ends of the current stroke."""
    positions_m = np.empty(len(travel_m))
    position, sense = float(low_m[0]), 1.0
    for k, step in enumerate(travel_m):
        position += sense * step
        if position > high_m[k]:
            position, sense = max(2 * high_m[k] - position, low_m[k]), -1.0
        elif position < low_m[k]:
            position, sense = min(2 * low_m[k] - position, high_m[k]), 1.0
        positions_m[k] = position
    return positions_m
