"""The machines of the campaign at work: their logs without a fault, each made once."""

from __future__ import annotations

from functools import lru_cache

from tests.learning.housings import draw_housed
from tests.learning.machines import Day, Rough, draw, work
from tests.truth.machine.cycles import Phase, START_m, programme
from tests.truth.machine.machine import stream

FIRST_SEED = 48_700
FAULT_S = 4000.0
RUN_OF = ("a", "b", "a", "c")
"""Which programme a machine does, in turn: at the fault "a" stands for another 500 s, "b" and "c" move."""
MORE = {"a": (), "b": (Phase(900, 1400, 0.3, 0.6),), "c": (Phase(1800, 1200, 0.3, 0.7),)}
"""So that each works for about two hours and a half, the last 5000 s of which are watched."""
SHIFT_m = 0.05
LINKS = 0.2
"""What part each link of a housed machine is off."""


@lru_cache(maxsize=4)
def day_of(number: int, *, new_stroke: bool = False, housed: bool = False, seed: int = FIRST_SEED) -> Day:
    """A machine's day. With `new_stroke` another program begins at `FAULT_S`: shorter strokes elsewhere.

    `housed` is another machine, whose thermocouples sit on nut and housings.
    """
    run = RUN_OF[number % len(RUN_OF)]
    rng = stream(seed, "integrity", str(number))
    phases = (*programme("standard", run, rng), *MORE[run])
    if new_stroke:
        phases = with_new_stroke(phases)
    machine = draw_housed(seed, number, LINKS) if housed else draw(seed, number, Rough())
    return work(machine, phases, START_m[run], rng, 0.0)


def with_new_stroke(phases: tuple[Phase, ...], from_s: float = FAULT_S) -> tuple[Phase, ...]:
    """The same phases, each stroke from some time on shorter by `SHIFT_m` below and by twice that above."""
    found, begin_s = [], 0.0
    for phase in phases:
        before_s = min(max(from_s - begin_s, 0.0), phase.duration_s)
        if before_s > 0.0:
            found.append(Phase(before_s, phase.speed_rpm, phase.low_m, phase.high_m))
        if phase.duration_s > before_s:
            low_m, high_m = phase.low_m + SHIFT_m, phase.high_m - 2.0 * SHIFT_m
            found.append(Phase(phase.duration_s - before_s, phase.speed_rpm, low_m, high_m))
        begin_s += phase.duration_s
    return tuple(found)
