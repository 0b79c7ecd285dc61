"""Days of a machine's work in seconds of computing: finite volumes, implicit in time, a nut that shuttles.

One row each half second. Work comes in shifts: cycles of other speeds with rests between them, longer breaks,
and nights. Nothing here knows the model that is tested against it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tests.truth.machine.compiling import cached

FloatArray = NDArray[np.float64]
STEP_S = 0.5
CELLS = 125
PASSES = 10
DAY_S = 86400.0


@dataclass(frozen=True, slots=True)
class Axis:
    """The machine: a screw of steel in still air, and the heats of nut and bearings a turn."""

    length_m: float = 1.0
    diameter_m: float = 0.036
    conductivity_W_mK: float = 50.0
    capacity_J_m3K: float = 7800.0 * 460.0
    film_W_m2K: float = 15.0
    ambient_degC: float = 22.0
    lead_m: float = 0.010
    stroke_m: tuple[float, float] = (0.15, 0.80)
    nut_m: float = 0.08
    nut_W_rpm: float = 0.30 * 0.5 * math.pi / 30.0
    bearing_W_rpm: tuple[float, float] = (0.006, 0.006)
    sensor_m: tuple[float, ...] = (0.05, 0.28, 0.50, 0.72, 0.95)
    noise_K: float = 0.05
    resolution_K: float = 0.1


@dataclass(frozen=True, slots=True)
class Days:
    """What was recorded and what was true, row by row: `seen_degC` (K, s), `heat_W` (K, 3)."""

    time_s: FloatArray
    speed_rpm: FloatArray
    position_m: FloatArray
    seen_degC: FloatArray
    heat_W: FloatArray


def work(days: float, rng: np.random.Generator) -> FloatArray:
    """The speed in each step: two shifts a day of cycles and breaks, and the night."""
    steps = round(days * DAY_S / STEP_S)
    speed = np.zeros(steps)
    at = 0
    while at < steps:
        hour = at * STEP_S % DAY_S / 3600.0
        if hour < 16.0:
            run = round(rng.uniform(60.0, 900.0) / STEP_S)
            speed[at : at + run] = rng.choice([500.0, 800.0, 1200.0, 1500.0, 2000.0, 2500.0])
            at += run + round(rng.choice([5.0, 40.0, 120.0, 1800.0], p=[0.4, 0.4, 0.15, 0.05]) / STEP_S)
        else:
            at += round((24.0 - hour) * 3600.0 / STEP_S)
    return speed


def record(
    axis: Axis, speed_rpm: FloatArray, rng: np.random.Generator, *, begin_degC: float | None = None
) -> Days:
    """Run the machine through its work and read its thermocouples each step."""
    steps = len(speed_rpm)
    low_m = axis.stroke_m[0] + axis.nut_m / 2
    reach_m = axis.stroke_m[1] - axis.stroke_m[0] - axis.nut_m
    run_m = np.cumsum(axis.lead_m * speed_rpm / 60.0 * STEP_S)
    # Friction drifts by a few per cent over hours, as it does with the grease.
    hours = np.arange(steps) * STEP_S / 3600.0
    drift = 1.0 + 0.04 * np.sin(2.0 * math.pi * (hours / 5.0 + rng.uniform()))
    heat_W = np.column_stack(
        [axis.nut_W_rpm * speed_rpm * drift, *(rate * speed_rpm for rate in axis.bearing_W_rpm)]
    )
    true_degC = np.empty((steps, len(axis.sensor_m)))
    start_degC = axis.ambient_degC if begin_degC is None else begin_degC
    _conduct(
        np.full(CELLS, start_degC), np.concatenate([[0.0], run_m]), heat_W, low_m, reach_m, axis.nut_m,
        axis.length_m, axis.diameter_m, axis.conductivity_W_mK, axis.capacity_J_m3K, axis.film_W_m2K,
        axis.ambient_degC,
        np.array(axis.sensor_m), true_degC,
    )  # fmt: skip
    noisy = true_degC + axis.noise_K * rng.standard_normal(true_degC.shape)
    seen = np.round(noisy / axis.resolution_K) * axis.resolution_K
    phase_m = np.mod(run_m, 2.0 * reach_m)
    position_m = low_m + np.minimum(phase_m, 2.0 * reach_m - phase_m)
    return Days(STEP_S * np.arange(1.0, steps + 1.0), speed_rpm, position_m, seen, heat_W)


@cached()
def _conduct(  # type: ignore[no-untyped-def]
    temperature, run_m, heat_W, low_m, reach_m, nut_m, length_m, diameter_m, k, capacity, film, ambient,
    sensor_m, out,
):  # fmt: skip
    """Backward Euler on a row of cells; the nut's heat is shared along its way in each step."""
    n = len(temperature)
    dx = length_m / n
    area = math.pi * diameter_m**2 / 4.0
    C, G, H = capacity * area * dx / STEP_S, k * area / dx, film * math.pi * diameter_m * dx
    upper, right = np.empty(n), np.empty(n)
    pivot = np.empty(n)
    for i in range(n):
        beside = 1.0 if i in (0, n - 1) else 2.0
        pivot[i] = C + H + beside * G - (G * upper[i - 1] if i > 0 else 0.0)
        upper[i] = G / pivot[i]
    for step in range(len(heat_W)):
        for i in range(n):
            right[i] = C * temperature[i] + H * ambient
        right[0] += heat_W[step, 1]
        right[n - 1] += heat_W[step, 2]
        if heat_W[step, 0] != 0.0:
            for part in range(PASSES):
                way = run_m[step] + (run_m[step + 1] - run_m[step]) * (part + 0.5) / PASSES
                phase = way % (2.0 * reach_m)
                centre = low_m + min(phase, 2.0 * reach_m - phase)
                first = max(0, int((centre - nut_m / 2) / dx))
                last = min(n - 1, int((centre + nut_m / 2) / dx))
                for i in range(first, last + 1):
                    covered = min((i + 1) * dx, centre + nut_m / 2) - max(i * dx, centre - nut_m / 2)
                    right[i] += heat_W[step, 0] / PASSES * max(covered, 0.0) / nut_m
        for i in range(n):
            right[i] = (right[i] + (G * right[i - 1] if i > 0 else 0.0)) / pivot[i]
        temperature[n - 1] = right[n - 1]
        for i in range(n - 2, -1, -1):
            temperature[i] = right[i] + upper[i] * temperature[i + 1]
        for s in range(len(sensor_m)):
            place = sensor_m[s] / dx - 0.5
            low = min(max(int(place), 0), n - 2)
            share = place - low
            out[step, s] = (1.0 - share) * temperature[low] + share * temperature[low + 1]
