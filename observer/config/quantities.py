"""The base of all tables of the configuration, and their kinds of names and numbers.

A number must be written as a number: `true` and `"1.0"` are rejected. Every kind has hard bounds, orders of
magnitude beyond any machine, so that nothing absurd reaches the mathematics. Possible values that look like a
unit error are reported by `report.doubts`.
"""

from __future__ import annotations

import unicodedata
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, model_validator

NEGLIGIBLE = 1e-12
"""Whatever is nearer to 0 counts as 0: no quantity here is that small, but denormal numbers overflow."""
OWN_COLUMNS = ("time_s", "late_s", "step", "flags")
"""Columns of a recording that are no channels."""
_SEPARATORS = "=;,\"'"


def bounds_validator(
    low: float, high: float, quantity: str, *, or_zero: bool = False
) -> Callable[[float], float]:
    """Return a validator for the hard bounds of a quantity.

    The validator raises `ValueError` beyond the bounds, and names the quantity and both of them.

    Args:
        low: Smallest valid value.
        high: Largest valid value.
        quantity: Name of the quantity with its unit, for the message.
        or_zero: Whether 0 is also valid; values within `NEGLIGIBLE` of it then become 0.
    """

    def checked(value: float) -> float:
        if or_zero and abs(value) < NEGLIGIBLE:
            return 0.0
        if not low <= value <= high:
            raise ValueError(f"{value:g} is no {quantity}, which lies between {low:g} and {high:g}")
        return value

    return checked


def checked_channel(name: str) -> str:
    """Return the channel's name unchanged.

    Args:
        name: The name as configured.

    Raises:
        ValueError: If it is a column of recordings, begins as a command does, or contains separators, control
            characters or blanks at an end.
    """
    shown = repr(name[:40])
    if name in OWN_COLUMNS:
        raise ValueError(f"{shown} is a column of the recordings themselves; give the channel another name")
    if name.startswith("command:"):
        raise ValueError(f"{shown} begins as commands do in recordings; give the channel another name")
    if any(unicodedata.category(c).startswith("C") or c in _SEPARATORS for c in name) or name != name.strip():
        raise ValueError(
            f"{shown} holds a control character, a quote, one of = ; , or blanks at an end; use letters, "
            "digits, _ . and -"
        )
    return name


def checked_path(path: Path) -> Path:
    """Return the path unchanged; whether a file exists there is not checked.

    Raises:
        ValueError: If it is longer than 4096 characters, or contains a control character.
    """
    if "\0" in str(path) or len(str(path)) > 4096:
        raise ValueError(f"{str(path)[:40]!r} is no path of a file; fix it")
    if any(unicodedata.category(c) == "Cc" for c in str(path)):
        raise ValueError(
            f"{str(path)[:40]!r} holds a tab or a line break, made by a backslash and the letter behind it; "
            "write / instead"
        )
    return path


def checked_host(host: str) -> str:
    """Return the host's name or address unchanged.

    Raises:
        ValueError: If it includes a scheme or a port.
    """
    name = host.rpartition("://")[2].rstrip("/")
    computer, colon, port = name.rpartition(":")
    if colon and ":" not in computer and port.isdigit():
        raise ValueError(f'{host!r} holds the port as well; write "{computer}", and port = {port}')
    if name != host:
        raise ValueError(f'{host!r} is more than a computer\'s name or address; write "{name}"')
    return host


Number = Annotated[float, Field(strict=True, allow_inf_nan=False)]
Count = Annotated[int, Field(strict=True)]
Flag = Annotated[bool, Field(strict=True)]
File = Annotated[Path, AfterValidator(checked_path)]

Name = Annotated[str, Field(pattern=r"^[A-Za-z0-9_.-]+$", max_length=64)]
Channel = Annotated[str, Field(min_length=1, max_length=128), AfterValidator(checked_channel)]

Positive = Annotated[
    Number, Field(gt=0), AfterValidator(bounds_validator(NEGLIGIBLE, 1e18, "positive quantity"))
]
NonNegative = Annotated[
    Number, Field(ge=0), AfterValidator(bounds_validator(0.0, 1e12, "quantity", or_zero=True))
]
Finite = Annotated[Number, AfterValidator(bounds_validator(-1e12, 1e12, "quantity", or_zero=True))]
Share = Annotated[NonNegative, Field(le=1)]
Temperature = Annotated[Number, Field(gt=-273.15, lt=2000)]

ScrewLength = Annotated[Positive, AfterValidator(bounds_validator(1e-3, 100.0, "length in m of a screw"))]
Diameter = Annotated[Positive, AfterValidator(bounds_validator(1e-4, 5.0, "diameter in m"))]
Bore = Annotated[NonNegative, AfterValidator(bounds_validator(0.0, 5.0, "diameter in m"))]
Length = Annotated[Positive, AfterValidator(bounds_validator(1e-9, 100.0, "length in m"))]
Lead = Annotated[Positive, AfterValidator(bounds_validator(1e-5, 1.0, "lead in m"))]
Position = Annotated[NonNegative, AfterValidator(bounds_validator(0.0, 100.0, "position in m"))]
Area = Annotated[Positive, AfterValidator(bounds_validator(1e-12, 1e4, "area in m²"))]
Conductivity = Annotated[Positive, AfterValidator(bounds_validator(1e-3, 1e4, "conductivity in W/mK"))]
Density = Annotated[Positive, AfterValidator(bounds_validator(100.0, 30e3, "density in kg/m³"))]
SpecificHeat = Annotated[Positive, AfterValidator(bounds_validator(10.0, 2e4, "specific heat in J/kgK"))]
Expansion = Annotated[Positive, AfterValidator(bounds_validator(1e-9, 1e-3, "expansion coefficient in 1/K"))]
Film = Annotated[NonNegative, AfterValidator(bounds_validator(0.0, 1e6, "film in W/m²K", or_zero=True))]
LEAST_END_FILM_W_m2K = 1e-6
EndFilm = Annotated[Positive, AfterValidator(bounds_validator(LEAST_END_FILM_W_m2K, 1e8, "film in W/m²K"))]
Air = Annotated[Temperature, AfterValidator(bounds_validator(-100.0, 200.0, "air temperature in °C"))]
Torque = Annotated[
    NonNegative, AfterValidator(bounds_validator(0.0, 1e4, "friction torque in Nm", or_zero=True))
]
HeatPerSpeed = Annotated[
    NonNegative, AfterValidator(bounds_validator(0.0, 1e3, "heat in W/rpm", or_zero=True))
]
Heat = Annotated[Finite, AfterValidator(bounds_validator(-1e6, 1e6, "heat in W"))]
HeatSigma = Annotated[NonNegative, AfterValidator(bounds_validator(0.0, 1e6, "heat in W", or_zero=True))]
Speed = Annotated[NonNegative, AfterValidator(bounds_validator(0.0, 1e6, "speed in rpm", or_zero=True))]
Noise = Annotated[Positive, AfterValidator(bounds_validator(1e-6, 20.0, "noise in K"))]
Rise = Annotated[Positive, AfterValidator(bounds_validator(1e-6, 1e3, "temperature difference in K"))]
Duration = Annotated[Positive, AfterValidator(bounds_validator(1e-6, 1e9, "time in s"))]
Capacity = Annotated[Positive, AfterValidator(bounds_validator(1e-6, 1e9, "heat capacity in J/K"))]
Conductance = Annotated[Positive, AfterValidator(bounds_validator(1e-9, 1e7, "conductance in W/K"))]
PartOfRise = Annotated[Positive, AfterValidator(bounds_validator(0.02, 2.0, "part of a rise"))]
Factor = Annotated[NonNegative, AfterValidator(bounds_validator(0.0, 1e6, "factor", or_zero=True))]


def all_or_none(*keys: str) -> Any:
    """Return a validator of a table that rejects some of these keys without the others.

    Args:
        *keys: Two keys or more; None counts as not given.
    """

    def check(table: BaseModel) -> BaseModel:
        if 0 < sum(getattr(table, key) is not None for key in keys) < len(keys):
            names = f"{', '.join(keys[:-1])} and {keys[-1]}"
            rule = "both or neither" if len(keys) == 2 else "all or none"
            raise ValueError(f"{names} belong together; give {rule}")
        return table

    return model_validator(mode="after")(check)


def exactly_one(one: str, other: str) -> Any:
    """Return a validator of a table that rejects both keys together, and none of them.

    Args:
        one: A key; None counts as not given.
        other: The other key.
    """

    def check(table: BaseModel) -> BaseModel:
        if (getattr(table, one) is None) == (getattr(table, other) is None):
            raise ValueError(f"give exactly one of {one} and {other}")
        return table

    return model_validator(mode="after")(check)


def _same(value: Any, default: Any) -> bool:
    """Whether a value is its key's default, of its kind: true is not 1, but 1 is 1.0."""
    numbers = (int, float)
    alike = type(value) is type(default) or (type(value) in numbers and type(default) in numbers)
    return alike and bool(value == default)


class Section(BaseModel):
    """A table of the configuration: frozen, with unknown keys rejected.

    A key that repeats its default counts as not given, so a configuration that was written and read back is
    the same.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", strict=False)

    @model_validator(mode="before")
    @classmethod
    def _without_defaults(cls, table: Any) -> Any:
        """Leave out keys that repeat their default: a configuration that was read back is the same."""
        if not isinstance(table, dict):
            return table
        default = {field.alias or key: field.default for key, field in cls.model_fields.items()}
        return {
            key: value for key, value in table.items() if key not in default or not _same(value, default[key])
        }
