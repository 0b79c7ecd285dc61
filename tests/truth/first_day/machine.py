"""One drawn machine: the data that its user has, and how it really is.

Drawn around the values that a first configuration has: convection, links, housings and laws log-normal;
conductivity, heat capacity, shares and sensors normal. The standard deviations are those of the
configuration: its `tolerance` beside each "look" value, else the defaults of `[tolerance]`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from tests.truth.first_day.programme import Axis, FloatArray, GRAVITY_m_s2, Programme

CELLS = 60
EXPANSION_1_K, BODY_J_kgK, AIR_PRANDTL_1_3 = 11.8e-6, 470.0, 0.89
CONVECTION, CONDUCTIVITY, HEAT_CAPACITY, CAPACITY = 0.3, 0.03, 0.03, 0.1
LINK, HOUSING_MASS = 0.4, 0.2
LAW = 0.25
"""With friction's fade, run-in and speed about the 0.3 that a law without sensors on the screw is off by."""
OFFSET_K, AIR_K, LAG_s, GAIN, END_W_K = 0.3, 0.5, 4.0, 0.02, 0.05


class Screw(NamedTuple):
    """A catalogue's screw with the typical values that a first configuration takes from it."""

    lead_m: float
    root_m: float
    nut_m: float
    torque_Nm: float
    bearing_W_rpm: float
    nut_kg: float
    housing_kg: float
    housing_W_K: float


SCREWS = {
    "25x10": Screw(0.010, 0.0212, 0.075, 0.20, 0.004, 0.59, 1.4, 5.0),
    "32x10": Screw(0.010, 0.0269, 0.095, 0.30, 0.005, 1.2, 2.2, 7.0),
    "40x10": Screw(0.010, 0.0349, 0.100, 0.40, 0.006, 1.9, 3.3, 10.0),
    "40x20": Screw(0.020, 0.0349, 0.110, 0.40, 0.006, 2.0, 3.3, 10.0),
    "50x10": Screw(0.010, 0.0449, 0.110, 0.60, 0.008, 2.8, 6.5, 13.0),
}


class Nameplate(NamedTuple):
    """A machine's data that its user can read or measure; `nut_kg` with its bracket."""

    screw: str
    length_m: float
    stroke_m: tuple[float, float]
    nut_kg: float
    vertical: bool
    mounting: str
    fixed: str


class Friction(NamedTuple):
    """How friction departs from its law: scale, load's part, fade, running in, exponent of speed."""

    scale: float
    load_part: float
    fade_1_K: float
    run_in: float
    run_in_s: float
    exponent: float
    share: float


class SensorError(NamedTuple):
    """A thermocouple's offset and lag, and the part of its rise above the air that it does not show."""

    offset_K: float
    lag_s: float
    gain: float


class Room(NamedTuple):
    """The air of the shop: mean, course of the day, and slow drift as waves (amplitude, period, phase)."""

    mean_degC: float
    day_K: float
    day_phase: float
    waves: FloatArray

    def at_degC(self, time_s: float) -> float:
        """Return its temperature at a time."""
        amplitude_K, period_s, phase = self.waves
        slow_K = float(np.sum(amplitude_K * np.sin(2.0 * math.pi * time_s / period_s + phase)))
        day_K = self.day_K * math.sin(2.0 * math.pi * time_s / 86_400.0 + self.day_phase)
        return self.mean_degC + day_K + slow_K


@dataclass(frozen=True)
class FirstDayMachine:
    """A machine with its sensors; conductances in W/K between the bodies that their names say."""

    number: int
    nameplate: Nameplate
    axis: Axis
    conductivity_W_mK: float
    capacity_J_m3K: float
    still_W_m2K: float
    turning_W_m2K: float
    nut: Friction
    bearings: tuple[Friction, Friction]
    nut_contact_W_K: float
    bracket_W_K: float
    bracket_air_W_K: float
    bracket_head_W_K: float
    bearing_W_K: FloatArray
    housing_air_W_K: FloatArray
    housing_column_W_K: FloatArray
    motor_housing_W_K: float
    coupling_W_K: float
    nut_J_K: float
    bracket_J_K: float
    housing_J_K: FloatArray
    weight_N: float
    spindle_W: float
    air_rise_K_m: float
    room: Room
    sensors: tuple[SensorError, SensorError, SensorError]
    air_sensor: SensorError
    start_K: float
    noise_K: float = 0.06
    cells: int = CELLS
    screw: Screw = field(init=False)

    def __post_init__(self) -> None:
        """Look the screw up."""
        object.__setattr__(self, "screw", SCREWS[self.nameplate.screw])

    def programme(self, hours: float) -> Programme:
        """Return its work of so many hours: the same moves for the same machine."""
        return Programme(self.axis, _stream(self.number, 1), hours)

    def film_W_m2K(self, speed_rpm: float) -> float:
        """Return the film of the turning screw; the part by Nu = 0.133 Re^(2/3) Pr^(1/3)."""
        return self.still_W_m2K + self.turning_W_m2K * turning(self.screw.root_m, speed_rpm)


def turning(diameter_m: float, speed_rpm: float) -> float:
    """Return the film of a turning cylinder in W/m²K."""
    reynolds = diameter_m**2 / 2.0 * abs(speed_rpm) * 2.0 * math.pi / 60.0 / 1.55e-5
    return 0.133 * float(reynolds ** (2.0 / 3.0)) * AIR_PRANDTL_1_3 * 0.026 / diameter_m


def _stream(number: int, purpose: int) -> np.random.Generator:
    return np.random.default_rng([37, number, purpose])


def sensor_stream(number: int) -> np.random.Generator:
    """Return the random numbers of a machine's readings."""
    return _stream(number, 2)


def draw_machine(number: int) -> FirstDayMachine:
    """Return the machine of this number: horizontal where it is odd, vertical where it is even."""
    rng = _stream(number, 0)
    nameplate = _nameplate(number, rng)
    screw = SCREWS[nameplate.screw]
    nut_W_K = 700.0 * math.pi * screw.root_m * screw.nut_m
    air_W_K, bolted = 0.4 * nameplate.nut_kg ** (2.0 / 3.0) * _lognormal(rng, LINK), rng.uniform(0.3, 0.6)
    housing_W_K = 0.45 * screw.housing_kg ** (2.0 / 3.0) * _lognormal(rng, LINK, 2)
    on_column = rng.uniform(0.3, 0.6, 2)
    film = 15.0 * float(_lognormal(rng, CONVECTION)[0])
    mean_rpm = float(rng.uniform(500.0, 900.0))
    bracket_kg = (nameplate.nut_kg - screw.nut_kg) * float(1.0 + CAPACITY * rng.standard_normal())
    return FirstDayMachine(
        number=number,
        nameplate=nameplate,
        axis=_axis(nameplate, rng),
        conductivity_W_mK=46.0 * float(1.0 + CONDUCTIVITY * rng.standard_normal()),
        capacity_J_m3K=7810.0 * 475.0 * float(1.0 + HEAT_CAPACITY * rng.standard_normal()),
        still_W_m2K=film * 2.0 / 3.0,
        turning_W_m2K=film / 3.0 / turning(screw.root_m, mean_rpm),
        nut=_friction(rng),
        bearings=(_friction(rng), _friction(rng)),
        nut_contact_W_K=nut_W_K * float(_lognormal(rng, LINK)[0]),
        bracket_W_K=float(60.0 * _lognormal(rng, LINK)[0]),
        bracket_air_W_K=float(air_W_K[0] * (1.0 - bolted)),
        bracket_head_W_K=float(air_W_K[0] * bolted),
        bearing_W_K=screw.housing_W_K * _lognormal(rng, LINK, 2),
        housing_air_W_K=housing_W_K * (1.0 - on_column),
        housing_column_W_K=housing_W_K * on_column,
        motor_housing_W_K=float(rng.uniform(0.05, 0.2)),
        coupling_W_K=abs(END_W_K * float(rng.standard_normal())),
        nut_J_K=BODY_J_kgK * screw.nut_kg,
        bracket_J_K=BODY_J_kgK * bracket_kg,
        housing_J_K=BODY_J_kgK * screw.housing_kg * _lognormal(rng, HOUSING_MASS, 2),
        weight_N=float(rng.uniform(0.0, 1500.0)) if nameplate.vertical else 0.0,
        spindle_W=float(rng.uniform(20.0, 80.0)) if nameplate.vertical else 0.0,
        air_rise_K_m=float(rng.uniform(-1.0, 0.0)) if nameplate.vertical else 0.0,
        room=_room(rng),
        sensors=(_sensor(rng, OFFSET_K), _sensor(rng, OFFSET_K), _sensor(rng, OFFSET_K)),
        air_sensor=_sensor(rng, AIR_K)._replace(gain=0.0),
        start_K=float(0.3 * rng.standard_normal()),
    )


def _lognormal(rng: np.random.Generator, sigma: float, count: int = 1) -> FloatArray:
    """Return log-normal factors around 1 (count,)."""
    return np.exp(sigma * rng.standard_normal(count))


def _nameplate(number: int, rng: np.random.Generator) -> Nameplate:
    name = str(rng.choice(sorted(SCREWS)))
    screw = SCREWS[name]
    length_m = round(float(rng.uniform(0.7, 1.4 if screw.root_m > 0.03 else 1.0)), 2)
    ends_m = rng.uniform(0.02, 0.10, 2) + screw.nut_m / 2.0
    stroke_m = (round(float(ends_m[0]), 3), round(float(length_m - ends_m[1]), 3))
    return Nameplate(
        screw=name,
        length_m=length_m,
        stroke_m=stroke_m,
        nut_kg=round(screw.nut_kg + float(rng.uniform(4.0, 12.0)), 1),
        vertical=number % 2 == 0,
        mounting="fixed-supported" if rng.random() < 0.5 else "fixed-free",
        fixed="left" if rng.random() < 0.7 else "right",
    )


def _axis(nameplate: Nameplate, rng: np.random.Generator) -> Axis:
    """Rapids of 24 to 40 m/min, as far as 150,000 rpm·mm allow, and 0.3 to 1 g."""
    screw = SCREWS[nameplate.screw]
    fastest_m_min = 150.0 / (float(nameplate.screw.partition("x")[0]) / 1000.0) * screw.lead_m
    rapid_m_min = float(rng.uniform(24.0, min(40.0, fastest_m_min)))
    return Axis(nameplate.stroke_m, rapid_m_min / 60.0, float(rng.uniform(0.3, 1.0)) * GRAVITY_m_s2)


def _friction(rng: np.random.Generator) -> Friction:
    return Friction(
        scale=float(_lognormal(rng, LAW)[0]),
        load_part=float(rng.uniform(0.1, 0.3)),
        fade_1_K=float(rng.uniform(0.0, 0.01)),
        run_in=float(rng.uniform(0.0, 0.3)),
        run_in_s=float(rng.uniform(600.0, 2400.0)),
        exponent=float(rng.uniform(-0.1, 0.2)),
        share=float(0.5 + 0.05 * rng.standard_normal()),
    )


def _sensor(rng: np.random.Generator, offset_K: float) -> SensorError:
    offset, lag, gain = rng.standard_normal(3)
    return SensorError(offset_K * float(offset), LAG_s * abs(float(lag)), GAIN * float(gain))


def _room(rng: np.random.Generator) -> Room:
    amplitude_K = 0.15 * np.abs(rng.standard_normal(4))
    period_s, phase = np.array([900.0, 2100.0, 5000.0, 11_000.0]), rng.uniform(0.0, 2.0 * math.pi, 4)
    return Room(
        mean_degC=float(rng.uniform(18.0, 26.0)),
        day_K=float(rng.uniform(0.5, 3.0)),
        day_phase=float(rng.uniform(0.0, 2.0 * math.pi)),
        waves=np.stack([amplitude_K, period_s, phase]),
    )
