"""Everything that heats or cools the screw during a step, from its temperatures in the middle of the step."""

from __future__ import annotations

import math

import numba

from tests.truth.machine.grid import Grid
from tests.truth.machine.physics import (
    AIR_PRANDTL,
    LEFT,
    NUT,
    AIR_CONDUCTIVITY_W_mK,
    AIR_VISCOSITY_m2_s,
    FloatArray,
    Physics,
    REFERENCE_degC,
    REFERENCE_rpm,
)

STEFAN_BOLTZMANN_W_m2K4 = 5.670374419e-8
KELVIN = 273.15
# columns of the energy book, J
FRICTION, STEADY_HEAT, FILM, RADIATION, COOLANT, ENDS, BODIES = range(7)


@numba.njit
def rotating_film_W_m2K(speed_rpm: float, diameter_m: float) -> float:
    """Film of a cylinder turning in still air: Nu = 0.133 Re^(2/3) Pr^(1/3).

    Re = ω d²/ν as Yu et al. print it, twice the one of the surface speed ω d/2: the data of an outside rig
    with a known gain ask for it.
    """
    omega_rad_s = math.pi * abs(speed_rpm) / 30.0
    reynolds = omega_rad_s * diameter_m**2 / AIR_VISCOSITY_m2_s
    nusselt = 0.133 * reynolds ** (2.0 / 3.0) * AIR_PRANDTL ** (1.0 / 3.0)
    return float(nusselt * AIR_CONDUCTIVITY_W_mK / diameter_m)


@numba.njit
def friction_W(physics: Physics, which: int, speed_rpm: float, turning_s: float, local_degC: float) -> float:
    """Heat of the nut's friction or of a bearing's at this speed, running time and temperature."""
    if speed_rpm == 0.0:
        return 0.0
    nominal = physics.friction_W_rpm[which] * REFERENCE_rpm
    heat_W = nominal * (abs(speed_rpm) / REFERENCE_rpm) ** physics.exponent[which]
    heat_W *= math.exp(-physics.fade_1_K[which] * (local_degC - REFERENCE_degC))
    run_in = (turning_s / physics.run_in_s[which]) ** physics.run_in_power
    return float(heat_W * (1.0 + physics.run_in[which] * math.exp(-run_in)))


@numba.njit
def cool_surface(
    load_J: FloatArray,
    shell_degC: FloatArray,
    heat_W: FloatArray,
    under: FloatArray,
    air_degC: float,
    film_factor: float,
    rotating: float,
    body_degC: float,
    step_s: float,
    grid: Grid,
    physics: Physics,
    book: FloatArray,
) -> float:
    """Load the outer ring with its heats, less what goes to the air and to the nut's body.

    The surface is warmer than the middle of the outer ring by (heat − loss) × the skin's resistance.
    Returns the heat into the nut's body, W.
    """
    outer, air_K, into_body_W = grid.rings - 1, air_degC + KELVIN, 0.0
    for i in range(grid.slices):
        film_W_K = physics.film_W_m2K[i] * film_factor + physics.extra_film_W_m2K[i] + rotating
        film_W_K *= grid.surface_m2
        net_W = heat_W[i]
        if physics.body_W_K[NUT] > 0.0 and under[i] > 0.0:
            tie = physics.body_W_K[NUT] * under[i]
            flow_W = tie * (shell_degC[i] + grid.skin_K_W * net_W - body_degC) / (1.0 + tie * grid.skin_K_W)
            into_body_W += flow_W
            net_W -= flow_W
        warm_degC = shell_degC[i] + grid.skin_K_W * net_W
        film_W, glow_W = 0.0, 0.0
        for _ in range(2):  # each round gains a factor film·skin ≈ 1e-4
            surface_degC = warm_degC - grid.skin_K_W * (film_W + glow_W)
            rise_K = surface_degC - air_degC
            growing_W_m2K = physics.still_W_m2K * (abs(rise_K) / 10.0) ** 0.25
            film_W = (film_W_K + growing_W_m2K * grid.surface_m2) * rise_K
            if physics.emissivity > 0.0:
                glow = (surface_degC + KELVIN) ** 4 - air_K**4
                glow_W = physics.emissivity * STEFAN_BOLTZMANN_W_m2K4 * grid.surface_m2 * glow
        load_J[i, outer] += step_s * (net_W - film_W - glow_W)
        book[FILM] -= step_s * film_W
        book[RADIATION] -= step_s * glow_W
    book[BODIES] -= step_s * into_body_W
    return into_body_W


@numba.njit
def cool_bore(
    load_J: FloatArray,
    core_degC: FloatArray,
    inlet_degC: float,
    step_s: float,
    grid: Grid,
    physics: Physics,
    book: FloatArray,
) -> None:
    """Take heat from the innermost ring to a coolant of one temperature."""
    for i in range(grid.slices):
        flow_W = physics.coolant_W_K / grid.slices * (core_degC[i] - inlet_degC)
        load_J[i, 0] -= step_s * flow_W
        book[COOLANT] -= step_s * flow_W


@numba.njit
def face_degC(
    plain_degC: float,
    heat_W: float,
    ties: tuple[float, float],
    outside_degC: tuple[float, float],
    lever: float,
) -> float:
    """Temperature of an end face with heat and two contacts: the face's gradient follows from both."""
    pull = ties[0] * outside_degC[0] + ties[1] * outside_degC[1]
    return (plain_degC + lever * (heat_W + pull)) / (1.0 + lever * (ties[0] + ties[1]))


@numba.njit
def load_end(
    load_J: FloatArray,
    side: int,
    section_degC: FloatArray,
    friction: float,
    steady: float,
    air_degC: float,
    body_degC: float,
    step_s: float,
    grid: Grid,
    physics: Physics,
    book: FloatArray,
) -> tuple[float, float]:
    """Heat and cool one end face; the flow enters its slice evenly over the section.

    The face's temperature follows from the means of two slices and the gradient (a parabola).
    Returns the face's temperature and the heat into the end's body, W.
    """
    cell, inward = (0, 1) if side == 0 else (grid.slices - 1, -1)
    near, far = section_degC[cell], section_degC[cell + inward]
    air_W_K, body_W_K = physics.end_W_K[side], physics.body_W_K[LEFT + side]
    face = face_degC(
        (7.0 * near - far) / 6.0, friction + steady, (air_W_K, body_W_K), (air_degC, body_degC), grid.face_K_W
    )
    to_air_W, to_body_W = air_W_K * (face - air_degC), body_W_K * (face - body_degC)
    net_W = friction + steady - to_air_W - to_body_W
    for j in range(grid.rings):
        load_J[cell, j] += step_s * net_W * grid.share[j]
    book[FRICTION] += step_s * friction
    book[STEADY_HEAT] += step_s * steady
    book[ENDS] -= step_s * to_air_W
    book[BODIES] -= step_s * to_body_W
    return face, to_body_W
