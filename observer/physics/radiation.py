"""Heat radiated by a grey surface into surroundings that are large against it."""

from __future__ import annotations

import numpy as np

from observer.frames import FloatArray
from observer.physics.constants import ZERO_DEGC_K, STEFAN_BOLTZMANN_W_m2K4


def radiation_W_m2(
    emissivity: float, surface_degC: FloatArray | float, ambient_degC: FloatArray | float
) -> FloatArray:
    """Return the grey body's loss ε σ (T_s⁴ − T_a⁴), exact (Lathe, eq. 4)."""
    hot, cold = np.asarray(surface_degC) + ZERO_DEGC_K, np.asarray(ambient_degC) + ZERO_DEGC_K
    return np.asarray(emissivity * STEFAN_BOLTZMANN_W_m2K4 * (hot**4 - cold**4))


def radiation_film_W_m2K(emissivity: float, ambient_degC: float, rise_K: float = 0.0) -> float:
    """Return the film that loses as much as radiation at a rise: ε σ (T_s + T_a)(T_s² + T_a²).

    At a rise of zero this is the tangent 4 ε σ T_a³.
    """
    cold = ambient_degC + ZERO_DEGC_K
    hot = cold + rise_K
    return emissivity * STEFAN_BOLTZMANN_W_m2K4 * (hot + cold) * (hot**2 + cold**2)
