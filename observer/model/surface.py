"""The film of the screw's surface, from the configuration's number or law."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from observer.frames import FloatArray
from observer.physics import film
from observer.physics.air import Air, air_at
from observer.tables.laws import Surface

SpeedFilm = Callable[[FloatArray], FloatArray]


def surface_film_W_m2K(surface: Surface, diameter_m: float) -> float:
    """Return the base film: the number given, or convection and radiation by the law.

    Radiation and natural convection are taken at the rise `rise_K`, turning at the speed `speed_rpm`; with
    speed 0 this is the film at standstill, to which a speed channel then adds `turning_film`. The practice
    factor and the thread multiply convection only.
    """
    if surface.law is None:
        return surface.convection_W_m2K
    turning = turning_film(surface, diameter_m)
    still = _still_W_m2K(surface, diameter_m)
    if turning is not None:
        still += float(turning(np.array([surface.speed_rpm]))[0])
    return still + film.radiation_film_W_m2K(surface.emissivity, surface.air_degC, surface.rise_K)


def turning_film(surface: Surface, diameter_m: float) -> SpeedFilm | None:
    """Return what turning adds to the film at standstill, W/(m² K) from speeds in rpm; None where nothing.

    A cylinder in free air adds its own film; in a tube it adds what the vortices carry beyond conduction
    through the gap.
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
