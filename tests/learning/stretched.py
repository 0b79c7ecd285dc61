"""A rough machine whose screw is pre-stretched between two supports: its axial force, true and found."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from observer.frames import EstimateBlock, FloatArray
from tests.learning.cover import estimates
from tests.learning.machines import CONFIG, Rough, config_of, day, draw

LENGTH_M, DIAMETER_M, MODULUS_Pa, STIFFNESS_N_m = 1.0, 0.036, 2.06e11, 5e7
STRETCHED = {
    "stretched by 8 kN": (8000.0, 0.0),
    "stretched by 3 kN, then 30 µm of play": (3000.0, 30e-6),
}
"""Pre-tension in N and gap in m, by words."""


class Stretched(NamedTuple):
    """Hours, the true axial force (K,), the true error (K,) at the far end, µm, and what was found."""

    hours: FloatArray
    force_N: FloatArray
    error_um: FloatArray
    found: EstimateBlock


def stretched(seed: int, number: int, supports: tuple[float, float]) -> Stretched:
    """Run a rough machine; its screw is held by a rigid support and an elastic one.

    The truth is a chain of springs by hand: screw and second support give way to what the free screw grows.
    """
    preload_N, gap_m = supports
    one = day(draw(seed, number, Rough()), seed, number, "a")
    give_m_N = LENGTH_M / (MODULUS_Pa * np.pi / 4.0 * DIAMETER_M**2) + 1.0 / STIFFNESS_N_m
    growth_m = 1e-6 * one.error_um[:, -1]
    pulled_N = np.maximum(preload_N - growth_m / give_m_N, 0.0)
    pushed_N = np.maximum(growth_m - preload_N * give_m_N - gap_m, 0.0) / give_m_N
    force_N = np.where(gap_m > 0.0, pulled_N - pushed_N, preload_N - growth_m / give_m_N)
    error_um = 1e6 * (preload_N - force_N) / STIFFNESS_N_m
    # in the gap the end is free: what the springs do not hold back moves it
    error_um += np.where(gap_m > 0.0, 1e6 * (growth_m - (preload_N - force_N) * give_m_N), 0.0)
    text = CONFIG + (
        f'\n[supports]\nmounting = "L-III"\nelastic_modulus_Pa = {MODULUS_Pa}\npreload_N = {preload_N}\n'
        f"gap_m = {gap_m}\nstiffness_second_N_m = {STIFFNESS_N_m}\n"
    )
    return Stretched(one.time_s / 3600.0, force_N, error_um, estimates(config_of(text), one))
