"""A link or a node that is off does to the plant what a parameter of it says."""

from __future__ import annotations

import tomllib

import numpy as np
import pytest

from observer.config.machine import Config
from observer.frames import FloatArray
from observer.model.build import build_plant
from observer.model.generator import generator
from observer.model.learning import Nuisance
from observer.model.plant import Plant
from tests.learning.housings import HOUSED_CONFIG

STANDING = HOUSED_CONFIG.replace('position_channel = "nut_position_m"\n', "").replace(
    "stroke_m = [0.15, 0.8]", "stroke_m = [0.4, 0.48]"
)
"""The nut stands: what it exchanges beyond the mean temperature under it is no part of a parameter."""
LINKED = """
[[node]]
name = "bed"
capacity_J_K = 4000.0
[[link]]
between = ["left_housing", "bed"]
conductance_W_K = 6.0
factor = 0.9
[[link]]
between = ["bed", "ambient"]
film_W_m2K = 9.0
area_m2 = 0.3
"""
LEARN = '[estimator]\nlearn = ["link", "capacity"]\n'
LASTS_S, STEPS = 400.0, 400


def config_of(*parts: str) -> Config:
    return Config.model_validate(tomllib.loads("".join(parts)))


def marched(plant: Plant, theta: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Sensors (s,) and their change (s, L) after minutes of heat in warmer air, from 20 °C."""
    heat_W, z = np.full(len(plant.source_names), 30.0), np.full(len(plant.known_names), 25.0)
    A, a, h = generator(plant), plant.parameters, LASTS_S / STEPS
    step = np.linalg.inv(np.eye(len(A)) - 0.5 * h * A)
    forward = step @ (np.eye(len(A)) + 0.5 * h * A)
    x, change = 20.0 * plant.uniform, np.zeros((len(A), len(theta)))
    drive = plant.B @ heat_W + plant.E @ z
    for _ in range(STEPS):
        now = a.drives(x, plant.B, heat_W, heat_W, z)
        x = forward @ x + h * step @ drive
        after = a.drives(x, plant.B, heat_W, heat_W, z)
        change = forward @ change + 0.5 * h * step @ (now + after)
    s = plant.rows.sensors
    return plant.rows.C[:s] @ x + plant.rows.F[:s] @ z, plant.rows.C[:s] @ change


@pytest.mark.parametrize("text", [STANDING, STANDING + LINKED], ids=["apart", "linked"])
def test_a_changed_link_or_node_is_what_its_parameter_says(text: str) -> None:
    config = config_of(text, LEARN)
    plant = build_plant(config, learns=True)
    assert plant.learning is not None
    names = plant.learning.names
    assert len(names) == len(config.link) + len(config.node)
    _, change = marched(plant, plant.parameters.sigma)
    own = dict(zip(names, change[:, plant.learning.states].T, strict=True))
    for i, link in enumerate(config.link):
        differs(config, "link", i, {"factor": link.factor}, own[f"{link.key}.factor"])
    for i, node in enumerate(config.node):
        differs(config, "node", i, {"capacity_J_K": node.capacity_J_K}, own[f"node.{node.name}.capacity_J_K"])


@pytest.mark.parametrize("text", [STANDING, STANDING + LINKED], ids=["apart", "linked"])
def test_heat_divided_otherwise_is_what_its_parameter_says(text: str) -> None:
    config = config_of(text, '[estimator]\nlearn = ["division"]\n')
    plant = build_plant(config, learns=True)
    assert plant.learning is not None
    _, change = marched(plant, plant.parameters.sigma)
    said_K = dict(zip(plant.learning.names, change[:, plant.learning.states].T, strict=True))
    dividing = [(i, source) for i, source in enumerate(config.source) if source.nodes]
    assert set(said_K) == {f"source.{source.name}.division" for _, source in dividing}
    for i, source in dividing:
        ((node, share),) = source.nodes.items()
        found = []
        for moved in (0.01, -0.01):
            sources = list(config.source)
            sources[i] = source.model_copy(update={"nodes": {node: share + moved * source.screw_share}})
            changed = build_plant(config.model_copy(update={"source": tuple(sources)}))
            found.append(marched(changed, np.zeros(0))[0])
        difference_K = (found[0] - found[1]) / 0.02
        assert np.abs(difference_K).max() > 0.1
        # linear in the division: the marches differ by rounding alone
        np.testing.assert_allclose(
            said_K[f"source.{source.name}.division"], difference_K, rtol=1e-6, atol=1e-6
        )


def differs(config: Config, table: str, i: int, value: dict[str, float], said_K: FloatArray) -> None:
    """Check what a hundredth more and less of one value does to the sensors."""
    found = []
    for more in (1.01, 0.99):
        items = list(getattr(config, table))
        items[i] = items[i].model_copy(update={key: more * own for key, own in value.items()})
        plant = build_plant(config.model_copy(update={table: tuple(items)}))
        found.append(marched(plant, np.zeros(0))[0])
    difference_K = (found[0] - found[1]) / 0.02
    # second order of the step of a hundredth, beside 1 mK
    np.testing.assert_allclose(said_K, difference_K, rtol=2e-3, atol=2e-3)


def test_each_may_have_a_tolerance_of_its_own_and_none_is_exact() -> None:
    own = STANDING.replace("capacity_J_K = 600.0\n", "capacity_J_K = 600.0\ntolerance = 0.05\n")
    own = own.replace("conductance_W_K = 8.0\n", "conductance_W_K = 8.0\ntolerance = 0.0\n")
    plant = build_plant(config_of(own, LEARN, "[tolerance]\nlink = 0.3\n"), learns=True)
    assert plant.learning is not None
    sigma = dict(zip(plant.learning.names, plant.parameters.sigma[plant.learning.states], strict=True))
    assert "link.nut-nut_body.factor" not in sigma
    assert sigma["link.left_bearing-left_housing.factor"] == 0.3
    assert sigma["node.nut_body.capacity_J_K"] == 0.05
    assert sigma["node.left_housing.capacity_J_K"] == 0.1


ON_SCREW = '\n[[sensor]]\nname = "on_screw"\nchannel = "on_screw_degC"\nposition_m = 0.5\n'
PROBE = '\n[[sensor]]\nname = "probe"\nkind = "displacement"\nchannel = "probe_um"\nposition_m = 0.9\n'
LEARNS_FILM = '[estimator]\nlearn = ["convection"]\n'
SAYS_SO = HOUSED_CONFIG.replace("speed_channel", "law_uncertainty = 0.1\nspeed_channel")


@pytest.mark.parametrize(
    ("text", "uncertain", "learnt"),
    [(HOUSED_CONFIG, 0.3, True), (HOUSED_CONFIG + PROBE, 0.3, True), (HOUSED_CONFIG + ON_SCREW, 0.2, False),
     (HOUSED_CONFIG + LEARNS_FILM, 0.3, False), (SAYS_SO, 0.1, True)],
    ids=["housings", "and a probe", "and one on the screw", "learns the film", "says how well"],
)  # fmt: skip
def test_laws_are_learnt_where_no_thermocouple_sits_on_the_screw(
    text: str, uncertain: float, learnt: bool
) -> None:
    plant = build_plant(config_of(text), learns=True)
    np.testing.assert_array_equal(plant.law_uncertainty, uncertain)
    of_laws = plant.parameters.kind == Nuisance.LAW
    assert of_laws.sum() == (len(plant.source_names) if learnt else 0)
    np.testing.assert_array_equal(plant.parameters.sigma[of_laws], uncertain)
