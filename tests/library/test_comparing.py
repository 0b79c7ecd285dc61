"""Variants side by side: the papers' examples by the files that are shipped, cycles, sensors, mistakes."""

from __future__ import annotations

import csv
import io
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

import observer
from observer.cli import app
from tests.truth import kuznetsov
from tests.truth.bar import Bar

ROOT = Path(__file__).parents[2]
CONFIG = ROOT / "config"
RIG = ROOT / "tests" / "data" / "rig" / "config.toml"
KUZNETSOV = Bar(
    length_m=1.0, diameter_m=0.040, conductivity_W_mK=45.0, density_kg_m3=7850.0, specific_heat_J_kgK=470.0,
    convection_W_m2K=25.0, expansion_1_K=12e-6,
)  # fmt: skip


def compared(config: str, variants: str, **how: Any) -> observer.Comparison:
    """Shipped variants of a shipped configuration."""
    machine = observer.load(CONFIG / f"{config}.toml")
    return machine.compare(CONFIG / "variants" / f"{variants}.toml", **how)


def test_yus_drives_at_one_feed_as_the_paper_finds_them() -> None:
    """Section 3.4 and 3.5: driven by both every node is warmer, and every error larger, than by the screw."""
    found = {case.name: case for case in compared("yu-dual-drive", "yu-drives", steady=True).cases}
    screw, nut, both, thin = (found[name] for name in ("screw", "nut", "both", "both, thin film"))
    assert screw.heat_W["nut"] == pytest.approx(nut.heat_W["nut"])  # the same feed
    for place, value in screw.temperature_degC.items():
        assert both.temperature_degC[place] > value
    assert (both.error_um[1:] > screw.error_um[1:]).all()
    assert screw.heat_W["nut_bearing"] == nut.heat_W["left_bearing"] == 0.0
    # ten times less film: more than twice the growth, for the ends of the fin get longer
    assert thin.error_um[-1] > 2.0 * both.error_um[-1]


def test_t2_of_yu_is_above_t3_where_the_far_bearing_carries_what_the_near_one_does() -> None:
    found = compared("yu-dual-drive", "yu-far-bearing", steady=True).cases
    rises = [{place: case.temperature_degC[place] - 25.0 for place in ("t1", "t2", "t3")} for case in found]
    assert [rise["t2"] > rise["t3"] for rise in rises] == [False, True, True]
    # the ends of the screw are alike, so the rises at the bearings are as their heats: printed, 6.21 to 3.2
    ratios = [rise["t1"] / rise["t2"] for rise in rises]
    assert ratios[0] > 10.0
    assert ratios[2] == pytest.approx(6.21 / 3.2, rel=0.1)


def test_kuznetsovs_mountings_by_his_steady_displacement() -> None:
    found = compared("kuznetsov-screw", "kuznetsov-mountings", steady=True)
    cases = {case.name: case for case in found.cases}
    x_m, heats_W = found.cases[0].position_m, (0.02 * 600, 0.012 * 600)
    held = kuznetsov.steady_displacement_um(KUZNETSOV, heats_W, (200e6, 100e6), 2.06e11, x_m)
    np.testing.assert_allclose(cases["L-III, both hold"].error_um, held, rtol=0, atol=1e-6)
    grown_um = 12.0 * kuznetsov.steady_growth(KUZNETSOV, *heats_W, x_m)
    np.testing.assert_allclose(cases["L-II, right slides"].error_um, grown_um, rtol=0, atol=1e-6)
    np.testing.assert_allclose(cases["L-IV, no right support"].error_um, grown_um, rtol=0, atol=1e-6)
    np.testing.assert_allclose(cases["L-I, both slide"].error_um, grown_um - grown_um[-1] / 2, atol=1e-6)
    stretched, plain = cases["L-III, pre-stretched"], cases["L-III, both hold"]
    assert stretched.force_N == pytest.approx(plain.force_N + 4000.0)
    np.testing.assert_allclose(stretched.error_um, plain.error_um)
    gap = cases["L-III, gap of 20 µm"]
    assert gap.force_N == pytest.approx(plain.force_N * (1.0 - 20.0 / grown_um[-1]))


def test_the_warmest_and_coldest_of_the_screw_are_sought_between_the_reported_places() -> None:
    machine = observer.load(CONFIG / "kuznetsov-screw.toml")
    few = {"output": {"positions_m": [0.3, 0.7]}}
    inputs = {"screw_speed_rpm": 600.0}
    (found,) = machine.compare({"inputs": inputs, "variant": {"few": few}}, steady=True).cases
    x_m = np.linspace(0.0, KUZNETSOV.length_m, 2001)
    field_degC = 20.0 + kuznetsov.field(KUZNETSOV, 0.02 * 600, 0.012 * 600, x_m, 1e7)
    assert found.warmest_degC == pytest.approx(field_degC.max(), abs=1e-6)  # at an end
    # within a step of the search the curved field rises by less than half its second derivative times h²
    assert found.coldest_degC == pytest.approx(field_degC.min(), abs=0.002)
    assert found.field_degC.max() < found.warmest_degC - 10.0


def program(hours: float = 2.0) -> dict[str, Any]:
    """The nut to and fro, then rest."""
    time_s = np.arange(0.0, 3600.0 * hours, 2.0)
    works = time_s < 2400.0 * hours
    way_m = 0.15 + 0.65 * np.abs((time_s / 30.0) % 2.0 - 1.0)
    return {
        "time_s": time_s,
        "nut_position_m": np.where(works, way_m, 0.15),
        "screw_speed_rpm": np.where(works, 1500.0, 0.0),
        "ambient_degC": np.full_like(time_s, 22.0),
    }


def test_a_cycle_is_compared_by_its_most() -> None:
    table = {
        "variant": {
            "as it is": {},
            "more film": {"surface": {"convection_W_m2K": 60.0}},
            "slower": {"inputs": {"screw_speed_rpm": 500.0}},
            "two fixed ends": {"supports": {"mounting": "L-III"}},
            "few places": {"output": {"positions_m": [0.1, 0.9]}},
        }
    }
    machine = observer.load(RIG)
    found = machine.compare(table, log=program(), minimise="error")
    run = machine.simulate(program())
    as_it_is, film, slower, fixed, few = found.cases
    assert as_it_is.field_degC[-1] == pytest.approx(run["field_1000_degC"].max(), abs=1e-9)
    assert as_it_is.error_um[-1] == pytest.approx(run["error_1000_um"].max(), abs=1e-9)
    assert film.error_um[-1] < as_it_is.error_um[-1]
    assert slower.heat_W["nut"] < as_it_is.heat_W["nut"]
    assert (abs(fixed.error_um[-1]) < 1e-9, fixed.force_N < 0.0) == (True, True)
    for name in ("as it is", "two fixed ends"):
        assert found.mounted[name][0].supports.mounting == "L-III"
        assert found.mounted[name][0].size_um <= abs(fixed.largest_error_um) + 0.01
    assert any("rigid" in sentence for sentence in found.sentences)
    assert few.warmest_degC == pytest.approx(as_it_is.warmest_degC, abs=1e-9)
    assert few.coldest_degC == pytest.approx(as_it_is.coldest_degC, abs=1e-9)


def test_a_nuts_own_preload_is_said_to_stay() -> None:
    nut = {"torque_Nm": None, "nut_friction": {"efficiency": 0.9, "preload_N": 1000.0, "lead_m": 0.01}}
    del nut["torque_Nm"]
    table = {"variant": {"x": {"without": ["source.nut.torque_Nm"], "source": {"nut": nut}}}}
    inputs = {"screw_speed_rpm": 500.0, "ambient_degC": 20.0}
    found = observer.load(RIG).compare(table | {"inputs": inputs}, steady=True, minimise="error")
    assert any("nut's own preload" in sentence for sentence in found.sentences)


@pytest.mark.timeout(240)
def test_fewer_sensors_leave_more_unknown() -> None:
    table = {"inputs": {"screw_speed_rpm": 500.0, "ambient_degC": 20.0}}
    few = {"without": ["sensor.t2", "sensor.t4"]}
    found = observer.load(RIG).compare(table | {"variant": {"five": {}, "three": few}}, steady=True)
    five, three = found.unknown["five"], found.unknown["three"]
    assert five is not None
    assert three is not None
    assert three.field_K > five.field_K
    assert three.heat_W["nut"] > five.heat_W["nut"]


def test_the_command_prints_writes_and_draws(tmp_path: Path) -> None:
    variants = CONFIG / "variants" / "kuznetsov-mountings.toml"
    arguments = ["compare", "-c", str(CONFIG / "kuznetsov-screw.toml"), "--variants", str(variants)]
    done = CliRunner().invoke(
        app, [*arguments, "--steady", "--minimise", "error", "-o", str(tmp_path)], env={"COLUMNS": "100"}
    )
    assert done.exit_code == 0, done.output
    assert "largest error, µm" in done.output
    assert "least error of" in done.output
    with (tmp_path / "compare.csv").open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    document = json.loads((tmp_path / "compare.json").read_text("utf-8"))
    assert [row["variant"] for row in rows] == [one["name"] for one in document["variants"]]
    assert float(rows[2]["force_N"]) == document["variants"][2]["force_N"]
    best = document["minimised"]["L-III, both hold"][0]
    assert abs(best["largest_error_um"]) < abs(document["variants"][2]["largest_error_um"])
    assert abs(best["force_N"]) <= 6000.0
    assert (tmp_path / "compare.png").stat().st_size > 10_000


def test_the_steady_state_is_a_command_with_sentences(tmp_path: Path) -> None:
    arguments = ["simulate", "-c", str(CONFIG / "kuznetsov-screw.toml"), "--steady", "-o", str(tmp_path)]
    done = CliRunner().invoke(app, [*arguments, "--at", "screw_speed_rpm=600"])
    assert done.exit_code == 0, done.output
    document = json.loads((tmp_path / "steady.json").read_text("utf-8"))
    assert document["heat_W"] == {"left_bearing": 12.0, "right_bearing": pytest.approx(7.2)}
    assert (tmp_path / "steady.png").stat().st_size > 10_000
    for more, words in (
        ([], "needs a value of screw_speed_rpm"),
        (["--at", "screw_speed_rpm"], "give a channel and its value"),
        (["--at", "speed_rpm=3"], "did you mean screw_speed_rpm"),
        (["--at", "screw_speed_rpm=3", "--start-degC", "20"], "does not depend on"),
    ):
        failed = CliRunner().invoke(app, [*arguments, *more])
        assert words in str(failed.exception)
    assert "needs a cycle" not in done.output


def test_neither_steady_nor_a_log_is_a_sentence() -> None:
    with pytest.raises(observer.ConfigError, match="ask for the steady state"):
        observer.load(RIG).compare({"variant": {"x": {}}})
    with pytest.raises(observer.ConfigError, match='variant "x": the steady state needs a value of'):
        observer.load(RIG).compare({"variant": {"x": {}}}, steady=True)


def test_a_nut_is_held_where_it_is_said_to_be_however_seldom_a_log_has_rows() -> None:
    """A log of a row a minute does not show the way of a nut, but it is held for the whole of it."""
    machine = observer.load(CONFIG / "demo.toml")
    rows = {name: value[::30] for name, value in program(3.0).items()}
    rows["nut_position_m"] = np.where(np.arange(len(rows["time_s"])) % 2, 0.2, 0.6)
    variants = {"variant": {"to and fro": {}, "here": {"inputs": {"nut_position_m": 0.3}}}}
    for steady in (True, False):
        moving, held = machine.compare(variants, rows, steady=steady).cases
        warmer_K = held.field_degC - moving.field_degC
        assert warmer_K.max() > 1.0
        assert held.position_m[warmer_K.argmax()] == pytest.approx(0.3, abs=0.06)


@pytest.mark.parametrize(("channel", "value"), [("nut_position_m", 4.0), ("screw_speed_rpm", 5e6)])
def test_an_input_that_no_reading_could_have_is_refused(channel: str, value: float) -> None:
    inputs = {"nut_position_m": 0.3, "screw_speed_rpm": 500.0} | {channel: value}
    machine = observer.load(CONFIG / "demo.toml")
    with pytest.raises(observer.UserError, match=f"^{channel}: implausible: .*limits.{channel}"):
        machine.settle(inputs)
    with pytest.raises(observer.UserError, match=f'variant "a": {channel}: implausible'):
        machine.compare({"variant": {"a": {"inputs": inputs}}}, steady=True)


@pytest.mark.parametrize("width", [60, 80, 200])
def test_no_number_is_cut_where_many_variants_stand_side_by_side(width: int) -> None:
    from rich.console import Console

    from observer.cli.cases import comparison_as_text

    machine = observer.load(CONFIG / "demo.toml")
    speeds = {"sweep": {"speed": {"inputs": {"screw_speed_rpm": list(range(100, 1300, 100))}}}}
    inputs = {"inputs": {"nut_position_m": 0.3}}
    found = machine.compare(inputs | speeds, steady=True)
    console = Console(width=width, record=True, file=io.StringIO())
    console.print(comparison_as_text(found))
    said = console.export_text()
    assert "…" not in said
    assert all(f" {case.heat_W['nut']:.2f} " in said for case in found.cases)
    assert max(map(len, said.splitlines())) <= width
    assert (said.count("all heats, W") == 1) == (width == 200)


def test_a_nut_that_covers_the_film_is_kept_on_the_screw_as_a_whole() -> None:
    """Of half a nut the screw would be given back the film of a whole one."""
    text = (CONFIG / "li-network.toml").read_text("utf-8")
    with pytest.raises(observer.ConfigError, match=r"with its centre at 0\.03 m it reaches beyond the end"):
        observer.Machine.of_text(text.replace("stroke_m = [0.09, 0.51]", "stroke_m = [0.03, 0.51]"))
    machine = observer.Machine.of_text(text.replace("stroke_m = [0.09, 0.51]", "stroke_m = [0.04, 0.51]"))
    values = {"screw_speed_rpm": 500.0, "ambient_degC": 20.0, "nut_position_m": 0.03}
    with pytest.raises(observer.ConfigError, match="nut reaches beyond the screw there"):
        machine.settle({c: v for c, v in values.items() if c in machine.config.channels})


def test_a_comparison_as_pandas_has_the_rows_of_its_file(tmp_path: Path) -> None:
    import pandas as pd

    found = compared("yu-dual-drive", "yu-drives", steady=True)
    found.write(tmp_path / "out")
    written = pd.read_csv(tmp_path / "out" / "compare.csv", index_col="variant")
    pd.testing.assert_frame_equal(found.to_pandas(), written, check_exact=False)
