"""What the machine is made of and what is done to it: numbers and arrays that compiled code can read."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

NUT, LEFT, RIGHT = 0, 1, 2
"""Order of the three heats of friction in every array of three."""

AIR_CONDUCTIVITY_W_mK = 0.0254
AIR_VISCOSITY_m2_s = 15.5e-6
AIR_PRANDTL = 0.72
"""Air near a machine, as Yu et al. take it: with the gain they are part of what the effect means."""

REFERENCE_degC = 20.0
"""Temperature at which fading friction has its nominal value."""
REFERENCE_rpm = 1000.0
"""Speed at which friction with another exponent has its nominal value."""


class Physics(NamedTuple):
    """One machine, constant over a run; arrays over slices are (slices,), over ends (2,), over heats (3,)."""

    # the screw
    length_m: float
    diameter_m: float
    conductivity_W_mK: float
    capacity_J_m3K: float
    # its surface
    film_W_m2K: FloatArray  # base film along the screw
    extra_film_W_m2K: FloatArray  # on top of it, on a stretch
    rotation_gain: float  # share of the rotating cylinder's film
    emissivity: float
    still_W_m2K: float  # film at a rise of 10 K that grows with its fourth root
    # coolant in its bore while it turns
    coolant_W_K: float
    inlet_degC: float
    # its ends
    end_W_K: FloatArray  # conductance to the air
    motor_W: FloatArray  # constant heat
    end_heat_W_rpm: FloatArray  # extra heat with speed
    # heats of friction: nut, left bearing, right bearing
    friction_W_rpm: FloatArray
    exponent: FloatArray
    fade_1_K: FloatArray
    run_in: FloatArray
    run_in_s: FloatArray
    run_in_power: float  # exp(−(t/run_in_s)^power); below 1 it begins faster and lasts longer
    # the nut
    nut_length_m: float
    lead_m: float
    dwell: float
    # bodies that store heat, each on the nut, the left end, the right end; no conductance: no body
    body_J_K: FloatArray
    body_W_K: FloatArray
    nut_body_share: float  # W of friction that heat the nut's body, of each W that enters the screw
    nut_body_air_W_K: float  # from that body to the air
    # a cover over the whole screw, whose air the nut warms; no conductance: no cover
    cover_W_K: float  # from its air to the air outside
    cover_J_K: float
    cover_share: float  # W of friction that heat its air, of each W that enters the screw
    # heats at places of the surface
    local_W: FloatArray  # constant, of each slice
    spot: FloatArray  # share of each slice of `spot_W`


class Schedule(NamedTuple):
    """One run step by step, each array (K,): the mean over the step."""

    step_s: float
    start_m: float
    start_degC: float
    speed_rpm: FloatArray
    low_m: FloatArray  # stroke in force
    high_m: FloatArray
    air_degC: FloatArray  # the air the screw really feels
    film_factor: FloatArray  # on the base film
    nut_factor: FloatArray  # on the nut's friction, everywhere
    climb_factor: FloatArray  # on the nut's friction while it climbs the upper half of its stroke
    spot_W: FloatArray  # a heat at one place, now and then
    inlet_K: FloatArray  # how much warmer the coolant enters than the machine says


def steady_schedule(steps: int, step_s: float, **changes: Any) -> Schedule:
    """A run at standstill in still air at 20 °C, with changes."""
    one, none = np.ones(steps), np.zeros(steps)
    plain = Schedule(
        step_s=step_s,
        start_m=0.2,
        start_degC=20.0,
        speed_rpm=none,
        low_m=0.2 * one,
        high_m=0.8 * one,
        air_degC=20.0 * one,
        film_factor=one,
        nut_factor=one,
        climb_factor=one,
        spot_W=none,
        inlet_K=none,
    )
    return plain._replace(**changes)


def plain_physics(slices: int = 100, **changes: Any) -> Physics:
    """The machine as configured, without any hidden effect, with changes."""
    none = np.zeros(slices)
    plain = Physics(
        length_m=1.0,
        diameter_m=0.036,
        conductivity_W_mK=50.0,
        capacity_J_m3K=7800.0 * 460.0,
        film_W_m2K=none + 15.0,
        extra_film_W_m2K=none,
        rotation_gain=0.0,
        emissivity=0.0,
        still_W_m2K=0.0,
        coolant_W_K=0.0,
        inlet_degC=20.0,
        end_W_K=np.zeros(2),
        motor_W=np.zeros(2),
        end_heat_W_rpm=np.zeros(2),
        friction_W_rpm=np.array([0.5 * 0.3 * np.pi / 30.0, 0.006, 0.006]),
        exponent=np.ones(3),
        fade_1_K=np.zeros(3),
        run_in=np.zeros(3),
        run_in_s=np.ones(3),
        run_in_power=1.0,
        nut_length_m=0.08,
        lead_m=0.005,
        dwell=0.0,
        body_J_K=np.ones(3),
        body_W_K=np.zeros(3),
        nut_body_share=0.0,
        nut_body_air_W_K=0.0,
        cover_W_K=0.0,
        cover_J_K=1.0,
        cover_share=0.0,
        local_W=none,
        spot=none,
    )
    return plain._replace(**changes)
