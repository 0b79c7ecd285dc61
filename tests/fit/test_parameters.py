from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from observer.errors import ConfigError
from observer.fit.parameters import FILM, candidates, free_keys, get, kind_of, replaced
from observer.installation import Installation
from tests.discovery.cases import machine

CONVECTIVE = {"right": {"kind": "convective", "coefficient_W_m2K": 50.0}}


@given(st.data())
def test_a_replaced_value_is_read_back_and_nothing_else_changes(data: st.DataObject) -> None:
    config = machine(boundary=CONVECTIVE)
    keys = candidates(config)
    key = data.draw(st.sampled_from(keys))
    kind = kind_of(key)
    value = data.draw(st.floats(max(kind.low, 1e-6), kind.high))
    other = replaced(config, {key: value})
    assert get(other, key) == value
    assert {k: get(other, k) for k in keys if k != key} == {k: get(config, k) for k in keys if k != key}


def test_the_candidates_are_what_this_configuration_has() -> None:
    keys = candidates(machine(boundary=CONVECTIVE))
    assert "boundary.right.coefficient_W_m2K" in keys
    assert "boundary.left.coefficient_W_m2K" not in keys  # insulated
    assert "source.bearing.l.heat_W_rpm" in keys  # a name with a dot in it
    assert "source.heater.heat_W_rpm" not in keys  # its heat is measured
    assert not any(key.startswith("sensor") for key in keys)


def test_by_default_the_film_and_the_scales_of_the_laws_are_free() -> None:
    assert free_keys(machine()) == (FILM, "source.heater.scale", "source.bearing.l.scale")
    assert FILM not in free_keys(machine(surface={"convection_W_m2K": 0.0}))


@pytest.mark.parametrize(
    ("key", "remedy"),
    [
        ("surface.convection_W_mK", "did you mean surface.convection_W_m2K?"),
        ("sensor.a.position_m", "choose among surface.convection_W_m2K, "),
        ("source.spindle.scale", "source.heater.scale"),
    ],
)
def test_a_key_that_cannot_be_free_is_refused_with_those_that_can(key: str, remedy: str) -> None:
    with pytest.raises(ConfigError) as refused:
        free_keys(machine(calibrate={"free": [key]}))
    assert f'"{key}"' in str(refused.value)
    assert remedy in str(refused.value)


def test_a_value_out_of_range_is_refused() -> None:
    with pytest.raises(ConfigError, match="convection_W_m2K"):
        replaced(machine(), {FILM: -1.0})


def test_the_wires_of_a_configuration_stay_when_a_value_is_replaced() -> None:
    """A register's name in the file is not its name in the code."""
    wires = {"tc": {"kind": "modbus_tcp", "host": "h", "channels": {"a_degC": {"register": 3, "scale": 0.1}}}}
    config = machine(drivers=wires)
    other = replaced(config, {FILM: 12.0})
    assert isinstance(other, Installation)
    assert other.drivers == config.drivers
    assert get(other, FILM) == 12.0
