"""Parsers of typed lengths, places, temperatures, screws and names, as a configuration needs them.

A number alone is in the unit that was asked for, and a decimal comma counts as a point. Every function raises
`ValueError` with the reason, in words for the person who typed.
"""

from __future__ import annotations

import re
import unicodedata

from observer.units import BY_NAME, spelled

_NUMBER = r"\d+(?:\.\d+)?(?:e[+-]?\d+)?"
_UNIT = r"[a-zµ\"]+"
_ITEM = re.compile(rf"({_NUMBER})\s*({_UNIT})?", re.IGNORECASE)
_LIST = re.compile(rf"{_ITEM.pattern}(?:[\s;]+{_ITEM.pattern})*", re.IGNORECASE)
_DEGC = re.compile(r"([+-]?\d+(?:\.\d+)?)\s*(?:°\s*)?(degc|c|degf|f|k)?", re.IGNORECASE)
_SPELT = str.maketrans({"ä": "ae", "ö": "oe", "ü": "ue", "ß": "ss", "ø": "oe", "æ": "ae", "å": "aa"})
MOST_M = 20.0
"""No ball screw is longer."""


def number(text: str) -> float:
    """Return one number, with a decimal point or comma.

    Raises:
        ValueError: The text is not a number.
    """
    try:
        return float(text.strip().replace(",", "."))
    except ValueError:
        raise ValueError("give a number, such as 1000 or 0.5") from None


def length_m(text: str) -> float:
    """Return one length in m: `1000 mm`, `1,0` and `1 m` are the same.

    Raises:
        ValueError: The text is not a length, or exceeds 20 m.
    """
    match = re.fullmatch(_ITEM, text.strip().replace(",", "."))
    if match is None:
        raise ValueError("give a length with its unit, such as 1000 mm or 1.0 m")
    return _in_m(match[1], match[2] or "m")


def places_m(text: str, count: int | None = None) -> tuple[float, ...]:
    """Return several lengths in m: `50, 500, 950 mm`, `0,15 0,80`.

    The last unit holds for all without one. A comma separates where a blank follows it, or where nothing else
    separates.

    Args:
        text: The typed text.
        count: Their number; None for any.

    Raises:
        ValueError: A length is invalid, their number is wrong, or both readings of a comma are possible.
    """
    between = r"(?<=[\w\"])\s*(?:-|–|…|\.\.+|\bto\b|\bbis\b|\band\b|\bund\b)\s*(?=\d)"
    plain = re.sub(r",\s+", "; ", re.sub(between, " ", text.strip()))
    decimal, separated = plain.replace(",", "."), plain.replace(",", " ")
    commas, others = plain.count(","), re.search(rf"\d\s*(?:{_UNIT})?\s*[\s;]\s*\d", plain)
    readings = [r for r in (decimal, separated) if re.fullmatch(_LIST, r)] if commas else [plain]
    if len(readings) > 1 and others:
        readings = [decimal]
    lists = [_ITEM.findall(r) if re.fullmatch(_LIST, r) else [] for r in readings]
    lists = [number_units for number_units in lists if number_units and count in (None, len(number_units))]
    if len(lists) > 1:
        one, two = (" ".join(value for value, _ in number_units) for number_units in lists)
        raise ValueError(f"is it {one} or {two}? use a decimal point, and separate numbers by spaces")
    if not lists:
        noun = "the places" if count is None else f"{count} places"
        raise ValueError(
            f"write {noun} with their unit, as {'50 500 950' if count is None else '150 800'} mm"
        )
    last = next((unit for _, unit in reversed(lists[0]) if unit), "m")
    return tuple(_in_m(value, unit or last) for value, unit in lists[0])


def _in_m(value: str, unit: str) -> float:
    """Return a length in m from its number and unit."""
    length = spelled(unit)
    if length is None or length.base != "m":
        raise ValueError(f"{unit} is not a unit of length; use m, mm, cm or in")
    found_m = round(length.to_base(float(value)), 9)
    if found_m > MOST_M:
        slip = f"; did you mean {value} mm?" if unit.lower() == "m" else "; check its unit"
        raise ValueError(f"{found_m:g} m is longer than any ball screw{slip}")
    return found_m


def degC(text: str) -> float:
    """Return a temperature in °C: `12 °C`, `12,5`, `68 °F`, `293 K`.

    Raises:
        ValueError: The text is not a temperature.
    """
    match = re.fullmatch(_DEGC, text.strip().replace(",", "."))
    if match is None:
        raise ValueError("give a temperature with its unit, such as 21.5 °C, or input")
    unit = spelled(match[2] or "degC") or BY_NAME["degC"]
    return round(unit.to_base(float(match[1])), 6)


def screw_name(text: str) -> str:
    """Return nominal diameter and lead in the catalogue's spelling: `40 x 10` becomes `40x10`, `16x2,5 mm`
    `16x2.5`.

    Other text is returned without its outer blanks, for `size_of` to refuse.
    """
    number = r"(\d+(?:[.,]\d+)?)"
    match = re.fullmatch(rf"ø?\s*{number}\s*(?:mm)?\s*[x×*/]\s*{number}\s*(?:mm)?", text.strip().lower())
    if match is None:
        return text.strip()
    return "x".join(f"{float(size.replace(',', '.')):g}" for size in match.groups())


def is_serial(place: str) -> bool:
    """Return whether an address is that of a serial port: `/dev/…` or `COM…`."""
    return place.startswith("/") or place.upper().startswith("COM")


def key_name(text: str) -> str:
    """Return a valid name for Zenoh keys: `Drehmaschine 7` becomes `drehmaschine-7`; valid names are
    unchanged.

    Raises:
        ValueError: The text has no letter or digit.
    """
    text = text.strip()
    if re.fullmatch(r"[A-Za-z0-9_.-]{1,64}", text):
        return text
    plain = unicodedata.normalize("NFKD", text.lower().translate(_SPELT)).encode("ascii", "ignore").decode()
    name = re.sub(r"[^a-z0-9_.]+", "-", plain).strip("-.")[:64]
    if not name:
        raise ValueError("nothing is left of the name; use letters or digits")
    return name
