"""Rough machines of the independent truth on duty cycles that go on, and what was forecast of them."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from observer.align.aligner import frames_of_log
from observer.estimate.pipeline import MachineModel
from observer.forecast.ahead import ahead, runner
from observer.forecast.program import Bins, binned, joined, learnt
from observer.forecast.settling import settling_of_all
from observer.frames import EstimateBlock, FloatArray
from tests.learning.cover import log_of
from tests.learning.machines import CONFIG, Day, EXPANSION_um_K_m, Rough, config_of, draw, work
from tests.truth.machine.cycles import Phase, STEP_s, build_schedule, draw_air, steps_of
from tests.truth.machine.machine import stream
from tests.truth.machine.run import run_machine

KINDS = ("even", "cycle", "mixed", "stands")
MOMENTS_S = {"cold": 2400.0, "warm": 7200.0}
LENGTH_S = 11_400.0
AT_S = (600.0, 1800.0, 3600.0)
START_M = 0.2
SETTLED_S = 12.0 * 3600.0
WITHIN_UM = 2.0
COARSE_M = np.linspace(0.0, 1.0, 41)
TRAVEL = np.ones(21, np.bool_)


class Forecast(NamedTuple):
    """One forecast: from row `now` of the day, where it was at that moment `field_degC`, `error_um` (g,)."""

    now: int
    said: EstimateBlock
    after_s: float | None
    between_s: tuple[float, float] | None
    kind: str
    field_degC: FloatArray
    error_um: FloatArray


class Nominal(NamedTuple):
    """What a program would be without variation, the rests of cycles included."""

    stroke_m: tuple[float, float]
    speed_rpm: float
    run_s: float
    rest_s: float


MIXED_DUTY = 0.825 * 230.0 / (230.0 + 77.5)
"""The mean speed of mixed work, with its rests, in parts of the nominal one."""


def nominal(rng: np.random.Generator) -> Nominal:
    """Draw a program."""
    stroke = (0.2, 0.8) if rng.random() < 0.5 else (0.25, 0.7)
    speed, run_s, rest_s = rng.uniform(900.0, 2400.0), rng.uniform(200.0, 600.0), rng.uniform(60.0, 300.0)
    return Nominal(stroke, speed, run_s, rest_s)


def phases(kind: str, rng: np.random.Generator) -> tuple[Phase, ...]:
    """Ten minutes of rest, then work that goes on as it does, with the variation that work has."""
    at, found = 600.0, [Phase(600.0)]
    stroke, speed, run_s, rest_s = nominal(rng)
    while at < LENGTH_S:
        if kind == "even":
            parts = [Phase(LENGTH_S - at, speed, *stroke)]
        elif kind == "stands":
            parts = [Phase(1500.0, speed, *stroke), Phase(4300.0 if at < 700.0 else LENGTH_S)]
            parts[0] = parts[0] if at < 700.0 else Phase(700.0, speed, *stroke)
        elif kind == "cycle":
            vary = 1.0 + 0.03 * rng.standard_normal(3)
            parts = [Phase(run_s * vary[0], speed * vary[1], *stroke), Phase(rest_s * vary[2])]
        else:
            of = rng.choice([0.4, 0.7, 1.0, 1.2])
            parts = [Phase(rng.uniform(60.0, 400.0), speed * of, *stroke), Phase(rng.uniform(5.0, 150.0))]
        found += parts
        at += sum(p.duration_s for p in parts)
    return tuple(_whole(p) for p in found)


def _whole(p: Phase) -> Phase:
    return Phase(round(2 * p.duration_s) / 2, float(round(p.speed_rpm)), p.low_m, p.high_m)


def drawn_day(seed: int, number: int) -> Day:
    """The day of a machine; its kind of work goes by its number."""
    rng = stream(seed, "forecast", str(number))
    machine = draw(seed, number, Rough())
    return work(machine, phases(KINDS[number % len(KINDS)], rng), START_M, rng, 0.0)


def settles_s(seed: int, number: int, now_s: float) -> float:
    """When a machine's travel is truly within `WITHIN_UM` of where it settles, after a moment of its day.

    From then on the air stays as it is, and the work is the program without its variation: of cycles the
    nominal one, judged by the mean over whole cycles; of mixed work its mean speed. Where it
    settles is where it is after `SETTLED_S`.
    """
    kind = KINDS[number % len(KINDS)]
    program = nominal(stream(seed, "forecast", str(number)))
    rng = stream(seed, "forecast", str(number))
    machine, before = draw(seed, number, Rough()), phases(kind, rng)
    air = draw_air(float(rng.uniform(18.0, 25.0)), steps_of(before), rng)
    at = round(now_s / STEP_s)
    after, period = _after(kind, program)
    schedule = build_schedule((*_until(before, now_s), *after), START_M, _held(air, at, steps_of(after)))
    result = run_machine(machine.machine.physics, schedule, COARSE_M)
    rise_K = result.section_degC[at - period + 1 :] - air[at]
    of_pieces = 0.5 * (rise_K[:, 1:] + rise_K[:, :-1]) * np.diff(COARSE_M)
    error_um = EXPANSION_um_K_m * np.cumsum(of_pieces, axis=1)[:, 1::2]
    total = np.cumsum(error_um, axis=0)
    mean_um = np.vstack([total[period - 1 : period], total[period:] - total[:-period]]) / period
    off = np.flatnonzero((np.abs(mean_um - mean_um[-1]) > WITHIN_UM).any(axis=1))
    last = 0.0 if not len(off) else (off[-1] + 1) * STEP_s
    # of a mean over a cycle the moment is its middle
    return float(max(last - 0.5 * (period - 1) * STEP_s, 0.0))


def _after(kind: str, program: Nominal) -> tuple[tuple[Phase, ...], int]:
    """What comes then, and its period in steps."""
    stroke, speed, run_s, rest_s = program
    if kind == "cycle":
        cycle = _whole(Phase(run_s, speed, *stroke)), _whole(Phase(rest_s))
        return cycle * round(SETTLED_S / (run_s + rest_s)), steps_of(cycle)
    if kind == "stands":
        return (Phase(SETTLED_S),), 1
    duty = MIXED_DUTY if kind == "mixed" else 1.0
    return (_whole(Phase(SETTLED_S, speed * duty, *stroke)),), 1


def _until(before: tuple[Phase, ...], now_s: float) -> list[Phase]:
    found, at = [], 0.0
    for p in before:
        if at < now_s:
            found.append(replace(p, duration_s=min(p.duration_s, now_s - at)))
        at += p.duration_s
    return found


def _held(air_degC: FloatArray, at: int, steps: int) -> FloatArray:
    return np.concatenate([air_degC[: at + 1], np.full(steps, air_degC[at])])


def forecasts(one: Day, *, settles: bool = False) -> dict[str, Forecast]:
    """What is forecast at each moment, each by what was known then; on demand also when it `settles`."""
    config = config_of(CONFIG)
    machine = MachineModel.of(config, learns=True)
    pipeline = machine.pipeline(machine.estimator())
    moving = [m.index for m in machine.plant.moving]
    parts: list[Bins] = []
    found, now = {}, 0
    waiting = dict(MOMENTS_S)
    for frames in frames_of_log(log_of(one), machine.plan, 300):
        block = pipeline.step(frames)
        parts.append(binned(pipeline.inputs, block, moving))
        now += len(frames)
        for name, at_s in list(waiting.items()):
            if block.time_s[-1] - one.time_s[0] >= at_s:
                del waiting[name]
                program = learnt(joined(parts))
                begin = runner(machine.plant, config.estimator, pipeline.snapshot()[1], program)
                row = int(np.searchsorted(one.time_s, block.time_s[-1]))
                where = settling_of_all([(1.0, begin)], program, TRAVEL, WITHIN_UM) if settles else None
                of = (None, None) if where is None else (where.after_s, where.between_s)
                hour = ahead(begin, program, 3600.0)
                last = block.field_degC[-1], block.error_um[-1]
                found[name] = Forecast(row, hour, *of, program.text, *last)
    return found
