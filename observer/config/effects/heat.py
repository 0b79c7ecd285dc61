"""Effects on the heats: heat without a law, and corrections of laws."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from observer.config.effects import base
from observer.config.effects.base import (
    END_SOURCE,
    EffectTable,
    Fitted,
    Shape,
    Target,
    position,
    speed_channel,
)
from observer.config.effects.terms import End, Fade, Heat, LawFactor, StrokeEnds, Term
from observer.config.laws import SPEED_LAWS
from observer.config.quantities import Channel, Finite, NonNegative, Positive, Temperature
from observer.config.sections import Description
from observer.errors import ConfigError
from observer.frames import FloatArray

REFERENCE_RPM = 1000.0
"""The speed at which a law keeps its heat when its exponent changes."""
REFERENCE_DEGC = 20.0
"""The temperature at which a law keeps its heat when friction fades."""


class EndHeat(EffectTable):
    """Extra heat at a bearing, in proportion to speed."""

    kind: Literal["end_heat"]
    target: End  #: `left` or `right`
    heat_W_rpm: Annotated[Finite, Field(ge=-1, le=1)]  #: extra heat per speed, W per rpm
    #: channel of the screw’s speed in rpm; – is the first that a source reads
    speed_channel: Channel | None = None

    parameters = {"heat_W_rpm": Fitted("W/rpm", 1e-3)}
    targets = "end"
    families = (END_SOURCE,)
    missing_physics = "heat at {target} that grows with speed"
    excitation = "two speeds or more, and a standstill"
    source = "Kim et al., eq. 29"
    turning = True
    confounded_with_scale = True

    def terms(self, machine: Description) -> tuple[Term, ...]:
        """Return a point source at the end with a heat in proportion to the magnitude of the speed.

        Raises:
            ConfigError: If the end has a prescribed temperature, or no channel of the speed is known.
        """
        end_m = base.free_end(machine, self.target, self.kind)
        channel = speed_channel(machine, self.speed_channel, self.kind)
        heat = base.point_heat(
            f"{self.kind}.{self.target}", end_m, heat_W_rpm=abs(self.heat_W_rpm), speed_channel=channel
        )
        return (heat if self.heat_W_rpm >= 0 else Heat(heat.source.model_copy(update={"scale": -1.0})),)


class MotorHeat(EffectTable):
    """Heat through the coupling, independent of speed, as long as the drive is on."""

    kind: Literal["motor_heat"]
    target: End  #: `left` or `right`
    heat_W: Annotated[Finite, Field(ge=-500, le=500)]  #: heat in W; negative takes heat out
    drive_channel: Channel | None = None  #: the heat flows while this channel is not 0; – is always

    parameters = {"heat_W": Fitted("W", 2.0, low=0.0)}
    targets = "end"
    families = (END_SOURCE,)
    missing_physics = "heat from the drive at {target}, the same at any speed"
    excitation = "a standstill with the drive on, and speeds that differ"
    source = "Yu et al., the motor as a heat source of the shaft"

    def terms(self, machine: Description) -> tuple[Term, ...]:
        """Return a point source at the end with a constant heat.

        Raises:
            ConfigError: If the end has a prescribed temperature.
        """
        name, end_m = f"{self.kind}.{self.target}", base.free_end(machine, self.target, self.kind)
        return (base.point_heat(name, end_m, heat_W=self.heat_W, drive_channel=self.drive_channel),)


class LocalHeat(EffectTable):
    """A constant source of heat at a place."""

    kind: Literal["local_heat"]
    position_m: NonNegative  #: where
    heat_W: Annotated[Finite, Field(ge=-500, le=500)]  #: heat in W; negative takes heat out

    parameters = {"position_m": position(10), "heat_W": Fitted("W", 2.0)}
    families = (END_SOURCE,)
    missing_physics = "a source of heat at one place of the screw"
    excitation = "a log longer than the screw's slowest mode, and sensors on both sides of the place"
    source = "a point source; Kim et al., eq. 1"

    def terms(self, machine: Description) -> tuple[Term, ...]:
        """Return a point source at the place with a constant heat.

        Raises:
            ConfigError: If the place lies beyond the screw.
        """
        base.on_screw(machine, "position_m", self.position_m, self.kind)
        return (base.point_heat(self.kind, self.position_m, heat_W=self.heat_W),)

    @classmethod
    def shapes(cls, machine: Description) -> Sequence[Shape]:
        """Return 2 W at each of 13 places, both ends included."""
        places_m = np.linspace(0.0, machine.screw.length_m, 13).tolist()
        return [{"position_m": x, "heat_W": 2.0} for x in places_m]

    def place(self, length_m: float) -> str | None:
        """Return the end at which it is; None if it is elsewhere."""
        return base.end_at(self.position_m, length_m)

    def comes_down_to(self, length_m: float) -> tuple[type[EffectTable], str | None] | None:
        """Return the heat of a drive if it is at an end."""
        end = self.place(length_m)
        return None if end is None else (MotorHeat, end)


class FrictionFade(EffectTable):
    """Friction that falls as the screw warms: law · exp(−per_K · (T − reference))."""

    kind: Literal["friction_fade"]
    target: Target  #: a source’s name
    #: share by which the friction falls per kelvin (e-fold rate)
    per_K: Annotated[Finite, Field(ge=-0.2, le=0.2)]
    reference_degC: Temperature = REFERENCE_DEGC  #: temperature at which the law holds

    parameters = {"per_K": Fitted("1/K", 3e-3)}
    targets = "source"
    missing_physics = "friction of {target} that falls as the screw warms"
    excitation = "the same speed with a cold and with a warm screw"
    source = "viscosity of lubricants falls about exponentially with temperature; Yu et al., Palmgren's M1"

    @classmethod
    def places(cls, machine: Description, free: Collection[str]) -> Sequence[str | None]:
        """Return the sources of friction that heat the screw."""
        heating = [s.name for s in machine.source if s.screw_share > 0.0]
        return [name for name in super().places(machine, free) if name in heating]

    def terms(self, machine: Description) -> tuple[Term, ...]:
        """Return the factor exp(−per_K · (T − reference)) with the temperature T where the heat enters.

        Raises:
            ConfigError: If the target is no source, heats nodes only, or is at an end with a prescribed
                temperature.
        """
        at = base.source_free_to_warm(machine, self.target, self.kind)
        return (Fade(at, self.per_K, self.reference_degC),)


class FrictionSpeed(EffectTable):
    """A heat that goes with another power of speed than its law's: law · (n/n_ref)^(exponent − 1)."""

    kind: Literal["friction_speed"]
    target: Target  #: a source’s name
    exponent: Annotated[Finite, Field(ge=0, le=4)]  #: exponent of the speed; 1 is the law
    reference_rpm: Positive = REFERENCE_RPM  #: speed at which the law holds

    parameters = {"exponent": Fitted("1", 0.2, neutral=1.0, starts=(1.1,))}
    targets = "source"
    missing_physics = "another power of speed in the heat of {target}"
    excitation = "three speeds or more, each until the screw follows"
    source = "Palmgren: M1 goes with (ν n)^{2/3}; Yu et al."

    @classmethod
    def places(cls, machine: Description, free: Collection[str]) -> Sequence[str | None]:
        """Return the sources with a law of the speed."""
        by_speed = [s.name for s in machine.source if s.law in SPEED_LAWS]
        return [name for name in super().places(machine, free) if name in by_speed]

    def terms(self, machine: Description) -> tuple[Term, ...]:
        """Return the factor (|n|/n_ref)^(exponent − 1), with |n| of at least a thousandth of n_ref.

        Raises:
            ConfigError: If the target is no source, or its law does not depend on the speed.
        """
        power, reference = self.exponent - 1.0, self.reference_rpm

        def factor(speed_rpm: FloatArray, _running_s: FloatArray) -> FloatArray:
            ratio = np.maximum(np.abs(speed_rpm) / reference, 1e-3)
            return np.asarray(ratio**power)

        if base.named_source(machine, self.target, self.kind).law not in SPEED_LAWS:
            raise ConfigError(
                f'effect "{self.kind}": the law of "{self.target}" does not depend on speed; name another '
                "source, or remove the effect"
            )
        return (LawFactor(self.target, factor),)


class RunIn(EffectTable):
    """Friction that decays with the time run since the start: law · (1 + fraction · exp(−t/time))."""

    kind: Literal["run_in"]
    target: Target  #: a source’s name
    fraction: Annotated[Finite, Field(ge=-1, le=10)]  #: extra friction at the start, relative to its law
    time_s: Annotated[Finite, Field(ge=30, le=100_000)]  #: time constant of the decay, s of running

    parameters = {
        "fraction": Fitted("1", 0.2),
        "time_s": Fitted("s", 1200.0, neutral=None, starts=(400.0, 1200.0, 3600.0)),
    }
    targets = "source"
    missing_physics = "friction of {target} that falls as it runs in"
    excitation = "the first hour of running, and later running at the same speed"
    source = "Li 2022: the heat found peaks at the start and decays"

    def terms(self, machine: Description) -> tuple[Term, ...]:
        """Return the factor 1 + fraction · exp(−t/time) with the running time t since the start of the data.

        Raises:
            ConfigError: If the target is no source.
        """
        fraction, time_s = self.fraction, self.time_s

        def factor(_speed_rpm: FloatArray, running_s: FloatArray) -> FloatArray:
            return np.asarray(1.0 + fraction * np.exp(-running_s / time_s))

        return (LawFactor(base.named_source(machine, self.target, self.kind).name, factor),)


class Dwell(EffectTable):
    """A share of a nut's heat enters at both ends of its stroke, where it turns round, not along its path."""

    kind: Literal["dwell"]
    target: Target  #: the name of a source of shape `nut`
    #: share of the heat that enters at the ends of the stroke
    fraction: Annotated[Finite, Field(ge=-1, le=1)]

    parameters = {"fraction": Fitted("1", 0.1)}
    targets = "nut"
    on_the_way = True
    missing_physics = "heat of {target} that enters where it turns round"
    excitation = "a nut that runs over its whole stroke, and sensors on and beside the stroke"
    source = "Li 2022: contact weighted by the time the nut dwells at a place"

    def terms(self, machine: Description) -> tuple[Term, ...]:
        """Return the share of the nut's heat that enters at both ends of its actual stroke.

        Raises:
            ConfigError: If the target is no source, is no nut, or heats nodes only.
        """
        source = base.named_source(machine, self.target, self.kind)
        if source.shape != "nut":
            raise ConfigError(
                f'effect "{self.kind}": target "{source.name}" is no nut; name a source of shape = "nut"'
            )
        base.heats_screw(source, self.kind)
        return (StrokeEnds(source.name, self.fraction),)
