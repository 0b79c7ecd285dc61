"""Sensors: thermocouples on the screw and beside it, and sensors of the thermal error."""

from __future__ import annotations

import re
from typing import Annotated, Any, Literal

from pydantic import Field, model_validator

from observer.config import quantities
from observer.config.quantities import Section
from observer.units import BY_SUFFIX, unit_of

LENGTHS = ("um", "mm", "m")
"""The units in which the channel of a displacement may end."""
PROBING_S = 3600.0
"""How often an occasional displacement comes where nothing is said of that …"""
PASSING_S = 60.0
"""… and how often at most at a place that the nut passes."""
PASSED = (0.1, 0.3, 0.5, 0.7, 0.9)
"""The places at which a displacement along a nut's way is read, as parts of its stroke."""

SensorKind = Literal["temperature", "displacement"]
_THERMAL_KEYS = ("noise_K", "offset_K", "shows", "shows_tolerance", "on")
_DISPLACEMENT_KEYS = ("noise_um", "zero_um", "occasional", "along")


def refuse_foreign_keys(table: Section, kind: SensorKind) -> None:
    """Check that a sensor has no key of the other kind.

    Args:
        table: The sensor's or candidate's table.
        kind: Its kind.

    Raises:
        ValueError: If a key has no meaning with this kind.
    """
    for key in _THERMAL_KEYS if kind == "displacement" else _DISPLACEMENT_KEYS:
        if key in table.model_fields_set and getattr(table, key) is not None:
            raise ValueError(f'{key} has no meaning with kind = "{kind}"; remove it')


class Measuring(Section):
    """How well something measures, be it mounted or only a candidate."""

    noise_K: quantities.Noise = 0.1  #: σ of its noise
    #: σ of its offset; – is `tolerance.offset_K`
    offset_K: Annotated[quantities.NonNegative, Field(le=50)] | None = None
    #: the part of its rise above the air [that it shows](../how-to/choose-sensors.md#a-part-of-the-rise)
    shows: quantities.PartOfRise = 1.0
    #: σ of that part, relative; – is `tolerance.gain`
    shows_tolerance: quantities.Share | None = None
    #: displacement: σ of its noise
    noise_um: Annotated[quantities.Positive, Field(ge=1e-4, le=1000)] = 1.0
    #: displacement: σ of its zero
    zero_um: Annotated[quantities.NonNegative, Field(le=10_000)] = 5.0


class Sensor(Measuring):
    """A thermocouple on the screw or on a node beside it, or a sensor of the thermal error: a probe, a laser.

    An infrared sensor or a sliding contact is a thermocouple that shows a part of the rise above the air.
    Exactly one of `position_m` and `on` is needed, unless a displacement measures `along` a nut's way.
    """

    name: quantities.Name  #: names the columns of its innovation and quality
    #: `"temperature"`, or `"displacement"`: [the thermal error](../how-to/probe.md), positive away from x = 0
    kind: SensorKind = "temperature"
    channel: quantities.Channel  #: its channel; the name of a displacement ends in `_um`, `_mm` or `_m`
    position_m: quantities.Position | None = None  #: its position on the screw
    on: quantities.Name | None = None  #: the node it sits on
    occasional: quantities.Flag = False  #: displacement: comes only now and then, as in a probing cycle
    #: displacement: the nut at which it measures, in place of `position_m`: [a
    #: scale](../how-to/probe.md#a-scale-beside-the-axis)
    along: quantities.Name | None = None

    @model_validator(mode="after")
    def _keys_of_its_kind(self) -> Sensor:
        refuse_foreign_keys(self, self.kind)
        if self.along is None and (self.position_m is None) == (self.on is None):
            raise ValueError("give exactly one of position_m and on")
        if self.along is not None and self.position_m is not None and self.channel == self.measured_channel:
            raise ValueError("along says where it measures; remove position_m, or along")
        if self.kind == "displacement" and unit_of(self.channel) not in LENGTHS:
            raise ValueError(
                f'channel "{self.channel}" of a displacement is to end in its unit, _um, _mm or _m; '
                "rename it, or read it by [log.columns]"
            )
        return self

    @property
    def sees_the_screw(self) -> bool:
        """Whether it measures the temperature of the screw itself."""
        return self.kind == "temperature" and self.on is None

    @property
    def measured_channel(self) -> str:
        """The channel of its readings; without the number of the place for a sensor along a nut's way."""
        return self.channel if self.along is None else _OF_PLACE.sub("", self.channel)

    @property
    def probing_s(self) -> float | None:
        """Interval of an occasional displacement's readings, s; None for any other sensor."""
        if not self.occasional:
            return None
        return PROBING_S if self.along is None else PASSING_S

    @property
    def channel_scale(self) -> float:
        """Factor from the channel's unit to K, or for a displacement to µm."""
        return BY_SUFFIX[unit_of(self.channel)].to_base(1e6) if self.kind == "displacement" else 1.0

    @property
    def noise(self) -> float:
        """Standard deviation of its noise, K, or µm for a displacement."""
        return self.noise_um if self.kind == "displacement" else self.noise_K

    def offset(self, usual_K: float) -> float:
        """Return σ of its offset, K, or of its zero, µm, for a displacement.

        Args:
            usual_K: σ of thermocouples without their own, K.
        """
        if self.kind == "displacement":
            return self.zero_um
        return usual_K if self.offset_K is None else self.offset_K

    @property
    def unit(self) -> str:
        """Unit of its innovation in results: `um` for a displacement, else `K`."""
        return "um" if self.kind == "displacement" else "K"


_OF_PLACE = re.compile(r"_\d+(?=_(?:um|mm|m)$)")


def placed_along(sensor: dict[str, Any], sources: list[Any]) -> list[dict[str, Any]]:
    """Return the sensors that replace one measuring along a nut's way, one at each of five places of the
    stroke.

    A table of another kind, or with a channel without a unit of length, is returned unchanged. Its own checks
    then reject it.

    Args:
        sensor: The sensor's table as read, with `along`.
        sources: The sources' tables as read.

    Raises:
        ValueError: If `along` names no nut with a stroke and a position channel, or if the sensor is
            `occasional`.
    """
    nuts = {
        str(one.get("name")): one["stroke_m"]
        for one in sources
        if isinstance(one, dict) and one.get("stroke_m") and one.get("position_channel")
    }
    name, channel = sensor.get("name"), str(sensor.get("channel"))
    if sensor.get("kind") != "displacement" or unit_of(channel) not in LENGTHS:
        return [sensor]  # it is refused by itself
    if (stroke_m := nuts.get(str(sensor["along"]))) is None:
        nut_names = ", ".join(nuts) or "none yet"
        raise ValueError(
            f'sensor {name}: along names "{sensor["along"]}", which is no nut with stroke_m and '
            f"position_channel; the nuts are: {nut_names}"
        )
    if sensor.get("occasional"):
        raise ValueError(f"sensor {name}: along is read whenever the nut passes; remove occasional")
    stem, _, unit = channel.rpartition("_")
    low_m, high_m = map(float, stroke_m)
    return [
        sensor
        | {
            "name": f"{name}_{k}",
            "channel": f"{stem}_{k}_{unit}",
            "position_m": round(low_m + part * (high_m - low_m), 6),
            "occasional": True,
        }
        for k, part in enumerate(PASSED, 1)
    ]
