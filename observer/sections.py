"""The machine as the configuration describes it: screw, surface, ends, air, sources and sensors.

Every unit and every range of these tables is checked here, once.
"""

from __future__ import annotations

from typing import Literal

from pydantic import Field, model_validator

from observer.laws import LAWS, HeatLaw, Surface
from observer.mounting import Supports
from observer.quantities import Channel, Name, NonNegative, Positive, Section, Temperature


class Screw(Section):
    """Geometry and material of the screw; `diameter_m` is the effective (root) diameter."""

    length_m: Positive
    diameter_m: Positive
    conductivity_W_mK: Positive
    density_kg_m3: Positive
    specific_heat_J_kgK: Positive
    expansion_1_K: Positive | None = None


class Ambient(Section):
    """The air around the screw: one constant, or a channel of the log."""

    temperature_degC: Temperature | None = None
    channel: Channel | None = None

    @model_validator(mode="after")
    def _exactly_one(self) -> Ambient:
        if (self.temperature_degC is None) == (self.channel is None):
            raise ValueError("give exactly one of temperature_degC and channel")
        return self


class Boundary(Section):
    """One end of the screw."""

    kind: Literal["insulated", "convective", "prescribed"] = "insulated"
    coefficient_W_m2K: Positive | None = None
    channel: Channel | None = None

    @model_validator(mode="after")
    def _complete(self) -> Boundary:
        if (self.kind == "convective") != (self.coefficient_W_m2K is not None):
            raise ValueError('coefficient_W_m2K belongs to kind = "convective", and is needed there')
        if (self.kind == "prescribed") != (self.channel is not None):
            raise ValueError('channel belongs to kind = "prescribed", and is needed there')
        return self


class Boundaries(Section):
    """Both ends."""

    left: Boundary = Boundary()
    right: Boundary = Boundary()


class Source(HeatLaw):
    """Heat entering the screw: where (shape) and how much (law)."""

    name: Name
    shape: Literal["nut", "point", "band"]
    # where
    length_m: Positive | None = None
    stroke_m: tuple[NonNegative, NonNegative] | None = None
    position_channel: Channel | None = None
    lead_m: Positive | None = None
    position_m: NonNegative | None = None
    from_m: NonNegative | None = None
    to_m: NonNegative | None = None
    # how it is estimated
    estimate: bool = True
    random_walk_W_sqrt_s: NonNegative = 0.1
    time_constant_s: Positive | None = None
    law_uncertainty: NonNegative = 0.2
    initial_sigma_W: Positive = 30.0

    @model_validator(mode="after")
    def _shape_is_complete(self) -> Source:
        needed = {"nut": ("length_m",), "point": ("position_m",), "band": ("from_m", "to_m")}[self.shape]
        for key in needed:
            if getattr(self, key) is None:
                raise ValueError(f'shape = "{self.shape}" needs {key}')
        belongs = {
            "length_m": "nut", "stroke_m": "nut", "position_channel": "nut", "lead_m": "nut",
            "position_m": "point", "from_m": "band", "to_m": "band",
        }  # fmt: skip
        for key, shape in belongs.items():
            if getattr(self, key) is not None and self.shape != shape:
                raise ValueError(f'{key} belongs to shape = "{shape}", not "{self.shape}"')
        if self.shape == "nut" and self.stroke_m is None and self.position_channel is None:
            raise ValueError("a nut needs position_channel or stroke_m")
        for low, high in (self.stroke_m or (None, None), (self.from_m, self.to_m)):
            if low is not None and high is not None and not low < high:
                raise ValueError(
                    f"the stretch {low} … {high} m is empty; the first number must be the smaller"
                )
        return self

    @model_validator(mode="after")
    def _law_is_complete(self) -> Source:
        if self.law is None and not self.estimate:
            raise ValueError(f"estimate = false needs a heat law ({', '.join(LAWS[:-1])} or {LAWS[-1]})")
        if self.stroke_share and self.stroke_m is None:
            raise ValueError("stroke_share is the stroke's part of the screw; give stroke_m")
        if self.nut_friction is not None and (self.nut_friction.lead_m is None) == (self.lead_m is None):
            raise ValueError("nut_friction needs the lead once; give lead_m in one of the two tables")
        return self


class Sensor(Section):
    """A thermocouple on the screw."""

    name: Name
    channel: Channel
    position_m: NonNegative
    noise_K: Positive = 0.1


class Description(Section):
    """What the model is built from: the physical part of a configuration."""

    screw: Screw
    surface: Surface = Surface()
    ambient: Ambient
    boundary: Boundaries = Boundaries()
    supports: Supports | None = None
    source: tuple[Source, ...] = Field(min_length=1)
    sensor: tuple[Sensor, ...] = Field(min_length=1)
