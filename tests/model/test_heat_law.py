"""The heat laws of a configuration: what they give, what is refused, and that every command uses them."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import observer
from observer.config.machine import Config
from observer.errors import ConfigError
from observer.files.logs import read_log
from observer.files.writer import write_log
from observer.fit.calibrate import calibrate
from observer.fit.forward import unit_laws
from observer.frames import FloatArray
from observer.installation import load, parse
from observer.model.build import build_plant
from observer.model.drive import Drive
from observer.model.law import heat_law
from observer.model.rod.screw import rod_of
from observer.model.simulate import simulate, start
from observer.physics import friction
from tests.logs.machines import table
from tests.logs.simulated import frames

BEARING = {
    "type": "angular_contact_pair", "mean_diameter_m": 0.0435, "axial_load_N": 1500.0, "f1": 0.0004,
    "viscosity_mm2_s": 32.0,
}  # fmt: skip
NUT = {"preload_N": 2000.0, "efficiency": 0.95, "lead_m": 0.01}
SPEED = np.array([0.0, 30.0, -900.0, 2500.0])


def laws(*sources: dict[str, Any], **tables: Any) -> Config:
    """A screw of 0.4 m with these sources; names and places are filled in."""
    filled = [{"name": f"s{i}", "shape": "point", "position_m": 0.1 * i} | s for i, s in enumerate(sources)]
    return parse(table(source=filled, **tables))


def heat(config: Config, name: str, *columns: FloatArray) -> FloatArray:
    source = next(s for s in config.source if s.name == name)
    return heat_law(source, config.source, config.screw.length_m)(*columns)


def test_a_bearing_by_its_catalogue() -> None:
    config = laws({"speed_channel": "n_rpm", "bearing": BEARING | {"count": 2}, "share": 0.5, "scale": 1.2})
    torque_Nm = 0.0004 * 1440.0 / 1000.0 * 1.5 * 0.0435 * 1000.0
    torque_Nm = torque_Nm + friction.lubricant_torque_Nm(SPEED, 4.0, 32.0, 0.0435)
    wanted = 2 * 0.5 * 1.2 * torque_Nm * np.abs(SPEED) * math.pi / 30
    np.testing.assert_allclose(heat(config, "s0", SPEED), wanted)


def test_a_bearings_lubricant_thins_when_it_is_warm() -> None:
    oil = {"viscosity_40_mm2_s": 46.0, "viscosity_100_mm2_s": 6.8}
    bearing = {k: v for k, v in BEARING.items() if k != "viscosity_mm2_s"}
    cold, warm = (
        laws({"speed_channel": "n_rpm", "bearing": bearing | oil | {"lubricant_degC": t}})
        for t in (20.0, 60.0)
    )
    assert heat(cold, "s0", SPEED)[3] > 1.5 * heat(warm, "s0", SPEED)[3]


def test_a_nut_by_its_preload_and_stroke() -> None:
    nut = {"shape": "nut", "position_m": None, "length_m": 0.08, "stroke_m": [0.1, 0.3]}
    nut |= {"speed_channel": "n_rpm", "nut_friction": NUT, "duty": 0.8, "stroke_share": True}
    config = laws(nut)
    torque_Nm = friction.preload_torque_Nm(2000.0, 0.95, 0.01)
    wanted = 0.8 * (0.3 - 0.1) / 0.4 * torque_Nm * np.abs(SPEED) * math.pi / 30
    np.testing.assert_allclose(heat(config, "s0", SPEED), wanted)


def test_a_nut_that_turns_too() -> None:
    driven = {"speed_channel": "n_rpm", "nut_speed_channel": "nut_rpm", "torque_Nm": 0.3}
    config = laws(driven, driven | {"nut_torque_Nm": 0.2})
    nut = np.array([10.0, 30.0, 0.0, 2400.0])
    k = math.pi / 30
    np.testing.assert_allclose(heat(config, "s0", SPEED, nut), 0.3 * k * np.abs(SPEED - nut))
    np.testing.assert_allclose(heat(config, "s1", SPEED, nut), k * (0.3 * np.abs(SPEED) + 0.2 * nut))
    assert {"n_rpm", "nut_rpm"} <= set(config.channels)
    columns = {c: np.full(4, 20.0) for c in config.channels} | {"n_rpm": SPEED, "nut_rpm": nut}
    drive = Drive(config, build_plant(config))
    _, inputs = drive.run(drive.initial(), frames(config, 2.0 * np.arange(4), columns))
    law = np.column_stack([heat(config, name, SPEED, nut) for name in ("s0", "s1")])
    np.testing.assert_allclose(inputs.law_W[1:], (law[1:] + law[:-1]) / 2)


def test_a_bearing_takes_kims_part_of_the_nuts_heat() -> None:
    config = laws(
        {"speed_channel": "n_rpm", "nut_friction": NUT}, {"heat_of": "s0", "heat_ratio": 3.0, "scale": 1.5}
    )
    np.testing.assert_allclose(heat(config, "s1", SPEED), heat(config, "s0", SPEED) / 2)


def test_a_law_of_strength_one_times_its_strength_is_the_law() -> None:
    config = laws(
        {"speed_channel": "n_rpm", "torque_Nm": 0.3, "share": 0.5, "duty": 0.7},
        {"speed_channel": "n_rpm", "bearing": BEARING, "share": 0.5, "scale": 1.2},
        {"heat_of": "s0", "heat_ratio": 3.0, "scale": 1.5},
        {"heat_of": "s1", "heat_ratio": 2.0},
    )
    unit, strength = unit_laws(config)
    for source, size in zip(config.source, strength, strict=True):
        np.testing.assert_allclose(size * heat(unit, source.name, SPEED), heat(config, source.name, SPEED))


@pytest.mark.parametrize(
    ("source", "sentence"),
    [
        ({"bearing": BEARING}, 'source "s0": bearing needs speed_channel'),
        ({"speed_channel": "n", "bearing": BEARING, "torque_Nm": 1.0}, "only one heat law per source"),
        ({"speed_channel": "n", "bearing": BEARING | {"load_N": 5.0}}, "give either load_N, or axial_load_N"),
        (
            {"speed_channel": "n", "bearing": BEARING | {"f1": None}},
            "either f1, or static_load_N and static_r",
        ),
        (
            {"speed_channel": "n", "bearing": BEARING | {"viscosity_40_mm2_s": 46}},
            "either viscosity_mm2_s, or",
        ),
        ({"speed_channel": "n", "bearing": BEARING | {"type": "plain"}}, "bearing.type: input should be"),
        ({"speed_channel": "n", "nut_friction": {"efficiency": 0.9, "lead_m": 0.01}}, "nothing rubs without"),
        ({"speed_channel": "n", "nut_friction": NUT | {"lead_m": None}}, "needs the lead once; give lead_m"),
        (
            {"power_channel": "p", "nut_speed_channel": "n"},
            "nut_speed_channel belongs to torque_Nm or nut_fr",
        ),
        (
            {"speed_channel": "n", "nut_friction": NUT, "nut_torque_Nm": 1},
            "nut_torque_Nm needs torque_Nm and",
        ),
        ({"power_channel": "p", "duty": 0.5}, "duty belongs to a law of the speed"),
        ({"speed_channel": "n", "torque_Nm": 1, "stroke_share": True}, "give stroke_m"),
        ({"heat_of": "s0"}, "heat_of and heat_ratio belong together"),
        ({"heat_of": "s0", "heat_ratio": 2.0}, "heat_of names no source with a heat law of its own"),
    ],
)
def test_a_law_that_is_incomplete_or_contradicts_itself_is_refused(
    source: dict[str, Any], sentence: str
) -> None:
    with pytest.raises(ConfigError, match=sentence):
        laws(source)


def test_the_rod_has_the_film_of_the_law() -> None:
    by_law = laws({"power_channel": "p"}, surface={"law": "churchill-chu", "rise_K": 8.0})
    film = rod_of(by_law).fin_1_m ** 2 * 50.0 * 0.02 / 4
    assert 5.0 < film < 9.0  # a bare horizontal cylinder of 20 mm, 8 K warm, without radiation
    by_number = laws({"power_channel": "p"}, surface={"convection_W_m2K": film})
    np.testing.assert_allclose(build_plant(by_law).decay_1_s, build_plant(by_number).decay_1_s)


def friction_machine() -> dict[str, Any]:
    """A screw whose nut and bearing warm it by the catalogue, in the air by the book."""
    return table(
        source=[
            {"name": "nut", "shape": "nut", "length_m": 0.05, "stroke_m": [0.1, 0.3],
             "speed_channel": "n_rpm", "nut_friction": NUT, "share": 0.5},
            {"name": "bearing", "shape": "point", "position_m": 0.0, "speed_channel": "n_rpm",
             "bearing": BEARING, "share": 0.5},
        ],
        surface={"law": "churchill-chu", "factor": 3.0, "emissivity": 0.2},
    )  # fmt: skip


def program() -> tuple[FloatArray, dict[str, FloatArray]]:
    time_s = np.arange(0.0, 4000.0, 2.0)
    speed_rpm = np.where(time_s < 1500, 600.0, np.where(time_s < 2600, 2400.0, 0.0))
    speed_rpm[0] = 0.0  # as in a screw of one temperature; of one that runs an estimator takes it to have run
    return time_s, {"n_rpm": speed_rpm}


def test_simulate_and_replay_use_the_laws(tmp_path: Path) -> None:
    """What `simulate` predicts from the laws, `replay` finds again as heats, with no law to lean on."""
    config = parse(friction_machine())
    time_s, columns = program()
    write_log(tmp_path / "program.csv", time_s, columns)
    run = observer.Machine(config, b"").simulate(tmp_path / "program.csv", start_degC=20.0)
    run.write(tmp_path, "log.csv")

    blind = friction_machine()
    for source in blind["source"]:
        for key in ("nut_friction", "bearing"):
            source.pop(key, None)
    unlawful = parse(blind)
    for name, settings in (("lawful", config), ("blind", unlawful)):
        observer.Machine(settings, b"").replay(tmp_path / "log.csv").write(tmp_path / name)
    log = read_log(tmp_path / "log.csv")
    truth = {name: log.values[:, log.channels.index(f"heat_{name}_W")] for name in ("nut", "bearing")}
    rest = (time_s > 1400) & (time_s < 1500)
    for name in ("nut", "bearing"):
        wanted = heat(config, name, np.array([600.0]))[0]
        assert truth[name][rest] == pytest.approx(wanted)
        found = {}
        for kind in ("lawful", "blind"):
            read = read_log(tmp_path / kind / "estimates.csv", [f"heat_{name}_W"])
            found[kind] = read.values[:, 0]
        # the log is without noise and from the same model: with the law nothing is left to find
        np.testing.assert_allclose(found["lawful"], truth[name], atol=0.02)
        np.testing.assert_allclose(found["blind"][rest], wanted, rtol=0.05)


def test_calibrate_finds_what_multiplies_laws_and_film() -> None:
    """The defaults of `[calibrate]` with laws: the practice factor and each law's scale."""
    table = friction_machine()
    table["source"][0]["scale"], table["source"][1]["scale"] = 1.3, 0.7
    true = parse(table)
    time_s, columns = program()
    plant = build_plant(true)
    drive = Drive(true, plant)
    columns |= {s.channel: np.full_like(time_s, 20.0) for s in true.sensor}
    inputs = drive.run(drive.initial(), frames(true, time_s, columns))[1]
    rows = simulate(plant, start(plant, 20.0, inputs.law_W[0]), inputs)[1]
    columns |= {s.channel: rows[:, i] for i, s in enumerate(true.sensor)}
    guess = parse(
        friction_machine() | {"surface": {"law": "churchill-chu", "factor": 2.0, "emissivity": 0.2}}
    )
    found = calibrate(guess, [[frames(guess, time_s, columns)]])
    # a fit ends where no step lowers the deviance by 0.05, a fifth of a σ, and σ is some per cent of each
    assert found.values["surface.factor"] == pytest.approx(3.0, rel=1e-2)
    assert found.values["source.nut.scale"] == pytest.approx(1.3, rel=1e-2)
    assert found.values["source.bearing.scale"] == pytest.approx(0.7, rel=1e-2)


def test_the_example_of_kim_is_described_by_kims_own_equations() -> None:
    config = load(Path(__file__).parents[2] / "config" / "kim-screw.toml")
    speed = np.array([500.0])
    nut_W = 500 * math.pi / 30 * 0.3 * 1.0 * (0.4 - 0.1) / 0.5
    assert heat(config, "nut", speed)[0] == pytest.approx(nut_W)
    for bearing in ("left_bearing", "right_bearing"):
        assert heat(config, bearing, speed)[0] == pytest.approx(nut_W / 3, rel=1e-9)
