"""The library: every effect that a configuration may name and a search may find."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from observer.effects.base import EffectTable
from observer.effects.bodies import AttachedMass, EndConduction
from observer.effects.film import (
    AmbientDrift,
    Coolant,
    RadiationEffect,
    SpeedConvection,
    SurfaceConvection,
    UnevenConvection,
)
from observer.effects.heat import Dwell, EndHeat, FrictionFade, FrictionSpeed, LocalHeat, MotorHeat, RunIn
from observer.effects.sensing import SensorBias, SensorDrift, SensorLag

Effect = Annotated[
    SurfaceConvection
    | SpeedConvection
    | UnevenConvection
    | RadiationEffect
    | EndConduction
    | AttachedMass
    | EndHeat
    | MotorHeat
    | FrictionFade
    | FrictionSpeed
    | RunIn
    | Dwell
    | LocalHeat
    | AmbientDrift
    | Coolant
    | SensorLag
    | SensorBias
    | SensorDrift,
    Field(discriminator="kind"),
]

LIBRARY: tuple[type[EffectTable], ...] = (
    SurfaceConvection,
    SpeedConvection,
    UnevenConvection,
    RadiationEffect,
    EndConduction,
    AttachedMass,
    EndHeat,
    MotorHeat,
    FrictionFade,
    FrictionSpeed,
    RunIn,
    Dwell,
    LocalHeat,
    AmbientDrift,
    Coolant,
    SensorLag,
    SensorBias,
    SensorDrift,
)

KINDS: tuple[str, ...] = tuple(effect.model_fields["kind"].annotation.__args__[0] for effect in LIBRARY)  # type: ignore[union-attr]
