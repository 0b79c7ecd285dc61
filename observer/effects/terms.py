"""The terms in which an effect describes its addition to the plant.

The plant builder handles these terms, not individual effects. The first group changes the machine from which
the plant is built, the second changes its inputs. The third couples states: it acts on the momentary
temperature.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Literal, NamedTuple

import numpy as np

from observer.frames import FloatArray
from observer.tables.sections import Source

End = Literal["left", "right"]


class Film(NamedTuple):
    """An additional film coefficient over the whole surface."""

    convection_W_m2K: float


class EndConductance(NamedTuple):
    """A conductance from an end to the ambient."""

    end: End
    conductance_W_K: float


class Heat(NamedTuple):
    """A source of heat, whose law gives its value."""

    source: Source


class LawFactor(NamedTuple):
    """A factor on a source's heat by law: `factor(speed_rpm, running_s)`, (K,) from (K,), (K,).

    The argument `running_s` is the time since the start for which the source's channel has not been zero.
    """

    source: str
    factor: Callable[[FloatArray, FloatArray], FloatArray]


class LawScale(NamedTuple):
    """A constant factor on a source's heat by law."""

    source: str
    factor: float


class StrokeEnds(NamedTuple):
    """A share of a nut's heat that enters at both ends of its stroke, in equal parts."""

    source: str
    fraction: float


class AmbientShift(NamedTuple):
    """A deviation of the air near the screw from the known ambient: a rate and a constant."""

    rate_K_h: float
    offset_K: float = 0.0


class SensorOffset(NamedTuple):
    """An error of a sensor: a constant, and a rate."""

    sensor: str
    offset_K: float
    rate_K_h: float


class SpeedLoss(NamedTuple):
    """A uniform loss that depends on the screw's speed, or a constant one.

    The function `film_W_m2K(speed_rpm)` gives the film coefficient (K,). Heat flows towards
    `temperature_degC`, towards the temperature of `temperature_channel`, or towards the ambient if neither is
    given.
    """

    speed_channel: str | None
    film_W_m2K: Callable[[FloatArray], FloatArray]
    temperature_degC: float | None = None
    temperature_channel: str | None = None


class StretchFilm(NamedTuple):
    """An additional (or negative) film coefficient along a stretch."""

    from_m: float
    to_m: float
    extra_W_m2K: float


class Radiation(NamedTuple):
    """A grey surface that radiates to surroundings at ambient temperature."""

    emissivity: float


class RisingFilm(NamedTuple):
    """A film that grows with the surface's rise above ambient: h = `at_10_K_W_m2K` · (|T − T_amb| / 10
    K)^(1/4).
    """

    at_10_K_W_m2K: float

    def film_W_m2K(self, rise_K: FloatArray | float) -> FloatArray:
        """Return the film coefficient at rises above ambient, in K, of either sign."""
        return np.asarray(self.at_10_K_W_m2K * np.sqrt(np.sqrt(np.abs(rise_K) / 10.0)))


class Body(NamedTuple):
    """A lump of heat capacity that exchanges heat with the screw at the position of a source.

    It takes up `heated` W for each W that the source gives the screw, and loses `loss_W_K` to the ambient.
    """

    source: str
    capacity_J_K: float
    conductance_W_K: float
    heated: float = 0.0
    loss_W_K: float = 0.0


class WarmedAir(NamedTuple):
    """Air along a stretch of the screw, for example under a cover, that a source warms.

    C dT_a/dt = heated q + ∫ h P (T − T_a) dx − loss (T_a − T_amb), with the heat q that the source gives the
    screw. The base film h of the screw acts towards T_a there, not towards the ambient.
    """

    source: str
    from_m: float
    to_m: float
    capacity_J_K: float
    heated: float
    loss_W_K: float


class Lag(NamedTuple):
    """A sensor that follows the temperature below it with a first-order lag."""

    sensor: str
    time_constant_s: float


class Fade(NamedTuple):
    """A source's heat by law times exp(-per_K · (T - reference)), T the temperature where it enters."""

    source: str
    per_K: float
    reference_degC: float


Term = (
    Film | EndConductance | Heat
    | LawFactor | LawScale | StrokeEnds | AmbientShift | SensorOffset | SpeedLoss
    | StretchFilm | Radiation | RisingFilm | Body | WarmedAir | Lag | Fade
)  # fmt: skip
INPUT_TERMS = (LawFactor, AmbientShift, SensorOffset, SpeedLoss)
"""The terms that change what drives the plant, but for where nuts are."""
COUPLING_TERMS = (SpeedLoss, StretchFilm, Radiation, RisingFilm, Body, WarmedAir, Lag, Fade)
"""The terms that couple states, or a state to the moment."""
