"""The small vocabulary in which an effect says what it adds to the plant.

The plant builder knows these terms and no effect by name. The first group changes the machine the plant is
built from, the second what drives it, the third couples states: it acts on the temperature of the moment.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Literal, NamedTuple

import numpy as np

from observer.frames import FloatArray
from observer.tables.sections import Source

End = Literal["left", "right"]


class Film(NamedTuple):
    """More film coefficient all over the surface."""

    convection_W_m2K: float


class EndConductance(NamedTuple):
    """A conductance from an end to the ambient."""

    end: End
    conductance_W_K: float


class Heat(NamedTuple):
    """A source of heat whose law is its value."""

    source: Source


class LawFactor(NamedTuple):
    """A factor on a source's heat by law: `factor(speed_rpm, running_s)`, (K,) from (K,), (K,).

    `running_s` is the time for which the source's channel has not been zero since the start.
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
    """The air near the screw departs from what is known of it, by so much an hour and by a constant."""

    rate_K_h: float
    offset_K: float = 0.0


class SensorOffset(NamedTuple):
    """What a sensor reads too much: a constant, and so much more an hour."""

    sensor: str
    offset_K: float
    rate_K_h: float


class SpeedLoss(NamedTuple):
    """A uniform loss that depends on the screw's speed, or on none.

    `film_W_m2K(speed_rpm)` (K,) from (K,) is the film coefficient it amounts to; it draws towards
    `temperature_degC`, towards what `temperature_channel` measures, or towards the ambient where neither is
    given.
    """

    speed_channel: str | None
    film_W_m2K: Callable[[FloatArray], FloatArray]
    temperature_degC: float | None = None
    temperature_channel: str | None = None


class StretchFilm(NamedTuple):
    """More (or less) film coefficient along a stretch."""

    from_m: float
    to_m: float
    extra_W_m2K: float


class Radiation(NamedTuple):
    """A grey surface that radiates to surroundings at ambient temperature."""

    emissivity: float


class RisingFilm(NamedTuple):
    """A film that grows with its own rise over the air: h = `at_10_K_W_m2K` · (|T − T_amb| / 10 K)^(1/4)."""

    at_10_K_W_m2K: float

    def film_W_m2K(self, rise_K: FloatArray | float) -> FloatArray:
        """Return the film coefficient at rises over the air, in K, of either sign."""
        return np.asarray(self.at_10_K_W_m2K * np.sqrt(np.sqrt(np.abs(rise_K) / 10.0)))


class Body(NamedTuple):
    """A lump of heat capacity that exchanges heat with the screw where a source stands.

    It takes up `heated` W for each W that the source gives the screw, and loses `loss_W_K` to the ambient.
    """

    source: str
    capacity_J_K: float
    conductance_W_K: float
    heated: float = 0.0
    loss_W_K: float = 0.0


class WarmedAir(NamedTuple):
    """Air along a stretch of the screw, as under a cover, that a source warms.

    C dT_a/dt = heated q + ∫ h P (T − T_a) dx − loss (T_a − T_amb), q the heat that the source gives the
    screw; the base film h of the screw draws to T_a there, not to the ambient.
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
