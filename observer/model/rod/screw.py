"""The screw as a one-dimensional rod: what of its geometry and material the heat equation sees.

rho c A ∂T/∂t = k A ∂²T/∂x² − h P (T − T_amb) + Σ_j q_j w_j(x, t)        (Kim et al., eq. 1, per watt)
"""

from __future__ import annotations

import math
from typing import NamedTuple

from observer.config import Config
from observer.model.surface import surface_film_W_m2K
from observer.tables.sections import Boundary


class End(NamedTuple):
    """One end of the rod: `biot_1_m` = h_end / k; 0 is insulated, infinity is a prescribed temperature."""

    biot_1_m: float

    @property
    def prescribed(self) -> bool:
        """Whether the end's temperature is given."""
        return math.isinf(self.biot_1_m)

    @property
    def insulated(self) -> bool:
        """Whether no heat passes the end."""
        return self.biot_1_m == 0.0


class Rod(NamedTuple):
    """A uniform rod with a film on its lateral surface.

    `diffusivity_m2_s` is α = k/(ρ c); `conductance_W_m` is k A; `fin_1_m` is m = √(h P/(k A)), zero without a
    film.
    """

    length_m: float
    diffusivity_m2_s: float
    conductance_W_m: float
    fin_1_m: float
    left: End
    right: End

    @property
    def floating(self) -> bool:
        """Whether no heat can leave, both ends insulated and no film, so that the mean temperature drifts."""
        return self.left.insulated and self.right.insulated and self.fin_1_m == 0.0


def rod_of(config: Config) -> Rod:
    """Return the rod that a configuration describes."""
    screw = config.screw
    k_W_mK, d_m = screw.conductivity_W_mK, screw.diameter_m
    film_W_m2K = surface_film_W_m2K(config.surface, d_m)
    area_m2, perimeter_m = math.pi * d_m**2 / 4, math.pi * d_m
    return Rod(
        length_m=screw.length_m,
        diffusivity_m2_s=k_W_mK / (screw.density_kg_m3 * screw.specific_heat_J_kgK),
        conductance_W_m=k_W_mK * area_m2,
        fin_1_m=math.sqrt(film_W_m2K * perimeter_m / (k_W_mK * area_m2)),
        left=_end(config.boundary.left, k_W_mK),
        right=_end(config.boundary.right, k_W_mK),
    )


def _end(boundary: Boundary, k_W_mK: float) -> End:
    if boundary.kind == "prescribed":
        return End(math.inf)
    return End((boundary.coefficient_W_m2K or 0.0) / k_W_mK)
