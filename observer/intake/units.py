"""Units as recorders write them, and their conversion to those of the channels.

Common units are recognised by their usual spellings. pint converts the others, and is imported only for that.
"""

from __future__ import annotations

import re
from functools import cache
from typing import Any

import numpy as np

from observer.align.plausibility import UNIT_OF_KIND, ChannelKind
from observer.errors import LogError
from observer.frames import FloatArray
from observer.units import BY_NAME, BY_SUFFIX, spelled

_NO_UNIT = ("", "-", "--", "–", "1", "none", "(none)", "n/a", "na", "ts", "rn", "count")
"""What recorders write in place of a unit where a column has none."""
_IN_BRACKETS = re.compile(r"^(?P<name>.*?)\s*[\[({<](?P<unit>[^\[\](){}<>]{1,80})[\])}>]\s*$")
_MARKS = re.compile(r"\s+/\s*|\s*,\s*|\s+in\s+|\s+|(?<=\w)/(?=[°º˚])|^(?=[^\W\d]\w*/)\w+(?P<slash>/)", re.I)
_TEMPERATURE = re.compile(r"^(?P<name>.*temp(?:eratur(?:e)?)?)[ .]?(?P<unit>[CFK])$", re.I)
_LONGEST_UNIT = 24


def known_unit(written: str) -> str:
    """Return the unit of which a text is a usual spelling, such as `degC` for `°C`; empty if it is not
    one.
    """
    unit = spelled(written)
    return "" if unit is None else unit.name


def says_no_unit(written: str) -> bool:
    """Return whether a text is a recorder's mark for a missing unit, such as `-` or `(None)`."""
    return written.strip().casefold() in _NO_UNIT


def shown_unit(unit: str) -> str:
    """Return a unit as people write it, such as `°C` for `degC`; one that is not in the table stays as it
    is.
    """
    return BY_NAME[unit].shown if unit in BY_NAME else unit


def split_name(name: str) -> tuple[str, str]:
    """Return a column's name without the unit at its end, and that unit as written.

    Units are found in brackets, after a suffix `_degC`, after a slash, a comma or `in`, and in names such as
    `TempC`. The unit is empty where the name has none.
    """
    match = _IN_BRACKETS.match(name)
    if match and known_unit(match["unit"]):
        return match["name"].strip(), match["unit"].strip()
    if match:
        stem, unit = _split_plain(match["name"])
        if unit:
            return f"{stem} ({match['unit'].strip()})", unit
        if len(match["unit"]) <= _LONGEST_UNIT and not match["unit"].strip().isdigit():
            return match["name"].strip(), match["unit"].strip()
        return name.strip(), ""
    return _split_plain(name)


def _split_plain(name: str) -> tuple[str, str]:
    """Return a name without brackets, without the unit at its end, and that unit."""
    stem, _, last = name.rpartition("_")
    if stem and last in BY_SUFFIX:
        return stem, last
    for mark in _MARKS.finditer(name):
        unit = name[mark.end() :]
        start = mark.start("slash") if mark["slash"] else mark.start()
        if start > 0 and (len(unit.strip()) > 1 or mark[0].strip()) and known_unit(unit):
            return name[:start].strip(), unit.strip()
    if match := _TEMPERATURE.match(name.strip()):
        return match["name"], match["unit"]
    is_unit = len(name.strip()) > 1 and known_unit(name) in ("degC", "degF", "kelvin")
    return name.strip(), name.strip() if is_unit else ""


def unit_of_channel(channel: str, kind: ChannelKind) -> str:
    """Return the unit at the end of a channel's name, else the unit of its kind; empty for neither."""
    return known_unit(split_name(channel)[1]) or UNIT_OF_KIND[kind]


@cache
def _registry() -> Any:
    import pint  # noqa: PLC0415 - takes a second, and most logs need no conversion

    return pint.UnitRegistry(cache_folder=None)


@cache
def resolved(written: str) -> str:
    """Return the unit that a text means, for pint; empty for a mark of no unit.

    Results are cached. pint is imported only for a text that is not a usual spelling.

    Raises:
        LogError: The unit is unknown.
    """
    if says_no_unit(written):
        return ""
    if unit := known_unit(written):
        return unit
    import pint  # noqa: PLC0415

    try:
        return str(_registry().Unit(written))
    except (pint.PintError, ValueError, TypeError, AssertionError, AttributeError):
        raise LogError(f'"{written}" is not a known unit; write it as degC, degF, mm, 1/min, kW …') from None


def fits(unit: str, to: str) -> bool:
    """Return whether values in one unit, both as `resolved` gives them, can be converted to the other.

    An empty unit fits every other, since its values are taken as they are.
    """
    if unit == to or not unit or not to:
        return True
    return bool(_registry().Unit(unit).is_compatible_with(_registry().Unit(to)))


def converted(values: FloatArray, unit: str, to: str) -> FloatArray:
    """Return values converted from one unit to another.

    Values stay as they are if either unit is empty. Temperatures are converted with their offsets.

    Args:
        values: Values (n,), NaN where missing.
        unit: Their unit, as `resolved` gives it.
        to: The other unit, as `resolved` gives it; `fits` tells whether that is possible.
    """
    if unit == to or not unit or not to:
        return values
    return np.asarray(_registry().Quantity(values, unit).to(to).magnitude, dtype=np.float64)


def factor(unit: str, to: str) -> float:
    """Return the factor from one unit to the other, both without an offset, such as 60 from `min` to `s`."""
    return float(converted(np.ones(1), unit, to)[0])
