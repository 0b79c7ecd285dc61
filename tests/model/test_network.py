"""A network of nodes by itself: at rest, in time, in its modes; what links let pass; what is refused."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import quad
from scipy.linalg import expm

from observer.config.sections import Link
from observer.errors import ConfigError
from observer.frames import FloatArray
from observer.installation import parse
from observer.model.build import build_plant
from observer.model.network import (
    Network,
    assemble,
    ball_W_K,
    bar_W_K,
    conductance_W_K,
    gap_W_K,
    node_modes,
    ring_W_K,
)
from observer.model.simulate import start
from tests.logs.machines import table
from tests.reference.cases import config_of, known, play, point
from tests.reference.printed import crank_nicolson, steady
from tests.truth import yu
from tests.truth.bar import Bar, End

HOUSE = assemble(
    [50.0, 400.0, 2000.0, 30.0], [(0, 1, 4.0), (1, 2, 2.0), (0, 3, 0.5), (3, 2, 0.2)], [(1, 0.3), (2, 1.5)]
)
"""A ring, a bearing seat, a housing and a cover."""
HEAT_W = np.array([20.0, 0.0, 3.0, 0.0])


def exact(network: Network, time_s: float, start_K: FloatArray, heat_W: FloatArray) -> FloatArray:
    """Temperatures above ambient by scipy's matrix exponential of the network with its heats."""
    n = len(start_K)
    A = np.zeros((n + 1, n + 1))
    A[:n, :n] = -network.conductance_W_K / network.capacity_J_K[:, None]
    A[:n, n] = heat_W / network.capacity_J_K
    return np.asarray((expm(A * time_s) @ np.append(start_K, 1.0))[:n])


def test_the_networks_modes_are_its_exponential() -> None:
    """T = Φ ξ with ξ decaying by itself, for any start, heats and ambient."""
    modes, start_K = node_modes(HOUSE), np.array([5.0, -2.0, 1.0, 9.0])
    np.testing.assert_allclose(modes.shape @ modes.inverse, np.eye(4), atol=1e-12)
    for time_s in (3.0, 60.0, 5000.0):
        decay = modes.decay_1_s
        held = -np.expm1(-decay * time_s) / decay
        xi = np.exp(-decay * time_s) * (modes.inverse @ (start_K + 18.0))
        xi += held * (modes.input @ HEAT_W + modes.ambient * 18.0)
        np.testing.assert_allclose(modes.shape @ xi, 18.0 + exact(HOUSE, time_s, start_K, HEAT_W), atol=1e-10)


def test_nodes_that_lose_nothing_keep_their_heat() -> None:
    modes = node_modes(assemble([100.0, 300.0, 50.0], [(0, 1, 2.0)], []))
    assert np.sort(modes.decay_1_s)[:2].tolist() == [0.0, 0.0]
    alone = node_modes(assemble([100.0], [], []))
    assert (alone.shape.item(), alone.input.item()) == (1.0, 0.01)


@given(st.lists(st.floats(0.01, 100.0), min_size=3, max_size=3), st.floats(-50.0, 50.0))
def test_at_rest_all_heat_goes_into_the_air(conductances: list[float], ambient_degC: float) -> None:
    a, b, c = conductances
    network = assemble([1.0, 2.0, 3.0], [(0, 1, a), (1, 2, b)], [(0, 0.5), (2, c)])
    heat_W = np.array([3.0, 4.0, 5.0])
    T = steady(network, heat_W, ambient_degC)
    assert network.ambient_W_K @ (T - ambient_degC) == pytest.approx(12.0)
    np.testing.assert_allclose(steady(network, heat_W * 0.0, ambient_degC), ambient_degC, atol=1e-12)


BAR = Bar(length_m=0.6, diameter_m=0.03, convection_W_m2K=12.0)


def chain(cells: int) -> tuple[Network, FloatArray]:
    """A screw as nodes in a row, and their places."""
    dx = BAR.length_m / cells
    links = [(i, i + 1, BAR.conductance_Wm_K / dx) for i in range(cells - 1)]
    film = [(i, BAR.film_W_mK * dx) for i in range(cells)]
    return assemble([BAR.capacity_J_mK * dx] * cells, links, film), (np.arange(cells) + 0.5) * dx


def test_a_row_of_nodes_settles_on_yus_exponentials_to_the_order_of_its_mesh() -> None:
    """The ends are held by Yu's own temperatures half a node outside: 8 and 3 K above the air."""
    errors = []
    for cells in (15, 30, 60):
        network, places = chain(cells)
        half = 2.0 * BAR.conductance_Wm_K / (BAR.length_m / cells)
        held = Network(network.capacity_J_K, network.conductance_W_K.copy(), network.ambient_W_K)
        held.conductance_W_K[[0, -1], [0, -1]] += half
        heat_W = np.zeros(cells)
        heat_W[0], heat_W[-1] = half * 8.0, half * 3.0
        errors.append(np.abs(steady(held, heat_W, 0.0) - yu.steady(BAR, 8.0, 3.0, places)).max())
    np.testing.assert_allclose(np.log2(np.array(errors[:-1]) / errors[1:]), 2.0, atol=0.15)


def test_a_row_of_nodes_warms_as_the_modal_screw_to_the_order_of_its_mesh() -> None:
    """Ten minutes of 6 W at the left end, by Crank and Nicolson, against the eigenmodes."""
    errors = []
    for cells in (15, 30, 60):
        network, places = chain(cells)
        config = config_of(BAR, [point("left", 0.0)], places, ends=(End(), End()), model={"modes": 200})
        plant = build_plant(config)
        z = known(plant, 2, ambient=0.0, reference=0.0)
        modal = play(plant, np.array([0.0, 600.0]), np.array([[6.0]]), z, 0.0)[-1, plant.rows.field_slice]
        heat_W = np.zeros(cells)
        heat_W[0] = 6.0
        step, T = crank_nicolson(network, 600.0 / 400), np.zeros(cells)
        for _ in range(400):
            T = step.E @ heat_W + step.C @ T
        errors.append(np.abs(T - modal).max())
    np.testing.assert_allclose(np.log2(np.array(errors[:-1]) / errors[1:]), 2.0, atol=0.2)


def test_what_a_link_lets_pass() -> None:
    assert bar_W_K(50.0, 0.1, 1e-3) == pytest.approx(0.5)
    # a thin ring is a plate of its circumference
    assert ring_W_K(45.0, 0.02, 0.06, 0.0602) == pytest.approx(
        bar_W_K(45.0, 1e-4, math.pi * 0.0601 * 0.02), rel=1e-5
    )
    # touching everywhere, a gap is two half plates in series; nowhere, it is what fills it
    two = 1.0 / (0.5e-4 / (40.0 * 1e-3) + 0.5e-4 / (60.0 * 1e-3))
    assert gap_W_K(1e-4, 1e-3, 1.0, 40.0, 60.0, 0.2) == pytest.approx(two)
    assert gap_W_K(1e-4, 1e-3, 1e-12, 40.0, 60.0, 0.2) == pytest.approx(bar_W_K(0.2, 1e-4, 1e-3))


@pytest.mark.parametrize(("a", "b"), [(2e-4, 2e-4), (1e-4, 3e-4), (8e-4, 1e-4)])
def test_a_balls_contact_is_a_constriction_on_both_sides(a: float, b: float) -> None:
    """R = ∫_0^∞ ds/√((a² + s²)(b² + s²))/(2π k) of an ellipse at one temperature on a half-space."""
    integral = quad(lambda s: a / math.sqrt((a**2 + (a * s) ** 2) * (b**2 + (a * s) ** 2)), 0.0, np.inf)[0]
    resistance = integral / (2.0 * math.pi) * (1.0 / 45.0 + 1.0 / 30.0)
    assert 1.0 / ball_W_K(45.0, 30.0, a, b) == pytest.approx(resistance, rel=1e-7)


@pytest.mark.parametrize(
    ("keys", "wanted"),
    [
        ({"conductance_W_K": 2.5}, 2.5),
        ({"resistance_K_W": 0.4}, 2.5),
        ({"film_W_m2K": 8.0, "area_m2": 0.05}, 0.4),
        ({"conductivity_W_mK": 50.0, "length_m": 0.1, "area_m2": 1e-3}, 0.5),
        (
            {"conductivity_W_mK": 45.0, "length_m": 0.02, "inner_diameter_m": 0.03, "outer_diameter_m": 0.06},
            2 * math.pi * 45.0 * 0.02 / math.log(2.0),
        ),
        (
            {"gap_m": 1e-5, "touching": 0.1, "conductivities_W_mK": [45, 45], "area_m2": 1e-3,
             "filling_W_mK": 0.026},
            1e-3 * (4.5 + 0.9 * 0.026) / 1e-5,
        ),
        (
            {"balls": 16, "conductivities_W_mK": [45, 45], "semi_axes_m": [2e-4, 2e-4]},
            16 * 4 * 2e-4 * 45.0 / 2,
        ),
    ],
)  # fmt: skip
def test_a_link_is_described_in_one_of_seven_ways(keys: dict[str, Any], wanted: float) -> None:
    link = Link.model_validate({"between": ["a", "b"], **keys})
    assert conductance_W_K(link) == pytest.approx(wanted)


BLOCK = {"name": "block", "capacity_J_K": 300.0}
TIED = {"between": ["block", "heater"], "conductance_W_K": 2.0}


@pytest.mark.parametrize(
    ("tables", "sentence"),
    [
        ({"node": [BLOCK]}, 'node "block" has no link; give it one'),
        ({"node": [BLOCK], "link": [TIED, TIED | {"between": ["block", "bed"]}]}, '"bed" is neither a node'),
        (
            {"node": [BLOCK], "link": [TIED, TIED | {"between": ["ambient", "heater"]}]},
            "neither is a node",
        ),
        ({"node": [BLOCK], "link": [TIED | {"between": ["block", "block"]}]}, 'names "block" twice'),
        ({"node": [BLOCK], "link": [TIED | {"area_m2": 1.0}]}, "the keys of one way to describe a link"),
        (
            {"node": [BLOCK], "link": [{"between": ["block", "heater"]}]},
            "the keys of one way to describe a link",
        ),
        ({"node": [BLOCK], "link": [TIED | {"filling_W_mK": 1.0}]}, "filling_W_mK belongs to gap_m"),
        ({"node": [BLOCK | {"name": "heater"}], "link": [TIED]}, "the name is taken"),
        ({"node": [BLOCK, BLOCK], "link": [TIED]}, "the name is taken"),
    ],
)
def test_a_network_that_makes_no_sense_is_refused(tables: dict[str, Any], sentence: str) -> None:
    with pytest.raises(ConfigError, match=sentence):
        parse(table(**tables))


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        ({"nodes": {"blok": 0.5}}, 'names "blok", which is no node; the nodes are: block'),
        ({"nodes": {"block": 1.1}}, "less than or equal to 1"),
        ({"nodes": {"block": 0.5}, "shape": "node"}, "add up to 0.5, not 1"),
    ],
)
def test_heat_goes_into_known_nodes(change: dict[str, Any], sentence: str) -> None:
    made = table(node=[BLOCK], link=[TIED])
    source = made["source"][0] | change
    if change.get("shape") == "node":
        source = {k: v for k, v in source.items() if k not in ("from_m", "to_m")}
    with pytest.raises(ConfigError, match=sentence):
        parse(made | {"source": [source, made["source"][1]]})


@pytest.mark.parametrize(
    "effect",
    [
        {"kind": "friction_fade", "target": "heater", "per_K": 0.01},
        {"kind": "attached_mass", "target": "heater", "capacity_J_K": 10.0, "conductance_W_K": 1.0},
    ],
)
def test_an_effect_at_a_source_that_heats_nodes_only_is_refused(effect: dict[str, Any]) -> None:
    made = table(node=[BLOCK], link=[TIED], effect=[effect])
    source = made["source"][0] | {"nodes": {"block": 1.0}}
    with pytest.raises(ConfigError, match='"heater" heats nodes only'):
        parse(made | {"source": [source, made["source"][1]]})


def test_a_sensor_sits_on_the_screw_or_on_a_node() -> None:
    made = table(node=[BLOCK], link=[TIED])
    for keys, sentence in (
        ({"on": "block", "position_m": 0.1}, "exactly one of position_m"),
        ({}, "exactly one of position_m"),
        ({"on": "bed"}, 'sensor s: on names "bed", which is no node'),
    ):
        with pytest.raises(ConfigError, match=sentence):
            parse(made | {"sensor": [{"name": "s", "channel": "s_degC", **keys}]})


def test_a_link_to_a_prescribed_end_is_refused() -> None:
    made = table(node=[BLOCK], link=[TIED | {"between": ["block", "bearing.l"]}])
    right = {"right": {"kind": "prescribed", "channel": "end_degC"}}
    with pytest.raises(ConfigError, match="the right end has a prescribed temperature"):
        parse(made | {"boundary": right})


def test_a_machine_at_one_temperature_reads_it_everywhere() -> None:
    made = table(node=[BLOCK], link=[TIED, {"between": ["block", "ambient"], "conductance_W_K": 0.4}])
    made["sensor"] = [{"name": "s", "channel": "s_degC", "on": "block"}, *made["sensor"]]
    plant = build_plant(parse(made))
    x = start(plant, 27.0, np.zeros(2))
    z = known(plant, 1, ambient=27.0, reference=27.0)[0]
    read = (plant.rows.C @ x + plant.rows.F @ z)[: plant.rows.sensors]
    np.testing.assert_allclose(read, 27.0, atol=1e-9)
