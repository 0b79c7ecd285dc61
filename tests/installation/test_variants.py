"""Variants: overrides by path, entries by name, what is taken away, sweeps, and sentences for mistakes."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any

import pytest

from observer.errors import ConfigError
from observer.installation.variants import MOST_VARIANTS, variants_of

CONFIG = Path(__file__).parents[2] / "config"
YU = tomllib.loads((CONFIG / "yu-dual-drive.toml").read_text("utf-8"))


def read(text: str, base: dict[str, Any] = YU) -> tuple[Any, ...]:
    return variants_of(tomllib.loads(text), "v.toml", base)


@pytest.mark.parametrize("path", sorted((CONFIG / "variants").glob("*.toml")), ids=lambda p: p.stem)
def test_every_example_is_read(path: Path) -> None:
    base = CONFIG / ("yu-dual-drive.toml" if path.stem.startswith("yu") else "kuznetsov-screw.toml")
    assert len(read(path.read_text("utf-8"), tomllib.loads(base.read_text("utf-8")))) > 1


def test_overrides_go_by_path_and_by_name_and_leave_the_rest() -> None:
    one, two = read(
        """
        [inputs]
        t4_degC = 25
        [variant.one]
        source.nut.torque_Nm = 0.4
        source.left_bearing.bearing.viscosity_mm2_s = 20.0
        surface.factor = 3.0
        link."n5 - nut".conductivity_W_mK = 30.0
        inputs.screw_speed_rpm = 500
        [variant.two]
        without = ["source.nut.nut_torque_Nm", "sensor.t2"]
        sensor.t9 = { name = "t9", channel = "t9_degC", position_m = 0.1 }
        source.nut.estimate = false
        inputs = { t4_degC = 20.5 }
        """
    )
    sources = {s.name: s for s in one.config.source}
    assert sources["nut"].torque_Nm == 0.4
    assert sources["nut"].nut_torque_Nm == 0.05
    assert sources["left_bearing"].bearing.viscosity_mm2_s == 20.0
    assert one.config.surface.factor == 3.0
    assert one.config.link[0].conductivity_W_mK == 30.0
    assert one.config.link[1].conductivity_W_mK == 50.0
    assert one.inputs == {"t4_degC": 25.0, "screw_speed_rpm": 500.0}
    assert {s.name: s for s in two.config.source}["nut"].nut_torque_Nm is None
    assert [s.name for s in two.config.sensor] == ["t1", "t3", "t9"]
    assert two.inputs == {"t4_degC": 20.5}
    assert "sensor.t2" in two.changed


def test_an_effect_goes_by_its_kind_and_supports_can_be_replaced() -> None:
    (found,) = read(
        """
        [variant.x]
        without = ["supports"]
        supports = { mounting = "L-III", gap_m = 1e-5 }
        effect.radiation = { kind = "radiation", emissivity = 0.3 }
        """
    )
    assert (found.config.supports.mounting, found.config.supports.gap_m) == ("L-III", 1e-5)
    assert found.config.effect[0].kind == "radiation"


def test_a_sweep_is_a_variant_for_each_value_and_a_grid_of_several() -> None:
    found = read(
        """
        [sweep.load]
        source.nut.torque_Nm = [0.1, 0.2]
        [sweep.grid]
        surface.factor = [1.0, 5.0, 10.0]
        inputs.screw_speed_rpm = [100, 200]
        """
    )
    assert [v.name for v in found[:3]] == [
        "load 0.1",
        "load 0.2",
        "grid: factor 1, screw_speed_rpm 100",
    ]
    assert len(found) == 8
    assert (found[-1].config.surface.factor, found[-1].inputs["screw_speed_rpm"]) == (10.0, 200.0)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "v.toml: nothing to compare"),
        ("[varient.x]", 'v.toml: "varient" is not a table'),
        ("variant = 3", "v.toml: variant: is not a table"),
        ("[variant.x]\nsurface.convection_W_m2 = 3.0", '(?s)v.toml: variant "x": .*mean convection_W_m2K'),
        (
            "[variant.x]\nsource.nutt.torque_Nm = 0.1",
            r'variant "x": source.nutt: no source is called "nutt" \(did you mean nut\?\)',
        ),
        ("[variant.x]\nsource.nut.torque_Nm = -1.0", 'v.toml: variant "x": .*torque_Nm'),
        ("[variant.x]\nsource.nut = 3", 'variant "x": source.nut: is not a table'),
        ("[variant.x]\ninputs.speed_rpm = 3", 'variant "x": inputs: the model reads no input "speed_rpm"'),
        ('[variant.x]\ninputs.t4_degC = "warm"', "t4_degC = 'warm' is no number"),
        ("[variant.x]\ninputs.t4_degC = nan", "is no number"),
        (
            "[variant.x]\nwithout = ['sensor.t7']",
            r'variant "x": without: sensor.t7: no sensor is called "t7"; there are t1, t2, t3',
        ),
        ("[variant.x]\nwithout = ['surface.rise']", 'does not give "surface.rise"'),
        ("[variant.x]\nwithout = 'supports'", "give a list of keys"),
        ("[sweep.s]\nsurface.factor = 3.0", 'sweep "s": surface.factor: give a list'),
        ("[sweep.s]\nsurface.factor = []", 'sweep "s": surface.factor: give a list'),
        ("[sweep.s]", 'sweep "s": sweeps nothing'),
        (f"[sweep.s]\nsurface.factor = {[1.0 + i for i in range(MOST_VARIANTS + 1)]}", "shorten a sweep"),
        ("[sweep.s]\nsurface.factor = [2.0, 2.0]", 'two variants are called "s 2"'),
    ],
)
def test_a_mistake_is_said_in_a_sentence(text: str, words: str) -> None:
    with pytest.raises(ConfigError, match=words):
        read(text)
