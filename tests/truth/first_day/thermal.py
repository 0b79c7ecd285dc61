"""The heat of a machine in lumps: cells of the screw and bodies beside it, by small explicit steps."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from tests.truth.first_day.machine import (
    EXPANSION_1_K,
    BODY_J_kgK,
    FirstDayMachine,
    FloatArray,
    Friction,
)
from tests.truth.first_day.programme import Motion

BODIES = ("nut", "bracket", "left_housing", "right_housing", "motor", "head", "column", "air")
NUT, BRACKET, LEFT, RIGHT, MOTOR, HEAD, COLUMN, AIR = range(len(BODIES))
MOTOR_J_K, HEAD_J_K, COLUMN_J_K, AIR_J_K = BODY_J_kgK * 8.0, BODY_J_kgK * 150.0, BODY_J_kgK * 600.0, 4000.0
MOTOR_AIR_W_K, HEAD_AIR_W_K, COLUMN_AIR_W_K, AIR_ROOM_W_K = 2.0, 8.0, 20.0, 60.0
MOTOR_IDLE_W, MOTOR_LOSS = 15.0, 0.3
"""An enabled motor's heat at rest, and its losses relative to the friction that it drives."""
TYPICAL_THRUST_N = 600.0
STEP_s, LOOKS = 0.1, 5
"""Steps, and how often in each the nut is looked for: 16 mm apart at 40 m/min, less than a cell."""


class Work(NamedTuple):
    """The work of an axis in each of K steps, or in one of them."""

    cover: FloatArray  # (K, cells) part of the nut on each cell; their sum is 1
    speed_rpm: FloatArray  # (K,) mean
    thrust_N: FloatArray  # (K,) mean while it moves
    moving: FloatArray  # (K,) share of the time


class Heats(NamedTuple):
    """Friction heat of nut and bearings over the last step, in W."""

    nut_W: float
    left_W: float
    right_W: float


def averaged(machine: FirstDayMachine, motion: Motion) -> Work:
    """Return the work of steps from the motion at `LOOKS` times in each."""
    rpm = np.abs(motion.velocity_m_s) / machine.screw.lead_m * 60.0
    moving = (rpm > 0.0).astype(float)
    thrust_N = moving * (motion.thrust_N + machine.weight_N)

    def mean(values: FloatArray) -> FloatArray:
        return values.reshape(-1, LOOKS, *values.shape[1:]).mean(axis=1)

    return Work(
        cover=mean(covered(machine, motion.position_m)),
        speed_rpm=mean(rpm),
        thrust_N=mean(thrust_N) / np.maximum(mean(moving), 1e-9),
        moving=mean(moving),
    )


def covered(machine: FirstDayMachine, position_m: FloatArray) -> FloatArray:
    """Return which part of the nut is on each cell, (n, cells), for places (n,) of its middle."""
    edges_m = np.linspace(0.0, machine.nameplate.length_m, machine.cells + 1)
    from_m = position_m[:, None] - machine.screw.nut_m / 2.0
    along = np.clip((edges_m - from_m) / machine.screw.nut_m, 0.0, 1.0)
    return np.diff(along, axis=1)


class Thermal:
    """The temperatures of a machine: `screw_degC` (cells,) and `body_degC` by `BODIES`.

    `advance` is one step; `heats` are those of the last one. `entered_J` and `left_J` count all heat that
    came in and went to the room.
    """

    def __init__(self, machine: FirstDayMachine) -> None:
        """Begin after a night: all of it at one temperature, near that of the room."""
        self._machine = machine
        nameplate, screw = machine.nameplate, machine.screw
        self.time_s, self.running_s = 0.0, 0.0
        start_degC = machine.room.at_degC(0.0) + machine.start_K
        self.screw_degC = np.full(machine.cells, start_degC)
        self.body_degC = np.full(len(BODIES), start_degC)
        self.body_degC[AIR] = machine.room.at_degC(0.0)
        self.heats = Heats(0.0, 0.0, 0.0)
        self.entered_J, self.left_J = 0.0, 0.0
        cell_m, area_m2 = nameplate.length_m / machine.cells, math.pi * screw.root_m**2 / 4.0
        self._along_W_K = machine.conductivity_W_mK * area_m2 / cell_m
        self._cell_J_K = machine.capacity_J_m3K * area_m2 * cell_m
        self._skin_m2 = math.pi * screw.root_m * cell_m
        middle_m = (np.arange(machine.cells) + 0.5) * cell_m
        self._height_K = machine.air_rise_K_m * (middle_m - nameplate.length_m / 2.0)
        self._bearing_W_K = machine.bearing_W_K
        self._motor_end = 0 if nameplate.fixed == "left" else -1
        self._body_J_K = np.array(
            [
                machine.nut_J_K,
                machine.bracket_J_K,
                *machine.housing_J_K,
                MOTOR_J_K,
                HEAD_J_K,
                COLUMN_J_K,
                AIR_J_K,
            ]
        )
        self._between_W_K = _between(machine)
        self._total_W_K = self._between_W_K.sum(axis=1)

    @property
    def stored_J(self) -> float:
        """The heat stored above 0 °C."""
        bodies_J = float(self._body_J_K @ self.body_degC)
        return float(self._cell_J_K * self.screw_degC.sum()) + bodies_J

    def advance(self, step_s: float, now: Work) -> None:
        """Advance by a step of so many seconds with the work of it, one row of `Work`."""
        machine, body_degC = self._machine, self.body_degC
        self._rub(now)
        nut_W, *bearing_W = self.heats
        into_screw_W, into_bodies_W = self._exchanged(now)
        into_screw_W += machine.nut.share * nut_W * now.cover
        into_bodies_W[NUT] += (1.0 - machine.nut.share) * nut_W
        for end, body, heat_W, law in zip((0, -1), (LEFT, RIGHT), bearing_W, machine.bearings, strict=True):
            into_screw_W[end] += law.share * heat_W
            into_bodies_W[body] += (1.0 - law.share) * heat_W
        motor_W = MOTOR_IDLE_W + MOTOR_LOSS * sum(self.heats)
        spindle_W = machine.spindle_W * float(now.moving)
        into_bodies_W[MOTOR] += motor_W
        into_bodies_W[HEAD] += spindle_W
        room_W = AIR_ROOM_W_K * float(body_degC[AIR] - machine.room.at_degC(self.time_s))
        into_bodies_W[AIR] -= room_W
        self.screw_degC = self.screw_degC + into_screw_W * (step_s / self._cell_J_K)
        self.body_degC = body_degC + into_bodies_W * (step_s / self._body_J_K)
        self.entered_J += step_s * (sum(self.heats) + motor_W + spindle_W)
        self.left_J += step_s * room_W
        self.time_s += step_s
        self.running_s += step_s * float(now.moving)

    def _exchanged(self, now: Work) -> tuple[FloatArray, FloatArray]:
        """Return what flows within the machine: the sums into each cell and into each body, W."""
        machine, screw_degC, body_degC = self._machine, self.screw_degC, self.body_degC
        into_screw_W = np.zeros_like(screw_degC)
        along_W = self._along_W_K * np.diff(screw_degC)
        into_screw_W[:-1] += along_W
        into_screw_W[1:] -= along_W
        film_W_K = machine.film_W_m2K(float(now.speed_rpm)) * self._skin_m2
        lost_W = film_W_K * (screw_degC - body_degC[AIR] - self._height_K)
        contact_W = machine.nut_contact_W_K * now.cover * (screw_degC - body_degC[NUT])
        into_screw_W -= lost_W + contact_W
        into_bodies_W = self._between_W_K @ body_degC - self._total_W_K * body_degC
        into_bodies_W[AIR] += lost_W.sum()
        into_bodies_W[NUT] += contact_W.sum()
        for end, body, conductance_W_K in (
            (0, LEFT, machine.bearing_W_K[0]),
            (-1, RIGHT, machine.bearing_W_K[1]),
            (self._motor_end, MOTOR, machine.coupling_W_K),
        ):
            across_W = conductance_W_K * (screw_degC[end] - body_degC[body])
            into_screw_W[end] -= across_W
            into_bodies_W[body] += across_W
        return into_screw_W, into_bodies_W

    def _rub(self, now: Work) -> None:
        """Set the friction heats: the laws of a first configuration, times what each is off by."""
        machine, screw, body_degC = self._machine, self._machine.screw, self.body_degC
        speed_rpm, moving = float(now.speed_rpm), float(now.moving)
        turning_rpm = speed_rpm / moving if moving > 0.0 else 0.0
        laws_W = (
            screw.torque_Nm * speed_rpm * 2.0 * math.pi / 60.0,
            screw.bearing_W_rpm * speed_rpm,
            screw.bearing_W_rpm * speed_rpm,
        )
        factors = (
            _factor(friction, turning_rpm, float(now.thrust_N), float(body_degC[body]), self.running_s)
            for friction, body in zip((machine.nut, *machine.bearings), (NUT, LEFT, RIGHT), strict=True)
        )
        self.heats = Heats(*(law_W * factor for law_W, factor in zip(laws_W, factors, strict=True)))


def _factor(law: Friction, speed_rpm: float, thrust_N: float, at_degC: float, running_s: float) -> float:
    """Return how much a friction differs from its law at a speed, thrust and temperature."""
    if speed_rpm == 0.0:
        return 0.0
    loaded = 1.0 + law.load_part * (thrust_N / TYPICAL_THRUST_N - 0.5)
    fade = math.exp(-law.fade_1_K * (at_degC - 25.0))
    run_in = 1.0 + law.run_in * math.exp(-running_s / law.run_in_s)
    return float(law.scale * loaded * fade * run_in * (speed_rpm / 1000.0) ** law.exponent)


def _between(machine: FirstDayMachine) -> FloatArray:
    """Return the conductances between bodies, W/K, symmetric."""
    between = np.zeros((len(BODIES), len(BODIES)))
    motor_side = LEFT if machine.nameplate.fixed == "left" else RIGHT
    for one, other, conductance_W_K in (
        (NUT, BRACKET, machine.bracket_W_K),
        (BRACKET, AIR, machine.bracket_air_W_K),
        (BRACKET, HEAD, machine.bracket_head_W_K),
        (LEFT, AIR, machine.housing_air_W_K[0]),
        (RIGHT, AIR, machine.housing_air_W_K[1]),
        (LEFT, COLUMN, machine.housing_column_W_K[0]),
        (RIGHT, COLUMN, machine.housing_column_W_K[1]),
        (motor_side, MOTOR, machine.motor_housing_W_K),
        (MOTOR, AIR, MOTOR_AIR_W_K),
        (HEAD, AIR, HEAD_AIR_W_K),
        (COLUMN, AIR, COLUMN_AIR_W_K),
    ):
        between[one, other] += conductance_W_K
        between[other, one] += conductance_W_K
    return between


def field_degC(machine: FirstDayMachine, screw_degC: FloatArray, positions_m: FloatArray) -> FloatArray:
    """Return the temperature at places of the screw, (…, g), linear between cells and beyond."""
    cell_m = machine.nameplate.length_m / machine.cells
    at = np.clip(positions_m / cell_m - 0.5, -0.5, machine.cells - 0.5)
    first = np.clip(np.floor(at).astype(int), 0, machine.cells - 2)
    part = at - first
    return np.asarray((1.0 - part) * screw_degC[..., first] + part * screw_degC[..., first + 1])


def error_um(
    machine: FirstDayMachine, screw_degC: FloatArray, positions_m: FloatArray, zero_degC: float | FloatArray
) -> FloatArray:
    """Return the thermal error (…, g), positive away from x = 0, of a screw held at its fixed end alone.

    It is 0 at the temperature `zero_degC`, a number or a field (cells,).
    """
    cell_m = machine.nameplate.length_m / machine.cells
    grown_um = 1e6 * EXPANSION_1_K * cell_m * np.cumsum(screw_degC - zero_degC, axis=-1)
    grown_um = np.concatenate([np.zeros((*grown_um.shape[:-1], 1)), grown_um], axis=-1)
    at = np.clip(positions_m / cell_m, 0.0, machine.cells)
    first = np.minimum(at.astype(int), machine.cells - 1)
    part = at - first
    free_um = (1.0 - part) * grown_um[..., first] + part * grown_um[..., first + 1]
    held_um = grown_um[..., -1:] if machine.nameplate.fixed == "right" else 0.0
    return np.asarray(free_um - held_um)
