"""Dry air at one atmosphere."""

from __future__ import annotations

from typing import NamedTuple

from observer.physics.constants import ZERO_DEGC_K

_PRESSURE_PA = 101_325.0
_GAS_CONSTANT_J_kgK = 287.058


class Air(NamedTuple):
    """What of the air a film coefficient depends on; `viscosity_m2_s` is kinematic, `expansion_1_K` = 1/T."""

    viscosity_m2_s: float
    conductivity_W_mK: float
    prandtl: float
    expansion_1_K: float


def air_at(temperature_degC: float) -> Air:
    """Return dry air at one atmosphere and a temperature, within 1 % from −50 to 150 °C.

    Viscosity by Sutherland's law and conductivity by the formula of the US Standard Atmosphere (1976, eqs.
    51 and 53), density of the ideal gas, specific heat 1005.7 J/(kg K) at 20 °C, rising with the square of
    the distance from −13 °C.
    """
    T = temperature_degC + ZERO_DEGC_K
    dynamic_Pa_s = 1.458e-6 * T**1.5 / (T + 110.4)
    conductivity = 2.64638e-3 * T**1.5 / (T + 245.4 * 10.0 ** (-12.0 / T))
    density = _PRESSURE_PA / (_GAS_CONSTANT_J_kgK * T)
    specific_heat = 1005.3 + 4.0e-4 * (T - 260.0) ** 2
    return Air(dynamic_Pa_s / density, conductivity, dynamic_Pa_s * specific_heat / conductivity, 1.0 / T)


YU_AIR = Air(viscosity_m2_s=15.5e-6, conductivity_W_mK=2.54e-2, prandtl=0.72, expansion_1_K=1 / 273)
"""Air at 25 °C as Yu et al. 2024 print it, §3.1.3."""
