"""A body heated by what of a friction does not enter the screw: its plant, its forms, and what it refuses."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from observer import discover
from observer.config.effects.bodies import AttachedMass, under_surface_K_W
from observer.discovery.candidates import Candidate, library
from observer.discovery.result import reciprocal
from observer.errors import ConfigError
from observer.fit.forward import Forward
from observer.fit.hypothesis import Fit
from observer.fit.parameters import replaced
from observer.fit.runs import prepare
from observer.model.build import build_plant
from observer.model.drive import Drive
from observer.model.simulate import simulate, start
from tests.logs.machines import machine
from tests.logs.simulated import frames
from tests.truth.machine.entries import nut_entry
from tests.truth.machine.generate import write_case

BODY = {"kind": "attached_mass", "target": "nut", "capacity_J_K": 400.0, "conductance_W_K": 3.0}
AT_REST = [{"kind": "attached_mass", "target": "left", "capacity_J_K": 400.0, "conductance_W_K": 3.0}]


def nut(**law: Any) -> list[dict[str, Any]]:
    """A nut that is spread over its stroke, with half of its friction for the screw."""
    whole = {"name": "nut", "shape": "nut", "length_m": 0.05, "stroke_m": [0.1, 0.3]}
    return [whole | {"speed_channel": "n_rpm", "torque_Nm": 0.3, "share": 0.5} | law]


def rows_of(**changes: Any) -> np.ndarray:
    """What the sensors of a machine show, its nut running for half an hour of an hour."""
    config = machine(**changes)
    time_s = np.arange(0.0, 3600.0, 5.0)
    columns = {"n_rpm": np.where(time_s < 1800.0, 1000.0, 0.0)}
    blank = {s.channel: np.full_like(time_s, 20.0) for s in config.sensor}
    plant = build_plant(config)
    drive = Drive(config, plant)
    _, inputs = drive.run(drive.initial(), frames(config, time_s, columns | blank))
    rows = simulate(plant, start(plant, 20.0, inputs.law_W[0]), inputs)[1]
    return rows[:, plant.rows.sensor_slice]


def test_it_is_a_node_that_takes_its_part_of_the_whole_friction() -> None:
    """0.5 of the friction to the surface, 0.6 of the rest to the body, and of the surface's to either as the
    resistances are: 0.4/(8π k l) into the screw, 1/3 K/W into the body.
    """
    effect = BODY | {"heat_share": 0.6, "loss_W_K": 0.2}
    heated = rows_of(source=nut(), effect=[effect])
    into_screw_K_W = 0.4 / (8.0 * np.pi * machine().screw.conductivity_W_mK * 0.05)
    back = into_screw_K_W / (into_screw_K_W + 1.0 / 3.0)
    links = [
        {"between": ["body", "nut"], "conductance_W_K": 1.0 / (into_screw_K_W + 1.0 / 3.0)},
        {"between": ["body", "ambient"], "conductance_W_K": 0.2},
    ]
    source = nut(share=0.8, nodes={"body": (0.3 + 0.5 * back) / 0.8})
    node = rows_of(source=source, node=[{"name": "body", "capacity_J_K": 400.0}], link=links)
    np.testing.assert_allclose(heated, node, rtol=0, atol=1e-9)
    plain = rows_of(source=nut(), effect=[BODY])
    assert np.abs(heated - plain).max() > 1.0


@pytest.mark.parametrize("bore_m", [0.0, 0.012])
def test_a_surface_is_warmer_than_the_section_as_between_rings(bore_m: float) -> None:
    """1 W into the outermost of 400 rings, taken out of all alike; of that 0.4, for it passes."""
    given = machine(source=nut())
    screw = given.screw.model_copy(update={"bore_m": bore_m})
    edge_m = np.linspace(bore_m / 2, screw.diameter_m / 2, 401)
    area_m2 = np.diff(edge_m**2)
    inside = np.cumsum(area_m2) / area_m2.sum()
    drop_K = inside * np.diff(edge_m)[0] / (2.0 * np.pi * edge_m[1:] * 0.05 * screw.conductivity_W_mK)
    below_K = np.append(np.cumsum(drop_K[::-1])[::-1], 0.0)
    mean_K = np.sum(area_m2 * 0.5 * (below_K[1:] + below_K[:-1])) / area_m2.sum()
    assert under_surface_K_W(given.source[0], screw) == pytest.approx(0.4 * mean_K, rel=0.01)


def test_a_search_predicts_it_whatever_torque_and_share_are() -> None:
    """What only multiplies a law is set apart from it; here the share does more than that."""
    config = machine(source=nut(), effect=[BODY | {"heat_share": 1.0}])
    time_s = np.arange(0.0, 3600.0, 5.0)
    columns = {"n_rpm": np.where(time_s < 1800.0, 1000.0, 0.0)}
    blank = {s.channel: np.full_like(time_s, 20.0) for s in config.sensor}
    forward = Forward(config, [prepare(config, [frames(config, time_s, columns | blank)], "log")])
    for torque_Nm, share in ((0.3, 0.5), (0.2, 0.5), (0.3, 0.25)):
        moved = replaced(config, {"source.nut.torque_Nm": torque_Nm, "source.nut.share": share})
        exact = rows_of(source=nut(torque_Nm=torque_Nm, share=share), effect=[BODY | {"heat_share": 1.0}])
        means = exact[1:-5].reshape(-1, 6, 3).mean(axis=1)
        error_K = np.abs(forward(moved)[0][5:-1] - means[5:]).max()
        print(f"{error_K:.4f} K")
        assert error_K < 0.02  # of ten, in steps of 10 s


@pytest.mark.parametrize(
    ("source", "effect", "said"),
    [
        (nut(), AT_REST[0] | {"heat_share": 0.5}, 'and "left" is an end'),
        (nut(share=1.0), BODY | {"heat_share": 0.5}, "a share between"),
        (nut(torque_Nm=None, heat_W_rpm=0.01, share=1.0), BODY | {"heat_share": 0.5}, "a share between"),
    ],
)
def test_heat_that_is_nowhere_left_is_refused(source: list[Any], effect: dict[str, Any], said: str) -> None:
    with pytest.raises(ConfigError, match=said):
        build_plant(machine(source=source, effect=[effect]))


@pytest.mark.parametrize(
    ("law", "free", "forms"),
    [({}, (), 3), ({"share": 1.0}, (), 1), ({}, ("source.nut.share",), 1)],
)
def test_a_heated_body_is_sought_where_heat_is_left_for_it(
    law: dict[str, Any], free: tuple[str, ...], forms: int
) -> None:
    every = [c for c in library(machine(source=nut(**law)), free) if c.of is AttachedMass]
    assert [len(c.fitted) for c in every if c.target == "nut"] == [2, 3, 4][:forms]
    assert all(len(c.fitted) == 2 for c in every if c.target != "nut")


def body() -> Candidate:
    every = library(machine(source=nut()), ())
    return next(c for c in every if c.of is AttachedMass and c.target == "nut" and len(c.fitted) == 3)


@pytest.mark.parametrize(
    ("conductance_W_K", "heat_share", "refused"),
    [(3.0, 0.5, False), (1000.0, 0.5, False), (3.0, 1.0, False), (3.0, 0.0, True), (1e-3, 0.5, True)],
)
def test_a_tight_contact_and_all_of_the_heat_are_no_bounds(
    conductance_W_K: float, heat_share: float, refused: bool
) -> None:
    values = np.array([400.0, conductance_W_K, heat_share])
    none = np.zeros(0)
    fit = Fit(None, None, body().parameters(0), values, none, none, none)  # type: ignore[arg-type]
    assert fit.at_bound is refused


def test_the_interval_of_a_contact_is_that_of_its_resistance() -> None:
    """50 ± 10 W/K is 0.02 ± 0.004 K/W; ± 60 leaves out no contact however tight."""
    assert reciprocal(50.0, 10.0) == pytest.approx((1 / 0.024, 1 / 0.016))
    low, high = reciprocal(50.0, 60.0)
    assert low == pytest.approx(1 / 0.044)
    assert high == np.inf


@pytest.mark.slow
@pytest.mark.nightly
def test_the_intervals_of_a_nut_that_its_friction_heats_hold_what_it_is(tmp_path: Path) -> None:
    """A light one without a loss: nearly all of its heat reaches the screw, half a minute late."""
    case = nut_entry(0, 60000).case
    config, logs = tmp_path / "logs" / "config.toml", write_case(case, tmp_path / "logs")
    result = discover(config, logs).document
    (effect,) = result["effects"]
    for key, true in case.effects[0].parameters.items():
        low, high = effect["parameters"][key]["ci95"]
        assert low <= true <= high, key
