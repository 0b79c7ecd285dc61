"""Film coefficients: the air, convection of a screw at rest and turning, threads, and radiation.

Pure functions of geometry, speed and temperatures. A Nusselt number becomes a film by h = Nu k_air/length.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from observer.frames import FloatArray
from observer.physics.constants import GRAVITY_M_S2, STEFAN_BOLTZMANN_W_m2K4
from observer.units import RAD_S_PER_RPM, ZERO_DEGC_K

_PRESSURE_PA = 101_325.0
_GAS_CONSTANT_J_kgK = 287.058


class Air(NamedTuple):
    """The properties of air on which a film coefficient depends.

    Attributes:
        viscosity_m2_s: Kinematic viscosity, m²/s.
        conductivity_W_mK: Heat conductivity, W/mK.
        prandtl: Prandtl number.
        expansion_1_K: Thermal expansion 1/T, 1/K.
    """

    viscosity_m2_s: float
    conductivity_W_mK: float
    prandtl: float
    expansion_1_K: float


def air_at(temperature_degC: float) -> Air:
    """Return dry air at one atmosphere and a temperature, within 1 % from −50 to 150 °C.

    Viscosity is by Sutherland's law, conductivity by the formula of the US Standard Atmosphere (1976, eqs. 51
    and 53). The density is that of the ideal gas. The specific heat is 1005.7 J/(kg K) at 20 °C and rises
    with the square of the distance from −13 °C.

    Args:
        temperature_degC: The temperature, °C.
    """
    T = temperature_degC + ZERO_DEGC_K
    dynamic_Pa_s = 1.458e-6 * T**1.5 / (T + 110.4)
    conductivity = 2.64638e-3 * T**1.5 / (T + 245.4 * 10.0 ** (-12.0 / T))
    density = _PRESSURE_PA / (_GAS_CONSTANT_J_kgK * T)
    specific_heat = 1005.3 + 4.0e-4 * (T - 260.0) ** 2
    return Air(dynamic_Pa_s / density, conductivity, dynamic_Pa_s * specific_heat / conductivity, 1.0 / T)


YU_AIR = Air(viscosity_m2_s=15.5e-6, conductivity_W_mK=2.54e-2, prandtl=0.72, expansion_1_K=1 / 273)
"""Air at 25 °C as Yu et al. 2024 print it, §3.1.3."""


def rotating_nusselt(reynolds: FloatArray, prandtl: float) -> FloatArray:
    """Return Nu = 0.133 Re^{2/3} Pr^{1/3} of a cylinder that turns in still air, Re = ω d²/ν.

    Holds for Re < 4.3e5 and 0.7 < Pr < 670 (Yu et al. 2024, §3.1.3, after Becker 1963).

    Args:
        reynolds: Re on the diameter, any shape, not negative.
        prandtl: Prandtl number of the air.
    """
    return np.asarray(0.133 * np.cbrt(reynolds) ** 2 * prandtl ** (1 / 3))


def rotating_nusselt_kendoush(reynolds: FloatArray, prandtl: float) -> FloatArray:
    """Return Nu = 0.6366 (Re Pr)^{1/2} of a turning cylinder (Lathe, eq. 8, after Kendoush 1996).

    Args:
        reynolds: Re on the diameter, any shape, not negative.
        prandtl: Prandtl number of the air.
    """
    return np.asarray(0.6366 * np.sqrt(reynolds * prandtl))


def rotating_reynolds(speed_rpm: FloatArray, diameter_m: float, air: Air) -> FloatArray:
    """Return Re = ω d²/ν (Yu et al. 2024, §3.1.3).

    Args:
        speed_rpm: Speed of either sense, rpm, any shape.
        diameter_m: Diameter of the cylinder, m.
        air: The air; its kinematic viscosity counts.
    """
    return np.asarray(np.abs(speed_rpm) * RAD_S_PER_RPM * diameter_m**2 / air.viscosity_m2_s)


def rayleigh(length_m: float, rise_K: float, air: Air) -> float:
    """Return Ra = Gr Pr = g β |ΔT| l³ Pr/ν² with β = 1/T of the film (Yu et al. 2024, §3.1.3).

    Args:
        length_m: Characteristic length l, m: a diameter or the height of a wall.
        rise_K: Temperature of the surface above the air, K, of either sign.
        air: The air halfway between surface and surroundings.
    """
    grashof = GRAVITY_M_S2 * air.expansion_1_K * abs(rise_K) * length_m**3 / air.viscosity_m2_s**2
    return grashof * air.prandtl


class WallRange(NamedTuple):
    """One line of the table of natural convection: Nu = C Ra^n.

    Attributes:
        C: Factor.
        n: Exponent.
        low: Lowest Rayleigh number of the line.
        high: Highest one.
    """

    C: float
    n: float
    low: float
    high: float


WALLS: dict[str, tuple[WallRange, ...]] = {
    "vertical": (WallRange(0.59, 1 / 4, 1e4, 1e9), WallRange(0.12, 1 / 3, 1e9, 1e12)),
    "up": (WallRange(0.54, 1 / 4, 1e5, 2e7), WallRange(0.14, 1 / 3, 2e7, 3e10)),
    "down": (WallRange(0.27, 1 / 4, 3e5, 3e10),),
}
"""Yu et al. 2024, table 3, by where a warm wall faces. The print has 0.54 for a wall that faces down; that is
the value of one that faces up (McAdams 1954), as its own range and the second line for "down" show."""


def wall_nusselt(orientation: str, rayleigh_number: float) -> float:
    """Return Nu = C Ra^n of a warm wall, "vertical", or horizontal and facing "up" or "down".

    Outside the table the nearest line holds on. Source: Yu et al. 2024, table 3; McAdams 1954.

    Args:
        orientation: `"vertical"`, `"up"` or `"down"`.
        rayleigh_number: Ra on the wall's height, or on the short side of a horizontal one.

    Raises:
        KeyError: If the orientation is another.
    """
    lines = WALLS[orientation]
    line = next((one for one in lines if rayleigh_number < one.high), lines[-1])
    return float(line.C * rayleigh_number**line.n)


def horizontal_cylinder_nusselt(rayleigh_number: float, prandtl: float) -> float:
    """Return the mean Nu of a long horizontal cylinder in still air, for Ra < 1e12.

    Nu = {0.60 + 0.387 Ra^{1/6}/[1 + (0.559/Pr)^{9/16}]^{8/27}}² (Churchill and Chu 1975). Lathe, eq. 9,
    prints it without the square, which would leave a quarter of it.
    """
    shape = (1.0 + (0.559 / prandtl) ** (9 / 16)) ** (8 / 27)
    return float((0.60 + 0.387 * rayleigh_number ** (1 / 6) / shape) ** 2)


def taylor_number(speed_rpm: FloatArray, radius_m: float, gap_m: float, air: Air) -> FloatArray:
    """Return Ta²/F_g of the gap between a turning shaft and a tube around it, (k,).

    Ta² = ω² r_m gap³/ν² with the mean radius r_m, and F_g, near 1 for a narrow gap, from the ratio of gap to
    mean radius s: F_g = π⁴/1697 (1 − s/2)^{−2} P^{−1}, P = 0.0571 Y + 0.00056/Y, Y = 1 − 0.652 s/(1 − s/2).
    Source: Becker and Kaye 1962; Childs and Long 1996, §4.

    Args:
        speed_rpm: Speed of the shaft, rpm, (k,); the tube stands still.
        radius_m: Radius of the shaft, m.
        gap_m: Distance between shaft and tube, m.
        air: The air in the gap.
    """
    mean_m = radius_m + gap_m / 2
    s = gap_m / mean_m
    Y = 1.0 - 0.652 * s / (1.0 - s / 2)
    geometry = math.pi**4 / 1697 / (1.0 - s / 2) ** 2 / (0.0571 * Y + 0.00056 / Y)
    omega = np.abs(speed_rpm) * RAD_S_PER_RPM
    return np.asarray(omega**2 * mean_m * gap_m**3 / air.viscosity_m2_s**2 / geometry)


def taylor_nusselt(taylor: FloatArray) -> FloatArray:
    """Return Nu, on twice the gap, of the flow between a turning shaft and a tube, from Ta²/F_g (k,).

    2 below 1700 (conduction), 0.128 (Ta²/F_g)^{0.367} to 1e4 and 0.409 (Ta²/F_g)^{0.241} to 1e7 (Becker and
    Kaye 1962; Lathe, eq. 10, where the print has a plus for the product). The three meet within 2 %.
    """
    middle, high = 0.128 * taylor**0.367, 0.409 * taylor**0.241
    return np.asarray(np.where(taylor < 1700.0, 2.0, np.where(taylor < 1e4, middle, high)))


def film_W_m2K(nusselt: FloatArray | float, length_m: float, air: Air) -> FloatArray:
    """Return h = Nu k_air/l (Lathe, eq. 7).

    Args:
        nusselt: Nusselt number, any shape.
        length_m: Length l on which it is based, m.
        air: The air; its conductivity counts.
    """
    return np.asarray(nusselt * air.conductivity_W_mK / length_m)


def thread_factor(
    lead_m: float, diameter_m: float, ball_radius_m: float, land_m: float, fin_efficiency: float | None = None
) -> float:
    """Return how much more a threaded screw loses than the cylinder of its diameter.

    √(1 + (p/π D)²) (π r_b + b)/p: what groove (a half circle of the ball's radius) and land b measure along
    the helix, over the pitch. With a fin efficiency E, 1 + E × that, the screw as a finned surface. Source:
    Kuznetsov 2021, eqs. 4 and 5 (shape factor 1).

    Args:
        lead_m: Pitch p of the thread, m.
        diameter_m: Diameter D of the cylinder, m.
        ball_radius_m: Radius r_b of the groove, m.
        land_m: Width b of the land between two grooves, m.
        fin_efficiency: Efficiency E of the thread as fins, 0 to 1. None takes the whole surface at one
            temperature.
    """
    helix = math.sqrt(1.0 + (lead_m / (math.pi * diameter_m)) ** 2)
    surface = helix * (math.pi * ball_radius_m + land_m) / lead_m
    return surface if fin_efficiency is None else 1.0 + fin_efficiency * surface


def radiation_film_W_m2K(emissivity: float, ambient_degC: float, rise_K: float) -> float:
    """Return the film coefficient of a grey surface's radiation: ε σ (T_s + T_a)(T_s² + T_a²).

    At a rise of zero this is the tangent 4 ε σ T_a³ of the grey body's loss (Lathe, eq. 4).

    Args:
        emissivity: ε of the surface, 0 to 1.
        ambient_degC: Temperature of the surroundings, °C.
        rise_K: Temperature of the surface above them, K, of either sign.
    """
    cold = ambient_degC + ZERO_DEGC_K
    hot = cold + rise_K
    return emissivity * STEFAN_BOLTZMANN_W_m2K4 * (hot + cold) * (hot**2 + cold**2)


BIOT_LIMIT = 0.1
"""Below it a body is nearly as warm inside as at its surface."""


def biot(film_W_m2K: float, size_m: float, conductivity_W_mK: float) -> float:
    """Return h L/k of a body of the size L: what a film takes over what conduction brings to it.

    Source: Kuznetsov (2021), section 2. His table 1 gives the size at which it is 0.1, L = 0.1 k/h; its
    1.36 m at 4 W/m²K and 55 W/mK should be 1.38, and its 0.14 m at 12 and 15 should be 0.13.

    Args:
        film_W_m2K: Film coefficient h.
        size_m: Size L of the body, m, such as its volume over its surface.
        conductivity_W_mK: Conductivity k of the body.
    """
    return film_W_m2K * size_m / conductivity_W_mK
