"""`observer init`: every combination of pieces loads; nothing is overwritten; wrong answers end in words."""

from __future__ import annotations

import itertools
import tomllib
from pathlib import Path

import pytest
from typer.testing import CliRunner

from observer.cli import app
from observer.cli.machines import _USUAL
from observer.discovery.discover import discover
from observer.errors import UserError
from observer.fit.parameters import lawless
from observer.installation import first_template, parse
from observer.installation.catalogue import CONTROLS, MODULES, SCREWS, STEELS, Answers, option
from observer.installation.examine import examine
from observer.installation.first_configuration import agreed, answers, write_new
from observer.installation.first_template import filled

GIVEN = {
    "length_m": "1.0",
    "stroke_m": "0.15,0.80",
    "sensors_m": "0.05 0.95",
    "module_at": "192.168.0.20",
    "ambient": "21.5",
}
OF_CONTROL = {
    "none": {},
    "other": {},
    "canopen": {"control_at": "can0", "node_id": "5", "counts_per_m": "1e6"},
    "modbus": {"control_at": "192.168.0.21:1502", "counts_per_m": "-1e6", "speed_register": "2"},
    "can": {
        "control_at": "/dev/ttyACM0",
        "dbc": str(Path(__file__).parents[2] / "drivers/simulated/axis.dbc"),
        "position_signal": "AxisStatus.NutPosition",
        "speed_signal": "AxisStatus.ScrewSpeed",
    },
    "opcua": {
        "control_at": "opc.tcp://192.168.0.21:4840/control",
        "position_signal": "ns=2;s=X.Position",
        "speed_signal": "ns=2;s=X.Speed",
    },
    "mtconnect": {
        "control_at": "http://192.168.0.21:5000",
        "position_signal": "Xpos",
        "speed_signal": "Sspeed",
    },
}


@pytest.mark.parametrize(("module", "control"), list(itertools.product(MODULES, CONTROLS)))
def test_every_module_with_every_control_passes_the_check(module, control, tmp_path):
    on_can = module in {"css_canmod_temp", "peak_mu_thermocouple1"}
    given = GIVEN | {"module": module, "module_at": "can1" if on_can else "/dev/ttyUSB0"}
    path = tmp_path / "observer.toml"
    write_new(path, given | {"control": control} | OF_CONTROL[control], None)
    config = examine(path)
    assert config.undelivered() == []
    with_speed = control not in {"canopen", "none", "other"}
    assert all((source.law is not None) == with_speed for source in config.source)
    assert config.source[0].position_channel == (None if control in {"none", "other"} else "nut_position_m")


@pytest.mark.parametrize("installed", [True, False])
def test_the_page_is_configured_only_where_its_packages_are(installed, monkeypatch):
    monkeypatch.setattr(first_template, "has_extra", lambda name: installed and name == "page")
    assert ("page" in tomllib.loads(filled(answers(GIVEN, None)))) == installed


@pytest.mark.parametrize("screw", SCREWS)
def test_every_screw_of_every_steel_loads(screw):
    lead_mm = float(screw.split("x")[1])
    for steel in STEELS:
        given = GIVEN | {"screw": screw, "steel": steel, "control": "modbus"} | OF_CONTROL["modbus"]
        config = parse(tomllib.loads(filled(answers(given, None))))
        assert config.source[0].lead_m == pytest.approx(lead_mm / 1000)
        assert (
            0.8 * float(screw.split("x")[0]) / 1000
            < config.screw.diameter_m
            < float(screw.split("x")[0]) / 1000
        )


def test_the_ambient_may_be_the_modules_next_input():
    config = parse(tomllib.loads(filled(answers(GIVEN | {"ambient": "input"}, None))))
    assert config.drivers["thermocouples"].channels == {"t1_degC": 0, "t2_degC": 1, "ambient_degC": 2}


def test_without_a_control_the_heats_have_no_law_and_a_search_says_so():
    config = parse(tomllib.loads(filled(answers(GIVEN, None))))
    assert str(lawless(config)).startswith("no heat has a law, so a prediction takes it as 0 W")
    with pytest.raises(UserError, match="no heat has a law"):
        discover(config, [])
    whole = {"control": "modbus", "control_at": "h", "counts_per_m": "1e6", "speed_register": "2"}
    assert lawless(parse(tomllib.loads(filled(answers(GIVEN | whole, None))))) is None


ON_HOUSINGS = {name: text for name, text in GIVEN.items() if name != "sensors_m"} | {"housings": "all"}


@pytest.mark.parametrize("screw", SCREWS)
@pytest.mark.parametrize("control", ["none", "modbus"])
def test_thermocouples_on_housings_stand_on_bodies_of_the_screws_size(screw, control):
    given = ON_HOUSINGS | {"screw": screw, "control": control} | OF_CONTROL[control]
    config = parse(tomllib.loads(filled(answers(given, None))))
    bodies = ["nut_body", "left_housing", "right_housing"]
    assert [node.name for node in config.node] == [sensor.on for sensor in config.sensor] == bodies
    assert not config.screw_is_seen
    assert all(sensor.position_m is None for sensor in config.sensor)
    assert {link.between for link in config.link} == {
        *zip(["nut", "left_bearing", "right_bearing"], bodies, strict=True),
        *((body, "ambient") for body in bodies),
    }
    nut = config.link[0]
    assert 1.0 < nut.film_W_m2K * nut.area_m2 < 25.0
    assert config.source[0].nodes == {"nut_body": 0.5}


def test_masses_that_are_known_are_taken_and_hold_more_than_typical_ones():
    given = ON_HOUSINGS | {"housings": "left nut", "nut_kg": "2,5 kg", "sensors_m": "500 mm"}
    config = parse(tomllib.loads(filled(answers(given, None))))
    nut, left = config.node
    assert (nut.capacity_J_K, nut.tolerance) == (1175.0, None)
    assert left.tolerance == pytest.approx(0.2)
    assert [sensor.channel for sensor in config.sensor] == ["nut_body_degC", "left_housing_degC", "t1_degC"]
    assert config.drivers["thermocouples"].channels["t1_degC"] == 2


def test_a_housing_is_asked_for_its_mass_and_needs_no_place_on_the_screw():
    heard = []

    def ask(name, usual, trouble):
        heard.append(name)
        return {"housings": "right"}.get(name, usual)

    found = answers({k: v for k, v in GIVEN.items() if k != "sensors_m"}, ask)
    assert (found.housings, found.sensors_m) == (("right",), ())
    assert ("housing_kg" in heard, "nut_kg" in heard) == (True, False)


def test_a_register_pair_is_scaled_to_metres():
    found = parse(tomllib.loads(filled(answers(GIVEN | {"control": "modbus"} | OF_CONTROL["modbus"], None))))
    place = found.drivers["axis"].channels["nut_position_m"]
    assert (place.type, place.scale) == ("int32", pytest.approx(-1e-6))
    assert found.drivers["axis"].port == 1502


def test_missing_answers_are_asked_until_they_are_valid():
    said = {"length_m": iter(["long", "1.0"]), "stroke_m": iter(["0.8,0.1", "0.1,0.8"])}
    asked = []

    def ask(name, usual, trouble):
        asked.append(trouble)
        return next(said[name]) if name in said else usual

    given = {k: v for k, v in GIVEN.items() if k not in said}
    found = answers(given, ask)
    assert (found.length_m, found.stroke_m) == (1.0, (0.1, 0.8))
    assert [words for words in asked if words] == [
        "'long': give a length with its unit, such as 1000 mm or 1.0 m",
        "'0.8,0.1': give both ends, the smaller first, such as 150 800 mm",
    ]


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        ({"screw": "other"}, "--screw: 'other': give nominal diameter x lead in mm, as stamped on the nut"),
        ({"screw": "400x3"}, "--screw: '400x3': give nominal diameter x lead in mm"),
        ({"module": "wago_458"}, "'wago_458': not in the list; give one of wago_750_458"),
        ({"stroke_m": "0.8"}, "--stroke-m: '0.8': write 2 places with their unit"),
        ({"sensors_m": "a,b"}, "--sensors-m: 'a,b': write the places with their unit"),
        ({"sensors_m": ",".join(["0.1"] * 9)}, "9 inputs are needed"),
        ({"sensors_m": "0,5"}, "--sensors-m: '0,5': is it 0.5 or 0 5?"),
        ({"ambient": "warm"}, "--ambient: 'warm': give a temperature with its unit"),
        (
            {"length_m": "1000"},
            "--length-m: '1000': 1000 m is longer than any ball screw; did you mean 1000 mm?",
        ),
        ({"machine": "//"}, "--machine: '//': nothing is left of the name"),
        ({"module_at": "host:x"}, "--module-at: 'host:x' is not an address"),
        ({"node_id": "5"}, "--node-id: belongs to --control canopen"),
        ({"control": "canopen", "control_at": "can0"}, "give --node-id, --counts-per-m"),
        ({"control": "can"} | OF_CONTROL["can"] | {"position_signal": "Nut"}, "names no signal"),
        ({"control": "opcua"} | OF_CONTROL["mtconnect"], "write it as opc.tcp://192.168.0.21:4840"),
        ({"sensors_m": "0.05 1.2"}, "--sensors-m: 1.2 m is beyond the screw's end, at 1 m"),
        ({"length_m": "0"}, "--length-m: '0': input should be greater than 0"),
        (
            {"housings": "nut front"},
            "--housings: 'nut front': front is not known; give some of nut, left, right",
        ),
        ({"sensors_m": "none"}, "--sensors-m: there is no thermocouple yet"),
        ({"nut_kg": "2"}, "--nut-kg: belongs to --housings nut; leave it out"),
        ({"housings": "nut", "nut_kg": "2 t"}, "--nut-kg: '2 t': give a number"),
        ({"housings": "all", "sensors_m": " ".join(["0.1"] * 6)}, "9 inputs are needed"),
    ],
)
def test_a_wrong_answer_is_reported_in_one_sentence(wrong, words, tmp_path):
    with pytest.raises(UserError) as answer:
        write_new(tmp_path / "new.toml", GIVEN | wrong, None)
    assert words in str(answer.value)
    assert not (tmp_path / "new.toml").exists()


def test_a_file_that_is_there_stays(tmp_path):
    path = tmp_path / "observer.toml"
    path.write_text("mine")
    with pytest.raises(UserError, match="not overwritten"):
        write_new(path, GIVEN, None)
    assert path.read_text() == "mine"


def test_the_command_says_what_comes_next(tmp_path):
    path = tmp_path / "observer.toml"
    options = [part for name, value in GIVEN.items() for part in (f"--{name.replace('_', '-')}", value)]
    done = CliRunner().invoke(app, ["init", "--output", str(path), *options])
    assert done.exit_code == 0, done.output
    assert f"observer check --config {path} --wires" in " ".join(done.output.replace("\n", "").split())
    examine(path)


def test_every_question_is_an_option_and_every_option_a_question():
    import typer

    command = typer.main.get_command(app).commands["init"]
    options = {p.opts[0] for p in command.params} - {"--output", "--quiet", "--help"}
    assert options == {option(name) for name in Answers.model_fields}


def test_the_defaults_in_the_help_are_those_of_the_questions():
    fields = {name: field.get_default() for name, field in Answers.model_fields.items()}
    offered = {name: str(value) for name, value in fields.items() if value or value == 0}
    assert {name: value for name, value in offered.items() if value != "PydanticUndefined"} == _USUAL


FIRST = next(iter(Answers.model_fields))


class Somebody:
    """Answers what is scripted, round by round; else with Enter, which takes what is offered."""

    def __init__(self, *rounds: dict[str, str]) -> None:
        self.rounds, self.heard, self.number = list(rounds), [], -1

    def __call__(self, name: str, usual: str | None, trouble: str) -> str:
        self.heard.append((name, trouble))
        self.number += name == FIRST
        typed = self.rounds[min(self.number, len(self.rounds) - 1)].get(name, usual)
        assert typed is not None, f"nothing is offered for {name}"
        return typed


SHORT = GIVEN | {"length_m": "80 mm", "stroke_m": "10 70 mm", "sensors_m": "5 75 mm"}
"""A screw shorter than the nut of 40x10, which is known only when all has been asked."""


def test_a_late_refusal_loses_no_answer():
    somebody = Somebody(SHORT | {"machine": "lathe-7"}, {"screw": "16 x 5"})
    found = agreed({}, somebody)
    assert (found.machine, found.screw, found.sensors_m) == ("lathe-7", "16x5", (0.005, 0.075))
    ((asked, answer),) = [(name, words) for name, words in somebody.heard if "Try again" in words]
    assert "longer than the screw" in answer
    assert asked == FIRST


def test_a_repeated_wrong_answer_is_rejected_in_the_end():
    somebody = Somebody(SHORT)
    with pytest.raises(UserError, match="longer than the screw"):
        agreed({}, somebody)
    assert somebody.number == 1


def test_an_option_that_was_given_is_not_asked_for_again():
    somebody = Somebody({})
    with pytest.raises(UserError, match="longer than the screw"):
        agreed(SHORT, somebody)


@pytest.mark.parametrize(
    ("name", "wrong", "right"),
    [
        ("stroke_m", "150 1800 mm", "150 800 mm"),
        ("sensors_m", "50 1950 mm", "50 950 mm"),
        ("module_at", "host:x", "host:502"),
        ("module", "wago_750_459", "wago_750_458"),
    ],
)
def test_an_answer_is_rejected_at_its_question(name, wrong, right):
    typed, heard = iter([wrong, right]), []

    def ask(asked, usual, trouble):
        heard.append((asked, trouble))
        return next(typed) if asked == name else str(usual)

    answers({key: text for key, text in GIVEN.items() if key != name}, ask)
    assert [asked for asked, _ in heard].count(name) == 2
    ((asked, _),) = [each for each in heard if each[1]]
    assert asked == name


def test_units_commas_and_names_as_people_write_them():
    given = {"length_m": "1000 mm", "stroke_m": "0,15 0,80", "sensors_m": "50, 950 mm", "screw": "40 x 10"}
    given |= {"machine": "Drehmaschine 7", "ambient": "12 °C", "module_at": "h"}
    found = answers(given, None)
    assert (found.machine, found.screw, found.length_m) == ("drehmaschine-7", "40x10", 1.0)
    assert (found.stroke_m, found.sensors_m, found.ambient) == ((0.15, 0.8), (0.05, 0.95), 12.0)
