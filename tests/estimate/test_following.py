"""Several heats by one unknown: nut and bearings of Kim's screw, and of one whose nut's position is known."""

from __future__ import annotations

import tomllib
from pathlib import Path

import numpy as np
import pytest

import observer
from observer import installation
from observer.config.machine import untied
from observer.errors import ConfigError
from observer.model.build import build_plant
from observer.model.drive import Drive
from observer.model.simulate import simulate, start
from tests.logs.inputs import lively

ONE = Path(__file__).parents[2] / "config" / "kim-screw-one.toml"
REFERENCE = ONE.parents[1] / "docs" / "reference" / "configuration.md"
MOVING = {"position_channel": "nut_m", "lead_m": 0.01}
ESTIMATORS = {
    "luenberger": {"kind": "luenberger", "period_s": 60.0, "bandwidth_1_s": 0.005},
    "kalman": {"kind": "kalman", "period_s": 60.0},
    "constant": {"kind": "kalman", "engine": "constant", "period_s": 60.0},
}


def table(**nut: object) -> dict:
    """The shipped configuration, with more said of its nut."""
    found = tomllib.loads(ONE.read_text(encoding="utf-8"))
    found["source"][0] |= nut
    return found


@pytest.mark.parametrize("nut", [{}, MOVING], ids=["spread", "moving"])
@pytest.mark.parametrize("effect", [[], [{"kind": "uneven_convection", "from_m": 0.1, "to_m": 0.2,
                                          "extra_W_m2K": 40.0}]], ids=["none", "own modes"])  # fmt: skip
def test_one_column_does_what_three_do(nut, effect):
    """By laws alone it is the same screw, whether its heats are one or three."""
    config = installation.parse(table(**nut) | {"effect": effect})
    rows = []
    for own in (config, untied(config)):
        plant = build_plant(own)
        u = lively(plant, 40, nut_m=0.25 + 0.1 * np.sin(np.arange(40)))
        assert len(u.law_W[0]) == 3
        u.law_W[:] = 9.0 * (1 + np.arange(40)[:, None] // 20) * [1.0, 1 / 3, 1 / 3]
        rows.append(simulate(plant, start(plant, 20.0, np.zeros(3)), u)[1])
    np.testing.assert_allclose(rows[0], rows[1], rtol=0, atol=1e-8)
    assert np.ptp(rows[0][-1]) > 0.01


@pytest.fixture(scope="module")
def log():
    """Of a screw that rubs half as much again as its law says, a thermocouple is read and nothing else."""
    harder = table()
    harder["source"][0]["torque_Nm"] = 0.45
    program = {"time_s": np.arange(0.0, 4800.0, 60.0), "screw_speed_rpm": np.repeat([500.0, 800.0], 40)}
    run = observer.Machine(installation.parse(harder), b"").simulate(program, start_degC=20.0)
    return {name: run[name] for name in ("time_s", "t1_degC", "screw_speed_rpm")} | {
        "true_W": run["heat_nut_W"]
    }


@pytest.mark.parametrize("kind", ESTIMATORS)
def test_bearings_have_their_fraction_of_the_nuts_estimate(kind, log):
    own = table() | {"estimator": ESTIMATORS[kind]}
    found = observer.Machine(installation.parse(own), b"").replay(log)
    for part in ("W", "sigma_W"):
        nut = found[f"heat_nut_{part}"]
        assert np.isfinite(nut).all()
        for bearing in ("left_bearing", "right_bearing"):
            np.testing.assert_allclose(found[f"heat_{bearing}_{part}"], nut / 3.0, rtol=1e-12)
    off = np.abs(found["heat_nut_W"] / log["true_W"] - 1.0)
    assert off[[39, 79]].max() < 0.1, "no estimate: the law by itself is a third off"


def test_a_whole_log_has_one_heat_of_three(log):
    found = observer.Machine(installation.parse(table() | {"estimator": ESTIMATORS["kalman"]}), b"").identify(
        log
    )
    np.testing.assert_allclose(found["heat_left_bearing_W"], found["heat_nut_W"] / 3.0, rtol=1e-12)
    middle = slice(10, 35)
    np.testing.assert_allclose(found["heat_nut_W"][middle], log["true_W"][middle], rtol=0.15)


def test_a_fit_takes_the_heats_by_their_laws(log):
    own = table() | {"calibrate": {"free": ["source.nut.torque_Nm"]}}
    machine = observer.Machine(installation.parse(own), ONE.read_bytes())
    assert machine.calibrate(log).values["source.nut.torque_Nm"].value == pytest.approx(0.45, rel=0.01)


def test_a_law_of_the_owner_that_wears_is_one_of_its_parts_too():
    effect = {"kind": "run_in", "target": "nut", "fraction": 0.5, "time_s": 600.0}
    config = installation.parse(table() | {"effect": [effect]})
    drive = Drive(config, build_plant(config))
    law = np.zeros((3, 3))
    drive.set_channels(config.channels)
    values = np.full((3, len(config.channels)), 500.0)
    drive.heats(law, values, np.array([0.0, 60.0, 600.0]), np.zeros(3))
    np.testing.assert_allclose(law[:, 1], law[:, 0] / 3.0)
    assert law[2, 0] < law[0, 0]


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"heat_of": None, "heat_ratio": None}, "needs to know which heat"),
        ({"estimate": False}, "estimate = true for both"),
    ],
)
def test_a_heat_that_follows_nothing_is_rejected(change, words):
    own = table()
    own["source"][1] = {k: v for k, v in (own["source"][1] | change).items() if v is not None}
    with pytest.raises(ConfigError, match=words):
        installation.parse(own)


def test_a_machine_with_nodes_says_as_its_reference_does_that_no_heat_follows_another():
    node = {"node": [{"name": "house", "capacity_J_K": 900.0}]}
    node["link"] = [{"between": ["house", "ambient"], "conductance_W_K": 0.2}]
    with pytest.raises(ConfigError, match=r"follows: not with \[\[node\]\] or covers_film"):
        installation.parse(table() | node)
    assert "Not with `[[node]]`, `covers_film`" in REFERENCE.read_text(encoding="utf-8")


def test_an_effect_on_only_one_of_the_heats_is_rejected():
    effect = {"kind": "friction_fade", "target": "nut", "per_K": 0.01}
    with pytest.raises(ConfigError, match="remove follows"):
        build_plant(installation.parse(table() | {"effect": [effect]}))


def test_an_export_says_that_it_cannot():
    from observer.export.exportable import refuse_unexportable

    with pytest.raises(ConfigError, match="left_bearing: follows"):
        refuse_unexportable(installation.parse(table()))
