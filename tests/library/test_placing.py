"""`observer place` and `Machine.place`: what can be mounted, and what of it is worth its cost."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pytest
from typer.testing import CliRunner

import observer
from observer.cli import app
from observer.config.sensors import Sensor
from observer.estimators.design.spread import spread
from observer.model.build import build_plant
from observer.report.placing import as_text

CONFIG = Path(__file__).parents[2] / "config"
HOUSINGS = """
[[candidate]]
name = "support"
on = "support_housing"
cost = 40
[[candidate]]
name = "nut"
on = "nut_body"
cost = 90
[[candidate]]
name = "screw"
from_m = 0.02
to_m = 0.06
spacing_m = 0.02
noise_K = 0.2
cost = 400
"""


@pytest.fixture(scope="module")
def housings() -> observer.Machine:
    """The network of Li et al. without a word on what could be mounted."""
    machine = observer.load(CONFIG / "li-network.toml")
    return replace(machine, config=machine.config.model_copy(update={"candidate": ()}))


def test_a_machine_with_housings_is_offered_those_and_no_turning_screw(housings):
    found = housings.place(1)
    assert set(found.sets[0].positions_m) == {None}
    assert found.exhaustive
    assert found.tried == 6  # housings, covers, nut and table; rings and balls no screwdriver reaches
    everything = housings.place(1, spacing_m=0.3)
    assert everything.tried == 6 + 3
    probe = Sensor(name="probe", kind="displacement", channel="probe_um", position_m=0.5)
    probed = housings.config.model_copy(update={"sensor": (probe, *housings.config.sensor)})
    assert replace(housings, config=probed).place(1).tried == 6  # thermocouples, whatever comes first
    rod = observer.load(CONFIG / "kim-screw.toml").place(1, spacing_m=0.1)
    assert rod.tried == 6
    assert rod.sets[0].positions_m != (None,)


def test_the_configured_sensors_are_as_sure_as_check_says(housings):
    """The same figures by another way: one plant with all candidates here, the configured one there."""
    config = housings.config
    by_check = spread(config, [build_plant(config, learns=True)], config.reading_s)
    found = housings.place(1).configured
    assert found.names == ("t1", "t2", "t3")
    assert list(found.heat_sigma_W.values()) == pytest.approx(by_check.heat_W[0].tolist(), rel=0.02)
    # all that is reported lies within the stroke there; the root of the mean square is above the mean
    assert by_check.field_K.mean() * 0.98 < found.field_sigma_K < found.field_worst_K
    assert by_check.error_um.mean() * 0.98 < found.error_sigma_um < found.error_worst_um


def test_sets_on_housings_rest_on_the_laws_whatever_else_could_be_mounted():
    """As their own configuration would run, which learns the laws where nothing sits on the screw."""
    machine = observer.load(CONFIG / "demo-housings.toml")
    nut, screw = {"name": "nut", "on": "nut_body"}, {"name": "screw", "position_m": 0.5}
    alone, beside = (machine.place(1, candidates=some).configured for some in ([nut], [nut, screw]))
    assert beside.heat_sigma_W == pytest.approx(alone.heat_sigma_W, rel=1e-6)
    assert beside.error_sigma_um == pytest.approx(alone.error_sigma_um, rel=1e-6)


def test_cost_decides_and_dearer_sets_leave_a_smaller_sigma(housings, tmp_path):
    file = tmp_path / "candidates.toml"
    file.write_text(HOUSINGS, encoding="utf-8")
    found = housings.place(candidates=file, budget=540.0, by="error")
    assert all(one.cost <= 540.0 for one in found.sets)
    errors = [one.error_sigma_um for one in found.sets]
    assert errors == sorted(errors, reverse=True)
    assert len(set(errors)) == len(errors) > 2
    assert [one.cost for one in found.sets] == sorted(one.cost for one in found.sets)
    names = {name for one in found.sets for name in one.names}
    assert names & {"screw_20mm", "screw_40mm", "screw_60mm"}
    same = housings.place(candidates=[{"name": "nut", "on": "nut_body"}], keep=True)
    assert [one.names for one in same.sets] == [("t1", "t2", "t3"), ("nut", "t1", "t2", "t3")]


def test_what_is_kept_counts_among_the_sensors_and_a_single_set_is_no_plural(housings):
    more = [{"name": name, "on": node} for name, node in (("a", "nut_body"), ("b", "table"))]
    found = housings.place(4, candidates=more, keep=True)
    assert {len(one.names) for one in found.sets} <= {3, 4}
    assert found.tried == 3
    assert "all 3 sets were tried" in said(found)
    only = housings.place(candidates=[m | {"cost": 9.0} for m in more], keep=True, budget=1.0)
    assert "the only set within number and budget was tried" in said(only)


def said(found: observer.PlacedSensors) -> str:
    """What the command prints above its table."""
    return str(as_text(found.document).renderables[0])


def test_a_probe_is_chosen_beside_thermocouples_and_worth_more_the_oftener_it_comes(housings):
    """On the configured sensors: an hourly probing cycle knows the error better, and heat hardly."""
    probe = {"name": "p", "kind": "displacement", "position_m": 0.3, "noise_um": 1.0, "zero_um": 2.0}
    hourly, daily = (
        housings.place(candidates=[probe | more], keep=True, by="error")
        for more in ({"occasional": True}, {"occasional": True, "every_s": 86_400.0})
    )
    without, beside = hourly.sets
    assert beside.names == ("p", "t1", "t2", "t3")
    assert beside.error_sigma_um < 0.8 * without.error_sigma_um
    assert beside.heat_sigma_W["nut"] > 0.9 * without.heat_sigma_W["nut"]
    assert len(daily.sets) == 1  # the shift is over before it comes


def test_candidates_of_the_configuration_are_taken_and_are_nothing_to_the_service(housings):
    machine = observer.load(CONFIG / "li-network.toml")
    assert machine.place(1).tried == 6
    assert [one.cost for one in machine.place(1).sets] == [40.0, 90.0]
    for digest in ("plant_digest", "digest"):
        assert getattr(machine.config, digest) == getattr(housings.config, digest)
    with pytest.raises(observer.UserError, match="spacing_m"):
        machine.place(1, spacing_m=0.1)


@pytest.mark.parametrize(
    ("table", "words"),
    [
        ({"name": "a", "on": "hous"}, "hous.*no node.*support_housing"),
        ({"name": "a", "position_m": 6.0}, "lies beyond the screw"),
        ({"name": "a"}, "position_m, or on, or from_m"),
        ({"name": "a", "from_m": 0.1, "to_m": 0.2}, "together"),
        ({"name": "a", "from_m": 0.2, "to_m": 0.1, "spacing_m": 0.1}, "empty"),
        ({"name": "a", "from_m": 0.0, "to_m": 0.5, "spacing_m": 0.001}, "501 places"),
        ({"name": "a", "on": "table", "cots": 1}, "did you mean cost"),
        ({"name": "a", "position_m": 0.1, "zero_um": 1.0}, "zero_um has no meaning"),
        ({"name": "a", "kind": "displacement", "position_m": 0.1, "every_s": 60.0}, "add occasional"),
    ],
)
def test_what_cannot_be_mounted_is_said_in_a_sentence(housings, table, words):
    with pytest.raises(observer.ConfigError, match=words):
        housings.place(1, candidates=[table])


def test_a_choice_that_leaves_nothing_is_said_in_a_sentence(housings):
    tables = [{"name": "a", "on": "table", "cost": 5.0}]
    with pytest.raises(observer.UserError, match="buys no thermocouple"):
        housings.place(candidates=tables, budget=4.0)
    with pytest.raises(observer.UserError, match="ask for 1 to 1"):
        housings.place(2, candidates=tables)
    with pytest.raises(
        observer.UserError, match="3 configured ones, which stay and count too; ask for 4 to 4"
    ):
        housings.place(3, candidates=tables, keep=True)
    probe = {"name": "p", "kind": "displacement", "position_m": 0.3}
    with pytest.raises(observer.UserError, match="no candidate measures a temperature"):
        housings.place(candidates=[probe])
    with pytest.raises(observer.UserError, match=r"buys no thermocouple.*cheapest costs 5"):
        housings.place(candidates=[*tables, probe], budget=1.0)
    rigid = housings.config.model_copy(
        update={"screw": housings.config.screw.model_copy(update={"expansion_1_K": None})}
    )
    with pytest.raises(observer.UserError, match="expansion coefficient"):
        replace(housings, config=rigid).place(candidates=[*tables, probe], by="field")
    with pytest.raises(observer.UserError, match="candidates are called"):
        housings.place(candidates=tables * 2)


def test_the_command_prints_a_table_draws_and_writes_json(tmp_path):
    file, picture = tmp_path / "candidates.toml", tmp_path / "new" / "costs.svg"
    file.write_text(HOUSINGS, encoding="utf-8")
    command = [
        "place",
        "--config",
        str(CONFIG / "li-network.toml"),
        "--candidates",
        str(file),
        "--sensors",
        "2",
    ]
    done = CliRunner().invoke(app, [*command, "--plot", str(picture)])
    assert done.exit_code == 0, done.output
    assert "t1, t2, t3" in done.output
    assert picture.read_text(encoding="utf-8").count("<path") > 50
    strict = json.loads(CliRunner().invoke(app, [*command, "--json"]).stdout, parse_constant=pytest.fail)
    assert strict["exhaustive"] is True
    assert set(strict["sets"][0]) == set(observer.SensorPlaces.__slots__)
    refused = CliRunner().invoke(app, [*command, "--plot", str(tmp_path / "costs.txt")])
    assert "ending in .png" in str(refused.exception)
