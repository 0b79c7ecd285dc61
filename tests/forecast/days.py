"""Rough machines of the independent truth on duty cycles that go on, and what was forecast of them."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from observer.forecast.ahead import Ahead, ahead, runner
from observer.forecast.program import Bins, binned, joined, learnt
from observer.forecast.settling import settling
from observer.frames import FloatArray
from observer.service.align import frames_of_log
from observer.service.machine import Machine
from tests.learning.cover import log_of
from tests.learning.machines import CONFIG, Day, Rough, config_of, draw, work
from tests.truth.machine.cycles import Phase
from tests.truth.machine.machine import stream

KINDS = ("even", "cycle", "mixed", "stands")
MOMENTS_S = {"cold": 2400.0, "warm": 7200.0}
LENGTH_S = 11_400.0
AT_S = (600.0, 1800.0, 3600.0)


class Forecast(NamedTuple):
    """One forecast: from row `now` of the day, where it was at that moment `field_degC`, `error_um` (g,)."""

    now: int
    said: Ahead
    after_s: float | None
    kind: str
    field_degC: FloatArray
    error_um: FloatArray


def phases(kind: str, rng: np.random.Generator) -> tuple[Phase, ...]:
    """Ten minutes of rest, then work that goes on as it does, with the variation that work has."""
    at, found = 600.0, [Phase(600.0)]
    stroke = (0.2, 0.8) if rng.random() < 0.5 else (0.25, 0.7)
    speed, run_s, rest_s = rng.uniform(900.0, 2400.0), rng.uniform(200.0, 600.0), rng.uniform(60.0, 300.0)
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
    return tuple(
        Phase(round(2 * p.duration_s) / 2, float(round(p.speed_rpm)), p.low_m, p.high_m) for p in found
    )


def drawn_day(seed: int, number: int) -> Day:
    """The day of a machine; its kind of work goes by its number."""
    rng = stream(seed, "forecast", str(number))
    machine = draw(seed, number, Rough())
    return work(machine, phases(KINDS[number % len(KINDS)], rng), 0.2, rng, 0.0)


def forecasts(one: Day) -> dict[str, Forecast]:
    """What is forecast at each moment, each by what was known then."""
    config = config_of(CONFIG)
    machine = Machine.of(config, learns=True)
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
                settled = settling(begin, program, np.ones(21, np.bool_), 2.0)
                row = int(np.searchsorted(one.time_s, block.time_s[-1]))
                found[name] = Forecast(
                    row, ahead(begin, program, 3600.0), settled.after_s,
                    program.text, block.field_degC[-1], block.error_um[-1],
                )  # fmt: skip
    return found
