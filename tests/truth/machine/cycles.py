"""Speed programmes: what the machine does in each run, and the air around it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tests.truth.machine.physics import FloatArray, Schedule, steady_schedule

STEP_s = 0.5
RUNS = ("a", "b", "c")


@dataclass(frozen=True)
class Phase:
    """A stretch of a run: how long, how fast, over which stroke; speed 0: the nut rests where it is."""

    duration_s: float
    speed_rpm: float = 0.0
    low_m: float = 0.2
    high_m: float = 0.8


STANDARD = {
    "a": (
        Phase(600), Phase(2700, 1490, 0.2, 0.8), Phase(1200), Phase(1800, 2470, 0.25, 0.75),
        Phase(1500, 710, 0.4, 0.7), Phase(1800),
    ),
    "b": (
        Phase(600), Phase(1800, 1980, 0.3, 0.7), Phase(900), Phase(2100, 1010, 0.152, 0.798),
        Phase(1500, 2590, 0.2, 0.6), Phase(1500),
    ),
    "c": (
        Phase(600), Phase(1800, 2390, 0.2, 0.8), Phase(900, 620, 0.2, 0.5),
        Phase(1800, 1810, 0.25, 0.75), Phase(2100),
    ),
}  # fmt: skip
"""Several speeds and strokes, dwell at standstill, cool-down."""

SINGLE_SPEED = {
    "a": (Phase(600), Phase(6000, 1500), Phase(3000)),
    "b": (Phase(600), Phase(4800, 1500), Phase(3000)),
    "c": (Phase(600), Phase(4200, 1500), Phase(2400)),
}
"""One speed over one stroke between two rests: shows little of what depends on speed."""

ALWAYS_ON = {
    "a": (Phase(9600, 1500),),
    "b": (Phase(8400, 1500),),
    "c": (Phase(7200, 1500),),
}
"""One speed from the first row to the last: what goes with speed and what is constant are the same."""

HOT = {
    "a": (Phase(600), Phase(5400, 4000), Phase(3600)),
    "b": (Phase(600), Phase(4200, 1200, 0.3, 0.7), Phase(3000)),
    "c": (Phase(600), Phase(4800, 3600, 0.25, 0.75), Phase(3600)),
}
"""A screw that gets 60 K warmer than the air, and one that hardly does."""

PROGRAMMES: dict[str, dict[str, tuple[Phase, ...]]] = {
    "standard": STANDARD,
    "single_speed": SINGLE_SPEED,
    "always_on": ALWAYS_ON,
    "hot": HOT,
}

START_m = {"a": 0.2, "b": 0.3, "c": 0.2}


def programme(cycle: str, run: str, rng: np.random.Generator) -> tuple[Phase, ...]:
    """The phases of a run. On the standard cycle speeds differ by up to 6 % from case to case."""
    phases = PROGRAMMES[cycle][run]
    if cycle != "standard":
        return phases
    factors = rng.uniform(0.94, 1.06, len(phases))
    return tuple(
        Phase(p.duration_s, float(round(p.speed_rpm * f)), p.low_m, p.high_m)
        for p, f in zip(phases, factors, strict=True)
    )


def build_schedule(phases: tuple[Phase, ...], start_m: float, air_degC: FloatArray) -> Schedule:
    """Steps of a run; `air_degC` (K + 1,) is what the log shows, linear in between."""
    count = [round(p.duration_s / STEP_s) for p in phases]
    speed, low, high = (
        np.repeat([float(getattr(p, name)) for p in phases], count)
        for name in ("speed_rpm", "low_m", "high_m")
    )
    return steady_schedule(
        len(speed),
        STEP_s,
        start_m=start_m,
        start_degC=float(air_degC[0]),
        speed_rpm=speed,
        low_m=low,
        high_m=high,
        air_degC=0.5 * (air_degC[:-1] + air_degC[1:]),
    )


def steps_of(phases: tuple[Phase, ...]) -> int:
    """Number of steps of a run."""
    return sum(round(p.duration_s / STEP_s) for p in phases)


def draw_air(mean_degC: float, steps: int, rng: np.random.Generator, most_K: float = 0.5) -> FloatArray:
    """Air that varies slowly by at most so much around a mean, (K + 1,)."""
    time_s = np.arange(steps + 1) * STEP_s
    period_s = rng.uniform(1.5, 5.0, 3) * 3600.0
    phase = rng.uniform(0.0, 2.0 * np.pi, 3)
    size = rng.dirichlet(np.ones(3))
    return mean_degC + most_K * size @ np.sin(2.0 * np.pi * time_s / period_s[:, None] + phase[:, None])
