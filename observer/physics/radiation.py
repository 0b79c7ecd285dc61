"""Heat radiated by a grey surface into surroundings that are large against it."""

from __future__ import annotations

from observer.physics.constants import ZERO_DEGC_K, STEFAN_BOLTZMANN_W_m2K4


def radiation_film_W_m2K(emissivity: float, ambient_degC: float, rise_K: float = 0.0) -> float:
    """Return the film that loses as much as radiation at a rise: ε σ (T_s + T_a)(T_s² + T_a²).

    At a rise of zero this is the tangent 4 ε σ T_a³ of the grey body's loss (Lathe, eq. 4).
    """
    cold = ambient_degC + ZERO_DEGC_K
    hot = cold + rise_K
    return emissivity * STEFAN_BOLTZMANN_W_m2K4 * (hot + cold) * (hot**2 + cold**2)
