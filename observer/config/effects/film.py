"""Effects of the surface: films, radiation, coolant, and the air itself."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from typing import Annotated, Literal

import numpy as np
from pydantic import Field, model_validator

from observer.config.effects.base import (
    AT_END,
    END_LOSS,
    HEAT_LOSS,
    SURFACE_LOSS,
    EffectTable,
    Fitted,
    Form,
    Shape,
    end_at,
    on_screw,
    position,
    speed_channel,
)
from observer.config.effects.bodies import EndConduction
from observer.config.effects.terms import (
    AmbientShift,
    Film,
    Radiation,
    RisingFilm,
    SpeedLoss,
    StretchFilm,
    Term,
)
from observer.config.laws import Surface
from observer.config.quantities import Channel, Finite, Flag, NonNegative, Temperature, exactly_one
from observer.config.sections import Description
from observer.errors import ConfigError
from observer.frames import FloatArray
from observer.physics import film
from observer.physics.film import YU_AIR

CELLS, MOST_CELLS = 8, 4
"""Parts of the screw from which stretches of another film are made up, and of how many at most."""
NARROWEST = 0.05
"""The narrowest stretch of another film that sensors can resolve, as a part of the screw."""


class SurfaceConvection(EffectTable):
    """A surface loss where none is modelled: h = coefficient."""

    kind: Literal["surface_convection"]
    coefficient_W_m2K: Annotated[Finite, Field(ge=0, le=500)]  #: film coefficient, W/m²K

    parameters = {"coefficient_W_m2K": Fitted("W/m2K", 5.0)}
    families = (SURFACE_LOSS, HEAT_LOSS)
    missing_physics = "a loss of heat to the air over the whole surface"
    excitation = "a screw that is warmer than the air, heating and cooling"
    source = "Newton's law of cooling; Kim et al., eq. 1"

    @classmethod
    def places(cls, machine: Description, free: Collection[str]) -> Sequence[str | None]:
        """Return the whole screw if no surface loss is configured and the base film is not free, else
        nothing.
        """
        bare = "surface.convection_W_m2K" not in free and machine.surface == Surface()
        return (None,) if bare else ()

    def terms(self, machine: Description) -> tuple[Term, ...]:
        """Return a film over the whole surface."""
        return (Film(self.coefficient_W_m2K),)


class SpeedConvection(EffectTable):
    """A film coefficient that grows with rotation, h = gain · 0.133 Re^{2/3} Pr^{1/3} λ/d."""

    kind: Literal["speed_convection"]
    #: factor on the rotating cylinder’s film; 1 is the correlation
    gain: Annotated[Finite, Field(ge=0, le=10)]
    #: channel of the screw’s speed in rpm; – is the first that a source reads
    speed_channel: Channel | None = None

    parameters = {"gain": Fitted("1", 0.1)}
    turning = True
    families = (SURFACE_LOSS, HEAT_LOSS)
    missing_physics = "cooling that grows with the screw's rotation"
    excitation = "two speeds or more at which the screw is warm"
    source = "Yu et al., rotating cylinder; Kendoush 1996"

    @classmethod
    def places(cls, machine: Description, free: Collection[str]) -> Sequence[str | None]:
        """Return nothing if the configured film law already contains rotation."""
        return () if machine.surface.turns else super().places(machine, free)

    def terms(self, machine: Description) -> tuple[Term, ...]:
        """Return a loss with the film of a cylinder that turns in air at 25 °C, times the gain.

        Raises:
            ConfigError: If `surface.law` already contains rotation, or no channel of the speed is known.
        """
        if machine.surface.turns:
            raise ConfigError(
                f'effect "{self.kind}": surface.law already gives what turning adds to the film; remove the '
                "effect, or the speed from [surface]"
            )
        d_m, gain = machine.screw.diameter_m, self.gain

        def film_W_m2K(speed_rpm: FloatArray) -> FloatArray:
            nusselt = film.rotating_nusselt(film.rotating_reynolds(speed_rpm, d_m, YU_AIR), YU_AIR.prandtl)
            return gain * film.film_W_m2K(nusselt, d_m, YU_AIR)

        return (SpeedLoss(speed_channel(machine, self.speed_channel, self.kind), film_W_m2K),)


class UnevenConvection(EffectTable):
    """A film coefficient that differs along a stretch: a cover, an air blast."""

    kind: Literal["uneven_convection"]
    from_m: NonNegative  #: where the stretch begins
    to_m: NonNegative  #: where it ends
    #: what its film coefficient has more (or, negative, less)
    extra_W_m2K: Annotated[Finite, Field(ge=-200, le=500)]

    parameters = {"from_m": position(CELLS), "to_m": position(CELLS), "extra_W_m2K": Fitted("W/m2K", 5.0)}
    families = (END_LOSS, SURFACE_LOSS, HEAT_LOSS)
    missing_physics = "a stretch of the screw that is cooled more or less than the rest"
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
        """Return an additional film along the stretch.

        Raises:
            ConfigError: If the stretch ends beyond the screw.
        """
        on_screw(machine, "to_m", self.to_m, self.kind)
        return (StretchFilm(self.from_m, self.to_m, self.extra_W_m2K),)

    @classmethod
    def shapes(cls, machine: Description) -> Sequence[Shape]:
        """Return every stretch of one to four of eight equal cells, with 5 W/m²K more."""
        L = machine.screw.length_m
        spans = [(i, i + w) for w in range(1, MOST_CELLS + 1) for i in range(CELLS + 1 - w)]
        return [{"from_m": a * L / CELLS, "to_m": b * L / CELLS, "extra_W_m2K": 5.0} for a, b in spans]

    @classmethod
    def sums(cls, shapes: Sequence[Shape]) -> Sequence[Sequence[int]]:
        """Return the cells of each stretch: while weak, a stretch changes a prediction by the sum of its
        cells.
        """
        width_m = 1.5 * min(x["to_m"] - x["from_m"] for x in shapes)
        cells = [i for i, x in enumerate(shapes) if x["to_m"] - x["from_m"] < width_m]
        return [[i for i in cells if x["from_m"] <= shapes[i]["from_m"] < x["to_m"] - 1e-9] for x in shapes]

    def resolved(self, length_m: float) -> UnevenConvection:
        """Return the stretch, widened about its middle to the narrowest one that sensors can resolve.

        It stays within the screw.
        """
        least_m = NARROWEST * length_m
        if self.to_m - self.from_m >= least_m:
            return self
        middle_m = min(max((self.from_m + self.to_m) / 2, least_m / 2), length_m - least_m / 2)
        ends_m = (max(middle_m - least_m / 2, 0.0), min(middle_m + least_m / 2, length_m))
        return self.model_copy(update={"from_m": ends_m[0], "to_m": ends_m[1]})

    def place(self, length_m: float) -> str | None:
        """Return the end at which the whole stretch lies; None if it lies elsewhere."""
        end = end_at(self.from_m, length_m)
        return end if end == end_at(self.to_m, length_m) else None

    def comes_down_to(self, length_m: float) -> tuple[type[EffectTable], str | None] | None:
        """Return a loss at an end, or over the whole screw, if the stretch equals one of these."""
        if (end := self.place(length_m)) is not None:
            return EndConduction, end
        whole = self.to_m - self.from_m > (1 - AT_END) * length_m
        return (SurfaceConvection, None) if whole else None


class RadiationEffect(EffectTable):
    """A grey surface in surroundings at ambient temperature: ε σ (T⁴ − T_amb⁴)."""

    kind: Literal["radiation"]
    emissivity: Annotated[Finite, Field(ge=0, le=1)]  #: of the surface, 0 to 1

    parameters = {"emissivity": Fitted("1", 0.3)}
    families = (SURFACE_LOSS, HEAT_LOSS)
    missing_physics = "heat radiated by the surface"
    excitation = "a screw that is more than 40 K warmer than its surroundings, and one that is hardly warmer"
    source = "Stefan and Boltzmann; Lathe study, eq. 6"

    def terms(self, machine: Description) -> tuple[Term, ...]:
        """Return a grey surface; each step takes the tangent of its loss at the mean temperature of the
        screw.
        """
        return (Radiation(self.emissivity),)


class NaturalConvection(EffectTable):
    """A film of still air, which a warm surface sets in motion: h = coefficient · (|T − T_amb| / 10 K)^¼."""

    kind: Literal["natural_convection"]
    coefficient_W_m2K: Annotated[Finite, Field(ge=0, le=500)]  #: film coefficient at a rise of 10 K, W/m²K

    parameters = {"coefficient_W_m2K": Fitted("W/m2K", 3.0)}
    families = (SURFACE_LOSS, HEAT_LOSS)
    missing_physics = "a loss to still air that grows with the surface's own rise"
    excitation = "a screw that stands, more than 20 K warmer than the air and hardly warmer"
    source = "laminar free convection of a horizontal cylinder, Nu ~ Ra^(1/4); Churchill and Chu 1975"

    def terms(self, machine: Description) -> tuple[Term, ...]:
        """Return a film that grows with the fourth root of the surface's rise."""
        return (RisingFilm(self.coefficient_W_m2K),)


class Coolant(EffectTable):
    """Flow through a hollow screw: G (T − T_inlet) over its length, while it turns or always."""

    kind: Literal["coolant"]
    #: from the whole length of the screw to the coolant, W/K
    conductance_W_K: Annotated[Finite, Field(ge=0, le=1000)]
    inlet_degC: Temperature | None = None  #: temperature of the coolant where it enters
    inlet_channel: Channel | None = None  #: the channel that measures it
    while_standing: Flag = False  #: it flows while the screw stands, too
    #: channel of the screw’s speed in rpm; – is the first that a source reads
    speed_channel: Channel | None = None

    parameters = {
        "conductance_W_K": Fitted("W/K", 0.3),
        "inlet_degC": Fitted("°C", 5.0, None, (12.0, 20.0, 28.0), low=-20.0, high=90.0),  # of any coolant
    }
    turning = True
    missing_physics = "coolant through the hollow screw while it turns"
    excitation = "a warm screw that turns, and one that stands"
    source = "energy balance of a flow with a high heat capacity rate"

    _one = exactly_one("inlet_degC", "inlet_channel")

    @model_validator(mode="after")
    def _no_speed_unasked(self) -> Coolant:
        if self.while_standing and self.speed_channel is not None:
            raise ValueError("while_standing flows whatever the speed; remove it, or speed_channel")
        return self

    @classmethod
    def can_exist(cls, machine: Description) -> bool:
        """Whether any part of the screw is hollow, or a coolant is configured already."""
        configured = any(isinstance(effect, Coolant) for effect in getattr(machine, "effect", ()))
        return configured or any(piece.bore_m > 0.0 for piece in machine.screw.pieces)

    @classmethod
    def fixed_keys(cls, machine: Description) -> Mapping[str, str | bool]:
        """Return the keys of a configured coolant with a measured inlet, since another one has the same
        inlet.
        """
        measured_coolants = (
            e for e in getattr(machine, "effect", ()) if isinstance(e, Coolant) and e.inlet_channel
        )
        keys = {"inlet_channel", "while_standing", "speed_channel"}
        return next((e.model_dump(include=keys, exclude_defaults=True) for e in measured_coolants), {})

    @classmethod
    def forms(cls, machine: Description, target: str | None, free: Collection[str]) -> Sequence[Form]:
        """Return the conductance alone if the inlet is measured, else both parameters.

        Arguments as in `EffectTable.forms`.
        """
        return (("conductance_W_K",),) if cls.fixed_keys(machine) else super().forms(machine, target, free)

    @property
    def channels(self) -> tuple[str, ...]:
        """The channels of the speed and of the inlet."""
        return super().channels + (() if self.inlet_channel is None else (self.inlet_channel,))

    def terms(self, machine: Description) -> tuple[Term, ...]:
        """Return a loss towards the inlet's temperature, with G over the screw's outer surface as the film.

        Raises:
            ConfigError: If the flow depends on the speed and no channel of the speed is known.
        """
        screw = machine.screw
        wetted = self.conductance_W_K / screw.surface_m2

        def film_W_m2K(speed_rpm: FloatArray) -> FloatArray:
            return np.where((np.abs(speed_rpm) > 0.0) | self.while_standing, wetted, 0.0)

        speed = None if self.while_standing else speed_channel(machine, self.speed_channel, self.kind)
        return (SpeedLoss(speed, film_W_m2K, self.inlet_degC, self.inlet_channel),)


class AmbientDrift(EffectTable):
    """The air near the screw departs more and more from its configured or logged temperature."""

    kind: Literal["ambient_drift"]
    rate_K_h: Annotated[Finite, Field(ge=-50, le=50)]  #: K per hour since the start

    parameters = {"rate_K_h": Fitted("K/h", 0.3)}
    missing_physics = "air near the screw that drifts away from the ambient given"
    excitation = "a log of an hour or more"
    source = "a linear trend"

    def terms(self, machine: Description) -> tuple[Term, ...]:
        """Return a deviation of the air's temperature that grows linearly from 0 at the start."""
        return (AmbientShift(self.rate_K_h),)
