"""Whether one value of a channel can be right, by what the channel measures."""

from __future__ import annotations

from observer.config import Config
from observer.sections import Source

TEMPERATURE_DEGC = (-40.0, 150.0)
FASTEST_RPM = 30e3


def implausible(config: Config, channel: str, value: float) -> str | None:
    """Return why a value cannot be right, with the unit that it is probably in; None where it may be."""
    if channel in _temperatures(config):
        return _temperature(value)
    for source in config.source:
        if channel == source.position_channel:
            return _position(source, config.screw.length_m, value)
        if channel in (source.speed_channel, source.nut_speed_channel) and abs(value) > FASTEST_RPM:
            return f"faster than {FASTEST_RPM:g} rpm; is it in 1/min?"
    return None


def _temperatures(config: Config) -> set[str | None]:
    ends = (config.boundary.left, config.boundary.right)
    return {s.channel for s in config.sensor} | {config.ambient.channel} | {e.channel for e in ends}


def _temperature(value: float) -> str | None:
    low, high = TEMPERATURE_DEGC
    if low <= value <= high:
        return None
    for unit, degC in (("K", value - 273.15), ("°F", (value - 32) / 1.8), ("0.1 °C", value / 10)):
        if 0.0 <= degC <= 100.0:
            return f"outside {low:g} to {high:g} °C; is it in {unit}?"
    return f"outside {low:g} to {high:g} °C; check scale and offset"


def _position(source: Source, length_m: float, value: float) -> str | None:
    low, high = source.stroke_m or (0.0, length_m)
    spare = 0.05 * length_m
    if low - spare <= value <= high + spare:
        return None
    place = "the stroke" if source.stroke_m else "the screw"
    for unit, factor in (("mm", 1e-3), ("µm", 1e-6)):
        if low <= factor * value <= high:
            return f"outside {place}, {low:g} to {high:g} m; is it in {unit}?"
    return f"outside {place}, {low:g} to {high:g} m; check scale and offset"
