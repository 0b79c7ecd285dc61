"""One run of the machine, step by step, compiled."""

from __future__ import annotations

from typing import NamedTuple

import numba
import numpy as np

from tests.truth.machine import conduction, exchange, grid, motion, physics
from tests.truth.machine.compiling import cached
from tests.truth.machine.conduction import Factors, conduct, factorise
from tests.truth.machine.exchange import (
    FILM,
    FRICTION,
    STEADY_HEAT,
    cool_bore,
    cool_surface,
    friction_W,
    load_end,
    rotating_film_W_m2K,
)
from tests.truth.machine.grid import Grid, build_grid, reading_weights
from tests.truth.machine.motion import spread, travel
from tests.truth.machine.physics import LEFT, NUT, RIGHT, FloatArray, Physics, Schedule

RINGS = 4


class Result(NamedTuple):
    """What a run leaves; times 0, dt, …, K dt."""

    section_degC: FloatArray  # (K + 1, P) section means at the positions asked for
    nut_m: FloatArray  # (K + 1,)
    body_degC: FloatArray  # (K + 1, 3) bodies at the nut, left, right
    book_J: FloatArray  # (K, 7) energy of each step by kind, see exchange.py; losses are negative
    field_degC: FloatArray  # (slices, rings) at the end


def run_machine(physics: Physics, schedule: Schedule, position_m: FloatArray, rings: int = RINGS) -> Result:
    """Run the machine from a uniform start; slices as many as `physics` has."""
    grid = build_grid(physics, len(physics.film_W_m2K), rings)
    first, weights = reading_weights(grid, np.asarray(position_m, float))
    return Result(*_run(physics, schedule, grid, factorise(grid, schedule.step_s), first, weights))


@numba.njit
def _middle(
    field: FloatArray,
    before: FloatArray,
    grid: Grid,
    section: FloatArray,
    shell: FloatArray,
    core: FloatArray,
) -> None:
    """Temperatures in the middle of the coming step, extrapolated from the last two: second order.

    Fills section means, outer and innermost rings, (slices,) each, and keeps the present ones in `before`.
    """
    outer = grid.rings - 1
    for i in range(grid.slices):
        mean = 0.0
        for j in range(grid.rings):
            mean += grid.share[j] * field[i, j]
        section[i] = mean + 0.5 * (mean - before[i, 0])
        shell[i] = field[i, outer] + 0.5 * (field[i, outer] - before[i, 1])
        core[i] = field[i, 0] + 0.5 * (field[i, 0] - before[i, 2])
        before[i, 0], before[i, 1], before[i, 2] = mean, field[i, outer], field[i, 0]


@numba.njit
def _nut_heat(
    heat: FloatArray,
    under: FloatArray,
    climb: FloatArray,
    power_W: float,
    climb_factor: float,
    low_m: float,
    high_m: float,
    grid: Grid,
    physics: Physics,
) -> None:
    """Add the nut's heat on its way, and the part that dwells at both ends of the stroke, W per slice."""
    moving_W = power_W * (1.0 - physics.dwell)
    for i in range(grid.slices):
        heat[i] += moving_W * (under[i] + (climb_factor - 1.0) * climb[i])
    if physics.dwell != 0.0:
        for end_m in (low_m, high_m):
            spread(heat, 0.5 * power_W * physics.dwell, end_m, end_m, physics.nut_length_m, grid.slice_m)


@cached(physics, grid, motion, exchange, conduction)
def _run(
    physics: Physics,
    schedule: Schedule,
    grid: Grid,
    factors: Factors,
    first: np.ndarray,
    weights: FloatArray,
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray, FloatArray]:
    steps, dt = len(schedule.speed_rpm), schedule.step_s
    field = np.full((grid.slices, grid.rings), schedule.start_degC)
    change, load_J = np.zeros_like(field), np.zeros_like(field)
    before = np.full((grid.slices, 3), schedule.start_degC)
    section, shell, core = np.empty(grid.slices), np.empty(grid.slices), np.empty(grid.slices)
    heat, under, climb = np.empty(grid.slices), np.empty(grid.slices), np.empty(grid.slices)
    read = np.full((steps + 1, len(first)), schedule.start_degC)
    nut_m, book = np.full(steps + 1, schedule.start_m), np.zeros((steps, 7))
    body, last_body = np.full((steps + 1, 3), schedule.start_degC), np.full(3, schedule.start_degC)
    middle_body, into_body_W = np.empty(3), np.zeros(3)
    face, cover = np.full(2, schedule.start_degC), np.full(2, schedule.start_degC)  # now, and a step before
    position_m, upward, turning_s = schedule.start_m, True, 0.0
    for k in range(steps):
        speed, air = schedule.speed_rpm[k], schedule.air_degC[k]
        low_m, high_m = schedule.low_m[k], schedule.high_m[k]
        _middle(field, before, grid, section, shell, core)
        middle_body[:] = body[k] + 0.5 * (body[k] - last_body)
        under[:], climb[:], heat[:], load_J[:] = 0.0, 0.0, 0.0, 0.0
        distance_m = abs(speed) / 60.0 * physics.lead_m * dt
        position_m, upward = travel(
            position_m, upward, distance_m, low_m, high_m, physics.nut_length_m, grid.slice_m, under, climb
        )
        turning_mid_s = turning_s + 0.5 * dt
        local = np.dot(under, section)
        power_W = schedule.nut_factor[k] * friction_W(physics, NUT, speed, turning_mid_s, local)
        _nut_heat(heat, under, climb, power_W, schedule.climb_factor[k], low_m, high_m, grid, physics)
        rubbed_W = heat.sum()
        book[k, FRICTION] += dt * rubbed_W
        for i in range(grid.slices):
            local_W = physics.local_W[i] + schedule.spot_W[k] * physics.spot[i]
            heat[i] += local_W
            book[k, STEADY_HEAT] += dt * local_W
        rotating = physics.rotation_gain * rotating_film_W_m2K(speed, physics.diameter_m)
        felt = air if physics.cover_W_K == 0.0 else cover[0] + 0.5 * (cover[0] - cover[1])
        into_body_W[NUT] = cool_surface(
            load_J, shell, heat, under, felt, schedule.film_factor[k], rotating, middle_body[NUT], dt, grid,
            physics, book[k],
        )  # fmt: skip
        if physics.coolant_W_K > 0.0 and speed != 0.0:
            cool_bore(load_J, core, physics.inlet_degC + schedule.inlet_K[k], dt, grid, physics, book[k])
        for side in range(2):
            rub_W = friction_W(physics, LEFT + side, speed, turning_mid_s, face[side])
            steady_W = physics.motor_W[side] + physics.end_heat_W_rpm[side] * abs(speed)
            face[side], into_body_W[LEFT + side] = load_end(
                load_J, side, section, rub_W, steady_W, air, middle_body[LEFT + side], dt, grid, physics,
                book[k],
            )  # fmt: skip
        conduct(field, load_J, change, factors)
        to_air_W = physics.nut_body_air_W_K * (middle_body[NUT] - air)
        into_body_W[NUT] += physics.nut_body_share * rubbed_W - to_air_W
        into_cover_W = physics.cover_share * rubbed_W - book[k, FILM] / dt - physics.cover_W_K * (felt - air)
        cover[1] = cover[0]
        cover[0] += dt * into_cover_W / physics.cover_J_K
        last_body[:] = body[k]
        for b in range(RIGHT + 1):
            body[k + 1, b] = body[k, b] + dt * into_body_W[b] / physics.body_J_K[b]
        if speed != 0.0:
            turning_s += dt
        nut_m[k + 1] = position_m
        for p in range(len(first)):
            value = 0.0
            for w in range(4):
                for j in range(grid.rings):
                    value += weights[p, w] * grid.share[j] * field[first[p] + w, j]
            read[k + 1, p] = value
    return read, nut_m, body, book, field
