"""The library: every effect that a configuration may name and a search may find, a line each."""

from __future__ import annotations

from typing import Annotated, get_args

from pydantic import Field

from observer.effects import bodies, film, heat, sensing
from observer.effects.base import EffectTable

Effect = Annotated[
    film.SurfaceConvection
    | film.SpeedConvection
    | film.UnevenConvection
    | film.RadiationEffect
    | bodies.EndConduction
    | bodies.AttachedMass
    | heat.EndHeat
    | heat.MotorHeat
    | heat.FrictionFade
    | heat.FrictionSpeed
    | heat.RunIn
    | heat.Dwell
    | heat.LocalHeat
    | film.AmbientDrift
    | film.Coolant
    | sensing.SensorLag
    | sensing.SensorBias
    | sensing.SensorDrift,
    Field(discriminator="kind"),
]
BY_KIND: dict[str, type[EffectTable]] = {effect.named(): effect for effect in get_args(get_args(Effect)[0])}
LIBRARY = tuple(BY_KIND.values())
KINDS = tuple(BY_KIND)


def offset_of(sensor: str, offset_K: float) -> EffectTable:
    """Return the effect that says what a sensor reads too much."""
    return sensing.SensorBias(kind="sensor_bias", target=sensor, offset_K=offset_K)
