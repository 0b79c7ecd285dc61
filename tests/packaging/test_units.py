"""The one table of units agrees with pint, and has each suffix and each spelling once."""

from __future__ import annotations

import pint
import pytest

from observer.units import BY_SUFFIX, SYMBOLS, UNITS, spelled, symbol_of, unit_of

REGISTRY = pint.UnitRegistry(cache_folder=None)
CONVERTIBLE = [unit for unit in UNITS if unit.base and not unit.name.startswith("0.")]


@pytest.mark.parametrize("unit", CONVERTIBLE, ids=lambda unit: unit.name)
def test_values_convert_as_pint_converts_them(unit) -> None:
    expected = REGISTRY.Quantity(7.5, unit.name).to(unit.base).magnitude
    assert unit.to_base(7.5) == pytest.approx(expected, rel=1e-12)


def test_each_suffix_and_spelling_is_listed_once() -> None:
    for field in ("suffixes", "spellings"):
        texts = [text for unit in UNITS for text in getattr(unit, field).split()]
        assert len(texts) == len(set(texts)), field


@pytest.mark.parametrize(
    ("text", "name"),
    [
        ("°C", "degC"),
        ("Â°F", "degF"),
        ("U/min", "rpm"),
        ("µm", "um"),
        ("[mm]", "mm"),
        ("Zoll", "inch"),
        ("REVOLUTION/MINUTE", "rpm"),
        ("MILLIMETER/SECOND^2", "mm/s^2"),
        ("NEWTON_METER", "N*m"),
    ],
)
def test_recorders_spellings_are_recognised(text: str, name: str) -> None:
    unit = spelled(text)
    assert unit is not None
    assert unit.name == name


def test_an_unknown_spelling_is_no_unit() -> None:
    assert spelled("MW") is None
    assert spelled("furlong") is None


def test_the_end_of_a_name_is_its_unit() -> None:
    assert (unit_of("heat_nut_W"), symbol_of("field_500_degC")) == ("W", "°C")
    assert (unit_of("quality_t1"), unit_of("W"), unit_of("pressure_bar")) == ("", "", "")
    assert SYMBOLS["W_m2K"] == "W/(m² K)"
    assert BY_SUFFIX["F"].name == "degF"
