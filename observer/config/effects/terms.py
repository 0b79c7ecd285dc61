"""The terms in which an effect describes its addition to the plant.

The plant builder handles these terms, not individual effects. The first group changes the machine from which
the plant is built, the second changes its inputs. The third couples states: it acts on the momentary
temperature.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Literal, NamedTuple

import numpy as np

from observer.config.sections import Source
from observer.frames import FloatArray

End = Literal["left", "right"]


class Film(NamedTuple):
    """An additional film coefficient over the whole surface.

    Attributes:
        convection_W_m2K: Coefficient that is added to the configured one.
    """

    convection_W_m2K: float


class EndConductance(NamedTuple):
    """A conductance from an end to the ambient: heat G (T_end − T_amb).

    Attributes:
        end: `left` or `right`.
        conductance_W_K: G, in addition to the configured boundary.
    """

    end: End
    conductance_W_K: float


class Heat(NamedTuple):
    """A source of heat, whose law gives its value.

    Attributes:
        source: A source that is added to the configured ones; it is not estimated.
    """

    source: Source


class LawFactor(NamedTuple):
    """A factor on a source's heat by law that changes with time.

    Attributes:
        source: Name of the source.
        factor: Returns the factor (K,) from the speed, rpm, (K,), and the running time, s, (K,). The latter
            counts from the start while the source's channel is not zero.
    """

    source: str
    factor: Callable[[FloatArray, FloatArray], FloatArray]


class LawScale(NamedTuple):
    """A constant factor on a source's heat by law.

    Attributes:
        source: Name of the source.
        factor: The factor.
    """

    source: str
    factor: float


class StrokeEnds(NamedTuple):
    """A share of a nut's heat that enters at both ends of its stroke, in equal parts.

    Attributes:
        source: Name of the nut.
        fraction: The share; negative takes heat from the ends and adds it along the path.
    """

    source: str
    fraction: float


class AmbientShift(NamedTuple):
    """A deviation of the air near the screw from the known ambient.

    Attributes:
        rate_K_h: Growth since the start, K/h.
        offset_K: Deviation at the start, K.
    """

    rate_K_h: float
    offset_K: float = 0.0


class SensorOffset(NamedTuple):
    """An error of a sensor.

    Attributes:
        sensor: Name of the sensor.
        offset_K: Error at the start, K, or µm for a displacement.
        rate_K_h: Growth since the start, per hour.
    """

    sensor: str
    offset_K: float
    rate_K_h: float


class SpeedLoss(NamedTuple):
    """A uniform loss that depends on the screw's speed, or a constant one.

    Heat flows towards `temperature_degC`, towards the temperature of `temperature_channel`, or towards the
    ambient if neither is given.

    Attributes:
        speed_channel: Channel of the speed, rpm; None for a constant loss.
        film_W_m2K: Returns the film coefficient (K,) from the speed (K,).
        temperature_degC: Constant temperature, °C, or None.
        temperature_channel: Channel of a measured temperature, or None.
    """

    speed_channel: str | None
    film_W_m2K: Callable[[FloatArray], FloatArray]
    temperature_degC: float | None = None
    temperature_channel: str | None = None


class StretchFilm(NamedTuple):
    """An additional film coefficient along a stretch.

    Attributes:
        from_m: Beginning of the stretch, m.
        to_m: Its end, m.
        extra_W_m2K: The coefficient; negative where the surface loses less.
    """

    from_m: float
    to_m: float
    extra_W_m2K: float


class Radiation(NamedTuple):
    """A grey surface that radiates to surroundings at ambient temperature: ε σ (T⁴ − T_amb⁴).

    Attributes:
        emissivity: ε, 0 to 1.
    """

    emissivity: float


class RisingFilm(NamedTuple):
    """A film that grows with the surface's rise above ambient: h = h₁₀ · (|T − T_amb| / 10 K)^(1/4).

    Attributes:
        at_10_K_W_m2K: h₁₀, the film coefficient at a rise of 10 K.
    """

    at_10_K_W_m2K: float

    def film_W_m2K(self, rise_K: FloatArray | float) -> FloatArray:
        """Return the film coefficient at rises above ambient, in K, of either sign."""
        return np.asarray(self.at_10_K_W_m2K * np.sqrt(np.sqrt(np.abs(rise_K) / 10.0)))


class Body(NamedTuple):
    """A lump of heat capacity that exchanges heat with the screw at the position of a source.

    C dT_b/dt = heated q + G (T − T_b) − loss (T_b − T_amb), with the heat q that the source gives the screw.

    Attributes:
        source: Name of the source; with a nut the body moves.
        capacity_J_K: C, J/K.
        conductance_W_K: G, W/K.
        heated: Heat into the body for each W that the source gives the screw.
        loss_W_K: Conductance to the ambient, W/K.
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

    Attributes:
        source: Name of the source.
        from_m: Beginning of the stretch, m.
        to_m: Its end, m.
        capacity_J_K: C, J/K.
        heated: Heat into the air for each W that the source gives the screw.
        loss_W_K: Conductance to the ambient, W/K.
    """

    source: str
    from_m: float
    to_m: float
    capacity_J_K: float
    heated: float
    loss_W_K: float


class Lag(NamedTuple):
    """A sensor that follows the temperature below it with a first-order lag: τ dT_s/dt = T − T_s.

    Attributes:
        sensor: Name of the sensor.
        time_constant_s: τ, s.
    """

    sensor: str
    time_constant_s: float


class Fade(NamedTuple):
    """A source's heat by law times exp(−a (T − T_ref)), with T the temperature where it enters.

    Attributes:
        source: Name of the source.
        per_K: a, 1/K.
        reference_degC: T_ref, °C.
    """

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
