"""Constants of nature and of units, each here and nowhere else."""

from __future__ import annotations

import math

GRAVITY_M_S2 = 9.80665
STEFAN_BOLTZMANN_W_m2K4 = 5.670374419e-8
"""CODATA 2018."""
ZERO_DEGC_K = 273.15
RAD_S_PER_RPM = math.pi / 30
RPM_IN = {
    "rad/s": 1.0 / RAD_S_PER_RPM,
    "revolutions a second": 60.0,
    "degrees a second": 1.0 / 6.0,
    "revolutions an hour": 1.0 / 60.0,
}
"""The factor from a speed in another unit to rpm."""
