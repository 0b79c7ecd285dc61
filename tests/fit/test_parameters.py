from __future__ import annotations

import tomllib

import pytest
import tomlkit
from hypothesis import given
from hypothesis import strategies as st

from observer.config.machine import Config
from observer.errors import ConfigError
from observer.fit.parameters import (
    FILM,
    PARAMETERS,
    bounds_of,
    candidates,
    free_keys,
    get,
    info_of,
    replaced,
    rounded,
    scale_of,
    with_values,
)
from observer.fit.tolerance import remaining_tolerances, tolerances
from observer.installation import Installation, parse, write_back
from observer.model.network import conductance_W_K
from tests.logs.machines import machine, table

FRICTION = {"name": "nut", "shape": "point", "position_m": 0.2, "speed_channel": "n_rpm", "torque_Nm": 0.4}
CONVECTIVE = {"right": {"kind": "convective", "coefficient_W_m2K": 50.0}}


@given(st.data())
def test_a_replaced_value_is_read_back_and_nothing_else_changes(data: st.DataObject) -> None:
    config = machine(boundary=CONVECTIVE)
    keys = candidates(config)
    key = data.draw(st.sampled_from(keys))
    kind = info_of(key)
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
        ("bed.expansion_1_K", "it has no [bed]; give one"),
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


def with_a_torque() -> Config:
    return machine(source=[*table()["source"], FRICTION], boundary=CONVECTIVE)


@pytest.mark.parametrize("key", candidates(with_a_torque()))
def test_a_value_that_is_put_is_the_same_as_one_that_is_replaced(key: str) -> None:
    config = with_a_torque()
    value = 0.5 * get(config, key)
    quick, checked = with_values(config, {key: value}), replaced(config, {key: value})
    assert get(quick, key) == value
    assert quick.model_dump() == checked.model_dump()


@pytest.mark.parametrize(
    ("key", "small", "low", "high"),
    [
        (FILM, 1.0, 0.0, 1000.0),
        ("surface.factor", 0.1, 1e-3, 100.0),
        ("boundary.right.coefficient_W_m2K", 10.0, 1e-3, 1e5),
        ("screw.diameter_m", 0.002, 1e-3, 1.0),
        ("screw.conductivity_W_mK", 2.0, 1.0, 1000.0),
        ("screw.density_kg_m3", 200.0, 500.0, 25_000.0),
        ("screw.specific_heat_J_kgK", 20.0, 50.0, 5000.0),
        ("source.nut.torque_Nm", 0.02, 0.0, 1000.0),
        ("source.nut.share", 0.05, 0.0, 1.0),
        ("source.bearing.l.heat_W_rpm", 0.001, 0.0, 100.0),
        ("source.nut.scale", 0.1, 0.0, 100.0),
    ],
)
def test_a_parameter_is_sought_within_its_bounds_in_steps_of_its_size(
    key: str, small: float, low: float, high: float
) -> None:
    """Its own size or, where it is next to nothing, a fifth of a change that matters."""
    config = with_a_torque()
    if key == "surface.factor":
        config = config.model_copy(
            update={"surface": config.surface.model_copy(update={"law": "laminar", "factor": 1.0})}
        )
    assert bounds_of(config, key) == (low, high)
    assert scale_of(with_values(config, {key: 2 * small}), key) == pytest.approx(2 * small)
    assert scale_of(with_values(config, {key: 0.0}), key) == pytest.approx(small)
    beyond = with_values(config, {key: 2 * high})
    assert bounds_of(beyond, key) == (low, 2 * high), "a configured value is always within"
    assert bounds_of(with_values(config, {key: low - 1.0}), key) == (low - 1.0, high)


def test_every_kind_of_parameter_is_positive_and_has_a_size() -> None:
    for kinds in PARAMETERS.values():
        for kind in kinds.values():
            assert 0.0 <= kind.low < kind.high
            assert kind.scale > 0.0


@pytest.mark.parametrize(
    ("value", "shown"),
    [
        (123456.7, 123460.0), (0.001234567, 0.0012346), (-9.999996, -10.0), (99999.4, 99999.0), (0.0, 0.0),
        (float("inf"), float("inf")), (1.0, 1.0),
    ],
)  # fmt: skip
def test_five_digits_are_kept(value: float, shown: float) -> None:
    assert rounded(value) == shown


NODES = """
[[node]]
name = "block.1"
capacity_J_K = 500.0
tolerance = 0.05
[[link]]
between = ["block.1", "heater"]  # its seat
film_W_m2K = 100.0
area_m2 = 0.02
[[link]]
between = ["block.1", "ambient"]
conductance_W_K = 0.4
tolerance = 0.0
"""
SEAT, BLOCK = "link.block.1-heater.factor", "node.block.1.capacity_J_K"


def with_nodes() -> tuple[str, Installation]:
    """A machine with a block beside its screw, as text and as it is checked."""
    text = tomlkit.dumps(table()) + NODES
    return text, parse(tomllib.loads(text))


def test_links_and_nodes_may_be_free_however_they_are_described() -> None:
    text, config = with_nodes()
    assert {SEAT, "link.block.1-ambient.factor", BLOCK} <= set(candidates(config))
    other = replaced(config, {SEAT: 1.5, BLOCK: 450.0})
    assert conductance_W_K(other.link[0]) == pytest.approx(3.0)  # 1.5 · 100 W/m²K · 0.02 m²
    assert other.node[0].capacity_J_K == 450.0
    assert (other.link[1], other.node[0].tolerance) == (config.link[1], 0.05)
    written = write_back(text, {SEAT: 1.5, BLOCK: 450.0, "link.block.1-heater.tolerance": 0.03})
    again = parse(tomllib.loads(written))
    assert (again.link[0].factor, again.link[0].tolerance) == (1.5, 0.03)
    assert again.node == other.node
    assert "# its seat" in written


def test_two_links_between_the_same_places_are_fitted_by_neither() -> None:
    text, _ = with_nodes()
    config = parse(tomllib.loads(text + NODES[NODES.rindex("[[link]]") :]))
    assert "link.block.1-ambient.factor" not in candidates(config)


def test_links_and_nodes_are_allowed_for_within_their_tolerances_unless_they_are_fitted() -> None:
    _, config = with_nodes()
    factors = {changed.link[0].factor for changed, _ in tolerances(config)}
    assert factors == {1.0, 1.2}
    assert {changed.link[1].factor for changed, _ in tolerances(config)} == {1.0}  # taken as exact
    assert 525.0 in {changed.node[0].capacity_J_K for changed, _ in tolerances(config)}
    free = config.model_copy(update={"calibrate": config.calibrate.model_copy(update={"free": (SEAT,)})})
    assert {changed.link[0].factor for changed, _ in tolerances(free)} == {1.0}


def test_a_fitted_link_keeps_no_more_tolerance_than_it_had() -> None:
    _, config = with_nodes()
    left = remaining_tolerances(config, {SEAT: 0.07, BLOCK: 0.5})
    assert left == {"link.block.1-heater.tolerance": 0.07, "node.block.1.tolerance": 0.05}


def test_a_fitted_scale_keeps_what_friction_differs_from_log_to_log_too() -> None:
    config = machine(tolerance={"heat_per_log": 0.03})
    left = remaining_tolerances(config, {"source.bearing.l.heat_W_rpm": 0.04})
    assert left == {"source.bearing.l.scale_tolerance": pytest.approx(0.05)}
    left = remaining_tolerances(config, {"source.bearing.l.heat_W_rpm": 0.5})
    assert left == {"source.bearing.l.scale_tolerance": 0.2}
