"""The screw as a one-dimensional rod: its geometry, material and film in the heat equation.

rho c A ∂T/∂t = k A ∂²T/∂x² − h P (T − T_amb) + Σ_j q_j w_j(x, t)        (Kim et al., eq. 1, per watt)

If sections differ, A and P depend on the place, and k A ∂²T/∂x² is ∂(k A ∂T/∂x)/∂x.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from observer.config.laws import Surface
from observer.config.machine import Config
from observer.config.screw import Screw
from observer.config.sections import Boundary
from observer.frames import FloatArray
from observer.physics import film
from observer.physics.film import Air, air_at

SpeedFilm = Callable[[FloatArray], FloatArray]


def surface_film_W_m2K(surface: Surface, diameter_m: float) -> float:
    """Return the base film: the number given, or convection and radiation by the law, W/m²K.

    Radiation and natural convection are those at the rise `rise_K`, turning at the speed `speed_rpm`. With
    speed 0 this is the film at standstill; a speed channel then adds `turning_film`. The practice factor and
    the thread multiply convection only.

    Args:
        surface: The table `[surface]`.
        diameter_m: Outer diameter of the screw, m.
    """
    if surface.law is None:
        return surface.convection_W_m2K
    turning = turning_film(surface, diameter_m)
    still = _still_W_m2K(surface, diameter_m)
    if turning is not None:
        still += float(turning(np.array([surface.speed_rpm]))[0])
    return still + film.radiation_film_W_m2K(surface.emissivity, surface.air_degC, surface.rise_K)


def turning_film(surface: Surface, diameter_m: float) -> SpeedFilm | None:
    """Return the additional film of a turning screw.

    A cylinder in free air adds its own film. A screw in a tube adds the transport of the vortices beyond
    conduction through the air gap.

    Args:
        surface: The table `[surface]`.
        diameter_m: Outer diameter of the screw, m.

    Returns:
        A function from speeds, rpm, to films, W/m²K; None if the law has no rotation.
    """
    air, raised = _air(surface), _raised(surface, diameter_m)
    if surface.law in ("rotating-cylinder", "kendoush"):
        becker = surface.law == "rotating-cylinder"
        nusselt = film.rotating_nusselt if becker else film.rotating_nusselt_kendoush

        def in_air(speed_rpm: FloatArray) -> FloatArray:
            reynolds = film.rotating_reynolds(speed_rpm, diameter_m, air)
            return raised * film.film_W_m2K(nusselt(reynolds, air.prandtl), diameter_m, air)

        return in_air
    if surface.law == "taylor-gap":
        gap_m = surface.gap_m or 0.0

        def in_tube(speed_rpm: FloatArray) -> FloatArray:
            taylor = film.taylor_number(speed_rpm, diameter_m / 2, gap_m, air)
            return raised * film.film_W_m2K(film.taylor_nusselt(taylor) - 2.0, 2.0 * gap_m, air)

        return in_tube
    return None


def _still_W_m2K(surface: Surface, diameter_m: float) -> float:
    """Convection of the screw at rest."""
    air = _air(surface)
    if surface.law == "taylor-gap":
        nusselt, length_m = 2.0, 2.0 * (surface.gap_m or 0.0)
    elif surface.law == "wall":
        length_m = surface.height_m or 0.0
        nusselt = film.wall_nusselt(
            surface.facing or "vertical", film.rayleigh(length_m, surface.rise_K, air)
        )
    else:
        length_m = diameter_m
        number = film.rayleigh(length_m, surface.rise_K, air)
        nusselt = film.horizontal_cylinder_nusselt(number, air.prandtl)
    return float(_raised(surface, diameter_m) * film.film_W_m2K(nusselt, length_m, air))


def _air(surface: Surface) -> Air:
    """The air halfway between surface and surroundings."""
    return air_at(surface.air_degC + surface.rise_K / 2)


def _raised(surface: Surface, diameter_m: float) -> float:
    """The practice factor times the thread's."""
    if surface.thread_lead_m is None:
        return surface.factor
    return surface.factor * film.thread_factor(
        surface.thread_lead_m,
        diameter_m,
        surface.ball_radius_m or 0.0,
        surface.land_m or 0.0,
        surface.fin_efficiency,
    )


class End(NamedTuple):
    """One end of the rod.

    Attributes:
        biot_1_m: H = h_end / k, 1/m; 0 is insulated, infinity is a prescribed temperature.
    """

    biot_1_m: float

    @property
    def prescribed(self) -> bool:
        """Whether the end's temperature is given."""
        return math.isinf(self.biot_1_m)

    @property
    def insulated(self) -> bool:
        """Whether no heat passes the end."""
        return self.biot_1_m == 0.0


class Profile(NamedTuple):
    """The sections of a screw that is not uniform.

    Attributes:
        edges_m: Their edges, (S + 1,).
        area: Cross-section as a multiple of that of the screw's own diameter and bore, (S,).
        perimeter: Perimeter likewise, (S,).
    """

    edges_m: tuple[float, ...]
    area: tuple[float, ...]
    perimeter: tuple[float, ...]

    def at(self, values: tuple[float, ...], x_m: FloatArray) -> FloatArray:
        """Return the values of the sections in which places lie, (k,).

        Args:
            values: A value of each section, (S,).
            x_m: Positions, m, (k,); an edge belongs to the section to its right.
        """
        return np.asarray(values)[np.searchsorted(self.edges_m[1:-1], x_m, side="right")]


class Rod(NamedTuple):
    """A rod with a film on its lateral surface.

    Attributes:
        length_m: Its length.
        diffusivity_m2_s: α = k/(ρ c).
        conductance_W_m: k A.
        fin_1_m: m = √(h P/(k A)), zero without a film.
        left: Its left end.
        right: Its right end.
        profile: A and P of the sections; None for a uniform rod.
    """

    length_m: float
    diffusivity_m2_s: float
    conductance_W_m: float
    fin_1_m: float
    left: End
    right: End
    profile: Profile | None = None

    @property
    def edges_m(self) -> tuple[float, ...]:
        """Edges between sections, m; none for a uniform rod."""
        return () if self.profile is None else self.profile.edges_m[1:-1]

    @property
    def storage_m(self) -> float:
        """Length of a rod of the cross-section A that stores as much, m."""
        if self.profile is None:
            return self.length_m
        return float(np.diff(self.profile.edges_m) @ self.profile.area)

    def wetted_m(self, from_m: float, to_m: float) -> float:
        """Return the length of a rod of the perimeter P with the surface of a stretch, m.

        Args:
            from_m: Beginning of the stretch, m.
            to_m: Its end, m.
        """
        if self.profile is None:
            return to_m - from_m
        inside = np.clip(self.profile.edges_m, from_m, to_m)
        return float(np.diff(inside) @ self.profile.perimeter)

    def area_at(self, x_m: FloatArray) -> FloatArray | float:
        """Return the cross-section at places (k,), as a multiple of A."""
        return 1.0 if self.profile is None else self.profile.at(self.profile.area, x_m)

    def perimeter_at(self, x_m: FloatArray) -> FloatArray | float:
        """Return the perimeter at places (k,), as a multiple of P."""
        return 1.0 if self.profile is None else self.profile.at(self.profile.perimeter, x_m)

    @property
    def floating(self) -> bool:
        """Whether no heat can leave, both ends insulated and no film, so that the mean temperature drifts."""
        return self.left.insulated and self.right.insulated and self.fin_1_m == 0.0


def rod_of(config: Config) -> Rod:
    """Return the rod that a configuration describes."""
    screw = config.screw
    k_W_mK, d_m = screw.conductivity_W_mK, screw.diameter_m
    film_W_m2K = surface_film_W_m2K(config.surface, d_m)
    area_m2, perimeter_m = screw.area_m2, math.pi * d_m
    return Rod(
        length_m=screw.length_m,
        diffusivity_m2_s=k_W_mK / (screw.density_kg_m3 * screw.specific_heat_J_kgK),
        conductance_W_m=k_W_mK * area_m2,
        fin_1_m=math.sqrt(film_W_m2K * perimeter_m / (k_W_mK * area_m2)),
        left=_end(config.boundary.left, k_W_mK, screw.pieces[0].area_m2 / area_m2),
        right=_end(config.boundary.right, k_W_mK, screw.pieces[-1].area_m2 / area_m2),
        profile=None if screw.uniform else _profile(screw),
    )


def _end(boundary: Boundary, k_W_mK: float, area: float) -> End:
    """An end with a cross-section of `area` times the screw's; its loss is proportional to that."""
    if boundary.kind == "prescribed":
        return End(math.inf)
    return End(area * ((boundary.coefficient_W_m2K or 0.0) / k_W_mK))


def _profile(screw: Screw) -> Profile:
    return Profile(
        edges_m=(0.0, *(p.to_m for p in screw.pieces)),
        area=tuple(p.area_m2 / screw.area_m2 for p in screw.pieces),
        perimeter=tuple(p.diameter_m / screw.diameter_m for p in screw.pieces),
    )


def biot_number(screw: Screw, film_W_m2K: float) -> float:
    """Return h (V/S)/k, the loss of a film relative to the conduction in the section.

    V/S is d/4 of a solid screw, and the largest of the sections. Below 0.1 the temperature across a body is
    nearly uniform (Incropera & DeWitt 2007, eq. 5.10).

    Args:
        screw: Its diameters and conductivity.
        film_W_m2K: The film coefficient.
    """
    volume_m = max(piece.area_m2 / (math.pi * piece.diameter_m) for piece in screw.pieces)
    return film.biot(film_W_m2K, volume_m, screw.conductivity_W_mK)


def surface_rate(screw: Screw) -> float:
    """Return P/(ρ c A): the rate of loss per film coefficient, 1/s per W/m²K; 4/(ρ c d) of a solid screw.

    Diameter and bore are the screw's own, without its sections.
    """
    solid = 4 / (screw.density_kg_m3 * screw.specific_heat_J_kgK * screw.diameter_m)
    return solid / (1.0 - (screw.bore_m / screw.diameter_m) ** 2)
