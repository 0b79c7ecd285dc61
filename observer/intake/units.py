"""Units as recorders write them, and their conversion to those of the channels.

Common units are recognised by their usual spellings; pint knows the others, and is imported
only for a conversion.
"""

from __future__ import annotations

import re
from functools import cache
from typing import Any

import numpy as np

from observer.align.plausibility import ChannelKind
from observer.errors import LogError
from observer.frames import FloatArray

_WRITTEN = {
    "degC": "°c c degc deg_c deg.c grad_c gradc celsius ℃ ºc °celsius",
    "degF": "°f f degf deg_f deg.f fahrenheit ℉ ºf °fahrenheit",
    "kelvin": "k kelvin",
    "rpm": "rpm u/min 1/min min-1 min^-1 upm r/min rev/min /min umdr./min",
    "revolution/second": "1/s hz rps rev/s u/s",
    "degree/second": "°/s deg/s",
    "radian/second": "rad/s",
    "m": "m meter metre",
    "mm": "mm",
    "cm": "cm",
    "um": "µm μm um micron",
    "inch": 'in inch inches " zoll',
    "W": "w watt",
    "kW": "kw",
    "N*m": "nm n·m n*m",
    "s": "s sec second seconds sek sekunden",
    "ms": "ms msec milliseconds millisekunden",
    "us": "us µs μs microseconds",
    "ns": "ns",
    "min": "min minutes minuten",
    "h": "h hours std stunden",
    "d": "d days tage",
    "percent": "%",
    "V": "v volt",
    "mV": "mv",
    "A": "a ampere",
    "bar": "bar",
}
_ALIAS = {written: unit for unit, ways in _WRITTEN.items() for written in ways.split()}
_SUFFIXES = ("degC", "degF", "K", "m", "mm", "cm", "um", "in", "rpm", "W", "kW", "Nm", "s", "ms", "us", "ns",
             "min", "h", "V", "mV", "A", "bar", "Hz")  # fmt: skip
_IN_BRACKETS = re.compile(r"^(?P<name>.*?)\s*[\[({<](?P<unit>[^\[\](){}<>]{1,24})[\])}>]\s*$")
_AFTER_MARK = re.compile(
    r"^(?P<name>.*?)(?:\s+/\s+|\s*,\s+|\s+in\s+|\s+)(?P<unit>[^\s,/]{1,10}(?:/(?:min|s|h))?)$"
)
EXPECTED = dict.fromkeys(ChannelKind, "degC") | {
    ChannelKind.POSITION: "m",
    ChannelKind.DISPLACEMENT: "m",
    ChannelKind.SPEED: "rpm",
    ChannelKind.OTHER: "",
}
"""The unit of a channel whose name does not give it."""
_PLAIN = {"degC": "°C", "degF": "°F", "kelvin": "K", "um": "µm", "percent": "%", "N*m": "Nm"}


def known_unit(written: str) -> str:
    """The unit of which a text is a usual spelling; empty where it is none."""
    return _ALIAS.get(written.strip().casefold().replace(" ", "_"), "")


def shown_unit(unit: str) -> str:
    """A unit as people write it."""
    return _PLAIN.get(unit, unit)


def split_name(name: str) -> tuple[str, str]:
    """A column's name without the unit that it ends in, and that unit as written; empty where it has none."""
    if found := _IN_BRACKETS.match(name):
        return found["name"].strip(), found["unit"].strip()
    stem, _, last = name.rpartition("_")
    if stem and last in _SUFFIXES:
        return stem, last
    if (found := _AFTER_MARK.match(name)) and known_unit(found["unit"]) and len(found["unit"]) > 1:
        return found["name"].strip(), found["unit"]
    return name.strip(), ""


def unit_of_channel(channel: str, kind: ChannelKind) -> str:
    """The unit that a channel's name ends in, else that of what it measures; empty where neither says."""
    return known_unit(split_name(channel)[1]) or EXPECTED[kind]


@cache
def _registry() -> Any:
    import pint  # noqa: PLC0415 - takes a second, and most logs need no conversion

    return pint.UnitRegistry(cache_folder=None)


@cache
def resolved(written: str) -> str:
    """The unit that a text means, for pint. Raises `LogError` for an unknown one."""
    if unit := known_unit(written):
        return unit
    import pint  # noqa: PLC0415

    try:
        return str(_registry().Unit(written))
    except (pint.PintError, ValueError, TypeError, AssertionError, AttributeError):
        raise LogError(f'"{written}" is not a known unit; write it as degC, degF, mm, 1/min, kW …') from None


def fits(unit: str, to: str) -> bool:
    """Whether values in one unit, both as `resolved` gives them, can be converted to the other."""
    if unit == to or not unit or not to:
        return True
    return bool(_registry().Unit(unit).is_compatible_with(_registry().Unit(to)))


def converted(values: FloatArray, unit: str, to: str) -> FloatArray:
    """Convert values (n,) from one unit to another, both as `resolved` gives them; unknown ones stay."""
    if unit == to or not unit or not to:
        return values
    return np.asarray(_registry().Quantity(values, unit).to(to).magnitude, dtype=np.float64)


def factor(unit: str, to: str) -> float:
    """The factor from one unit to the other."""
    return float(converted(np.ones(1), unit, to)[0])
