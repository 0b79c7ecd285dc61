"""Effects of the surface: films, radiation, coolant, and the air itself."""

from __future__ import annotations

import math
from typing import Annotated, Literal

import numpy as np
from pydantic import Field, model_validator

from observer.effects.base import EffectTable, on_screw, speed_channel
from observer.effects.terms import AmbientShift, Film, Radiation, SpeedLoss, StretchFilm, Term
from observer.errors import ConfigError
from observer.frames import FloatArray
from observer.tables.quantities import Channel, Finite, NonNegative, Temperature
from observer.tables.sections import Description

# Air at 25 °C, as Yu et al. take it.
AIR_CONDUCTIVITY_W_MK = 0.0254
AIR_VISCOSITY_M2_S = 15.5e-6
AIR_PRANDTL = 0.72
RAD_S_PER_RPM = math.pi / 30


class SurfaceConvection(EffectTable):
    """A surface loss where none is modelled: h = coefficient."""

    kind: Literal["surface_convection"]
    coefficient_W_m2K: Annotated[Finite, Field(ge=0, le=500)]

    parameters = ("coefficient_W_m2K",)
    excitation = "a screw that is warmer than the air, heating and cooling"
    source = "Newton's law of cooling; Kim et al., eq. 1"

    def terms(self, machine: Description) -> tuple[Term, ...]:
        return (Film(self.coefficient_W_m2K),)


class SpeedConvection(EffectTable):
    """A film coefficient that grows with rotation, h = gain · 0.133 Re^{2/3} Pr^{1/3} λ/d."""

    kind: Literal["speed_convection"]
    gain: Annotated[Finite, Field(ge=0, le=10)]
    speed_channel: Channel | None = None

    parameters = ("gain",)
    excitation = "two speeds or more at which the screw is warm"
    source = "Yu et al., rotating cylinder; Kendoush 1996"

    def terms(self, machine: Description) -> tuple[Term, ...]:
        if machine.surface.turns:
            raise ConfigError(
                f'effect "{self.kind}": surface.law already tells what turning adds to the film; remove the '
                "effect, or the speed from [surface]"
            )
        d_m, gain = machine.screw.diameter_m, self.gain

        def film_W_m2K(speed_rpm: FloatArray) -> FloatArray:
            return gain * rotating_film_W_m2K(speed_rpm, d_m)

        return (SpeedLoss(speed_channel(machine, self.speed_channel, self.kind), film_W_m2K),)


class UnevenConvection(EffectTable):
    """A film coefficient that differs along a stretch: a cover, an air blast."""

    kind: Literal["uneven_convection"]
    from_m: NonNegative
    to_m: NonNegative
    extra_W_m2K: Annotated[Finite, Field(ge=-200, le=500)]

    parameters = ("from_m", "to_m", "extra_W_m2K")
    excitation = "a warm screw, and sensors on and beside the stretch"
    source = "Newton's law of cooling with h(x)"

    @model_validator(mode="after")
    def _not_empty(self) -> UnevenConvection:
        if not self.from_m < self.to_m:
            raise ValueError(
                f"the stretch {self.from_m} … {self.to_m} m is empty; from_m must be the smaller"
            )
        return self

    def terms(self, machine: Description) -> tuple[Term, ...]:
        on_screw(machine, "to_m", self.to_m, self.kind)
        return (StretchFilm(self.from_m, self.to_m, self.extra_W_m2K),)


class RadiationEffect(EffectTable):
    """A grey surface in surroundings at ambient temperature: ε σ (T⁴ − T_amb⁴)."""

    kind: Literal["radiation"]
    emissivity: Annotated[Finite, Field(ge=0, le=1)]

    parameters = ("emissivity",)
    excitation = "a screw that is more than 40 K warmer than its surroundings, and one that is hardly warmer"
    source = "Stefan and Boltzmann; Lathe study, eq. 6"

    def terms(self, machine: Description) -> tuple[Term, ...]:
        return (Radiation(self.emissivity),)


class Coolant(EffectTable):
    """Flow through a hollow screw while it turns: G (T − T_inlet) over its length."""

    kind: Literal["coolant"]
    conductance_W_K: Annotated[Finite, Field(ge=0, le=1000)]
    inlet_degC: Temperature
    speed_channel: Channel | None = None

    parameters = ("conductance_W_K", "inlet_degC")
    excitation = "a warm screw that turns, and one that stands"
    source = "energy balance of a flow with a high heat capacity rate"

    def terms(self, machine: Description) -> tuple[Term, ...]:
        screw = machine.screw
        film = self.conductance_W_K / (math.pi * screw.diameter_m * screw.length_m)

        def film_W_m2K(speed_rpm: FloatArray) -> FloatArray:
            return np.where(np.abs(speed_rpm) > 0.0, film, 0.0)

        channel = speed_channel(machine, self.speed_channel, self.kind)
        return (SpeedLoss(channel, film_W_m2K, self.inlet_degC),)


class AmbientDrift(EffectTable):
    """The air near the screw departs from what is configured or logged as time goes on."""

    kind: Literal["ambient_drift"]
    rate_K_h: Annotated[Finite, Field(ge=-50, le=50)]

    parameters = ("rate_K_h",)
    excitation = "a log of an hour or more"
    source = "a linear trend"

    def terms(self, machine: Description) -> tuple[Term, ...]:
        return (AmbientShift(self.rate_K_h),)


def rotating_film_W_m2K(speed_rpm: FloatArray, diameter_m: float) -> FloatArray:
    """Return the film coefficient of a rotating cylinder, (K,) from (K,).

    Nu = 0.133 Re^{2/3} Pr^{1/3}, Re = ω d²/ν < 4.3e5 (Yu et al.).
    """
    omega_rad_s = np.abs(speed_rpm) * RAD_S_PER_RPM
    reynolds = omega_rad_s * diameter_m**2 / AIR_VISCOSITY_M2_S
    nusselt = 0.133 * np.cbrt(reynolds) ** 2 * math.cbrt(AIR_PRANDTL)
    return np.asarray(nusselt * AIR_CONDUCTIVITY_W_MK / diameter_m)
