"""What a link lets pass, W/K, by geometry and material."""

from __future__ import annotations

import math

from observer.tables.nodes import Link


def conductance_W_K(link: Link) -> float:
    """Return the conductance of a link of the configuration, whichever way it is told."""
    given_W_K = link.conductance_W_K or 1.0 / (link.resistance_K_W or math.inf)
    if given_W_K:
        return given_W_K
    area_m2, length_m, k_W_mK = link.area_m2 or 0.0, link.length_m or 0.0, link.conductivity_W_mK or 0.0
    if link.film_W_m2K is not None:
        return film_W_K(link.film_W_m2K, area_m2)
    if link.inner_diameter_m is not None and link.outer_diameter_m is not None:
        return ring_W_K(k_W_mK, length_m, link.inner_diameter_m, link.outer_diameter_m)
    pair = link.conductivities_W_mK or (0.0, 0.0)
    if link.balls is not None and link.semi_axes_m is not None:
        return link.balls * ball_W_K(*pair, *link.semi_axes_m)
    if link.gap_m is not None:
        return gap_W_K(link.gap_m, area_m2, link.touching or 0.0, *pair, link.filling_W_mK)
    return bar_W_K(k_W_mK, length_m, area_m2)


def bar_W_K(conductivity_W_mK: float, length_m: float, area_m2: float) -> float:
    """Return k A/l (Li 2022, eqs. 1 and 3; Yu et al. 2024, §3.1.2)."""
    return conductivity_W_mK * area_m2 / length_m


def ring_W_K(conductivity_W_mK: float, width_m: float, inner_m: float, outer_m: float) -> float:
    """Return 2π k b/ln(d_o/d_i), radially through a ring (Li 2022, eqs. 1 and 2; Yu et al. 2024, §3.1.2)."""
    return 2.0 * math.pi * conductivity_W_mK * width_m / math.log(outer_m / inner_m)


def film_W_K(film_W_m2K: float, area_m2: float) -> float:
    """Return h A of a film, or of a contact whose conductance per area is known (Li 2022, eq. 7)."""
    return film_W_m2K * area_m2


def gap_W_K(
    gap_m: float, area_m2: float, touching: float, first_W_mK: float, second_W_mK: float, filling_W_mK: float
) -> float:
    """Return A [s k* + (1 − s) k_f]/g of two rough faces, k* = 2 k₁ k₂/(k₁ + k₂).

    A part s of the area touches across the gap g, the rest is filled. Source: Li 2022, eq. 6, and with an
    empty gap, k_f = 0, eq. 5.
    """
    harmonic = 2.0 * first_W_mK * second_W_mK / (first_W_mK + second_W_mK)
    return area_m2 * (touching * harmonic + (1.0 - touching) * filling_W_mK) / gap_m


def ball_W_K(ball_W_mK: float, ring_W_mK: float, long_m: float, short_m: float) -> float:
    """Return what one contact between a ball and a ring lets pass, a constriction on both sides.

    R = K/(2π a k_b) + K/(2π a k_r) with the complete elliptic integral K of modulus² 1 − b²/a², a the longer
    semi-axis of the contact ellipse. For a circle R = (1/k_b + 1/k_r)/(4 a). Source: Li 2022, eq. 4, where
    a²/b² stands in the modulus, which makes the resistance b/a times as large.
    """
    from scipy.special import ellipk  # noqa: PLC0415  (start-up: only balls need it)

    a, b = max(long_m, short_m), min(long_m, short_m)
    integral = float(ellipk(1.0 - (b / a) ** 2))
    return 2.0 * math.pi * a / (integral * (1.0 / ball_W_mK + 1.0 / ring_W_mK))
