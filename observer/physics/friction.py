"""How much heat friction makes: rolling bearings, ball nuts, and drives whose nut turns too.

Pure: speeds in rpm go in, torques in N m and heats in W come out. Every function takes whole arrays.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from observer.frames import FloatArray
from observer.units import RAD_S_PER_RPM, ZERO_DEGC_K

SWITCH_MM2_S_RPM = 2000.0
"""Below this product of viscosity and speed the lubricant's torque no longer falls with the speed."""


class BearingType(NamedTuple):
    """The constants of Palmgren's formula for a kind of bearing: f_1 = z (P_0/C_0)^y.

    Attributes:
        load_factor: z.
        load_exponent: y.
        axial: Factor a of the axial load in P = max(a F_a − 0.1 F_r, F_r).
        f0: Factor of the lubricant's torque, for grease.
    """

    load_factor: float
    load_exponent: float
    axial: float
    f0: float


BEARING_TYPES = {
    "angular_contact": BearingType(0.0013, 0.33, 1.0, 2.0),
    "angular_contact_pair": BearingType(0.001, 0.33, 1.44, 4.0),
    "deep_groove": BearingType(0.0009, 0.55, 3.0, 2.0),
}
"""Angular contact, one row and two: Yu et al. 2024, §3.1.1; deep groove: Harris 2001, ch. 14."""


def bearing_load_N(kind: BearingType, axial_N: float, radial_N: float) -> float:
    """Return the load P that makes friction, from a bearing's axial and radial load.

    P = max(a F_a − 0.1 F_r, F_r). Source: Palmgren 1959; Harris 2001, ch. 14. Yu et al. print a plus sign for
    one row, where the older sources have a minus; without a radial load both agree.

    Args:
        kind: Constants of the bearing.
        axial_N: Axial load F_a, N, preload included.
        radial_N: Radial load F_r, N.
    """
    return max(kind.axial * axial_N - 0.1 * radial_N, radial_N)


def load_factor(kind: BearingType, static_load_N: float, static_rating_N: float) -> float:
    """Return f_1 = z (P_0/C_0)^y of a bearing (Yu et al. 2024, §3.1.1).

    Args:
        kind: Constants of the bearing.
        static_load_N: Equivalent static load P_0, N.
        static_rating_N: Static rating C_0 of the catalogue, N.
    """
    return kind.load_factor * float((static_load_N / static_rating_N) ** kind.load_exponent)


def load_torque_Nm(f1: float, load_N: float, mean_diameter_m: float) -> float:
    """Return M_1 = f_1 P d_m, which acts at any speed (Palmgren 1959; Yu et al. 2024, §3.1.1).

    Args:
        f1: Load factor.
        load_N: Load P that makes friction, N.
        mean_diameter_m: Mean diameter d_m of the bearing, m.
    """
    return f1 * load_N * mean_diameter_m


def lubricant_torque_Nm(
    speed_rpm: FloatArray, f0: float, viscosity_mm2_s: float, mean_diameter_m: float
) -> FloatArray:
    """Return M_2, what shearing the lubricant takes, at speeds (k,).

    M_2 = 1e-7 f_0 (ν n)^{2/3} d_m³ for ν n ≥ 2000 and 160e-7 f_0 d_m³ below, in N mm with d_m in mm, ν in
    mm²/s, n in rpm. As 2000^{2/3} is 158.7, the torque drops by 0.8 % at the switch. Source: Palmgren 1959;
    Yu et al. 2024, §3.1.1.

    Args:
        speed_rpm: Speed of either sense, rpm, (k,).
        f0: Factor of the lubricant's torque.
        viscosity_mm2_s: Kinematic viscosity ν of the lubricant as it runs, mm²/s.
        mean_diameter_m: Mean diameter of the bearing, m.
    """
    product = viscosity_mm2_s * np.abs(speed_rpm)
    power = np.where(product >= SWITCH_MM2_S_RPM, np.cbrt(product) ** 2, 160.0)
    return np.asarray(0.1 * f0 * power * mean_diameter_m**3)


def friction_heat_W(torque_Nm: FloatArray | float, speed_rpm: FloatArray) -> FloatArray:
    """Return Q = (π/30) |n| M (Yu et al. 2024: 1.047e-4 n M with M in N mm; Kim et al., eq. 28)."""
    return np.asarray(RAD_S_PER_RPM * np.abs(speed_rpm) * torque_Nm)


def viscosity_mm2_s(temperature_degC: float, at_40_mm2_s: float, at_100_mm2_s: float) -> float:
    """Return a mineral oil's kinematic viscosity at a temperature from its values at 40 and 100 °C.

    log₁₀ log₁₀(ν + 0.7) is linear in log₁₀ T with T in kelvin (Walther; ASTM D341). Good from −20 to 150 °C,
    for ν above 2 mm²/s.

    Args:
        temperature_degC: The temperature, °C.
        at_40_mm2_s: Viscosity at 40 °C, mm²/s.
        at_100_mm2_s: Viscosity at 100 °C, mm²/s, below that at 40 °C.
    """

    def double_log(nu: float) -> float:
        return math.log10(math.log10(nu + 0.7))

    cold, hot = math.log10(40.0 + ZERO_DEGC_K), math.log10(100.0 + ZERO_DEGC_K)
    slope = (double_log(at_100_mm2_s) - double_log(at_40_mm2_s)) / (hot - cold)
    value = double_log(at_40_mm2_s) + slope * (math.log10(temperature_degC + ZERO_DEGC_K) - cold)
    return float(10.0**10.0**value - 0.7)


def preload_torque_Nm(preload_N: float, efficiency: float, lead_m: float) -> float:
    """Return the torque that turns a preloaded double nut without any outer load.

    One half of the nut is driven against the preload, which takes F l/(2π η); the other is driven back by
    it, which returns F l/(2π) (2 − 1/η). The remaining term is M = F l/π (1/η − 1), all of it heat. Assumes
    that both halves waste the same torque.

    Args:
        preload_N: Preload F between the halves, N.
        efficiency: Efficiency η of the nut without preload, 0.5 to 1.
        lead_m: Lead l, m per revolution.
    """
    return preload_N * lead_m / math.pi * (1.0 / efficiency - 1.0)


def load_friction_torque_Nm(load_N: float, efficiency: float, lead_m: float) -> float:
    """Return the part of the torque that is heat when a nut moves against an axial load.

    Driving takes F l/(2π η), of which F l/(2π) is work; M = F l/(2π) (1/η − 1).

    Args:
        load_N: Axial load F, N.
        efficiency: Efficiency η of the nut, 0.5 to 1.
        lead_m: Lead l, m per revolution.
    """
    return load_N * lead_m / (2.0 * math.pi) * (1.0 / efficiency - 1.0)


def relative_heat_W(torque_Nm: float, screw_rpm: FloatArray, nut_rpm: FloatArray) -> FloatArray:
    """Return the heat where screw and nut rub, when both turn: only their relative speed counts.

    Q = (π/30) M |n_S − n_N|, both speeds counted in the same sense.

    Args:
        torque_Nm: Friction torque M of the contact, N m.
        screw_rpm: Speed n_S of the screw, rpm, (k,).
        nut_rpm: Speed n_N of the nut, rpm, (k,).
    """
    return friction_heat_W(torque_Nm, screw_rpm - nut_rpm)


def dual_drive_heat_W(
    screw_torque_Nm: float, nut_torque_Nm: float, screw_rpm: FloatArray, nut_rpm: FloatArray
) -> FloatArray:
    """Return the heat of a screw and a nut that are both driven, each by its own friction torque.

    Q = (π/30) (|n_N| M_N + |n_S| M_S) (Yu et al. 2024, §3.1.1). The torques are those of the two drives, with
    their own bearings; the contact between screw and nut alone is `relative_heat_W`.

    Args:
        screw_torque_Nm: Friction torque M_S of the screw's drive, N m.
        nut_torque_Nm: Friction torque M_N of the nut's drive, N m.
        screw_rpm: Speed n_S of the screw, rpm, (k,).
        nut_rpm: Speed n_N of the nut, rpm, (k,).
    """
    return friction_heat_W(screw_torque_Nm, screw_rpm) + friction_heat_W(nut_torque_Nm, nut_rpm)


def stroke_share(stroke_m: tuple[float, float], screw_m: float) -> float:
    """Return Kim's factor (a_2 − a_1)/L of a nut's heat (Kim et al., eq. 28).

    Args:
        stroke_m: Both ends a_1 and a_2 of the stroke, m.
        screw_m: Length L of the screw, m.
    """
    return (stroke_m[1] - stroke_m[0]) / screw_m
