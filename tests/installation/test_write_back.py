from __future__ import annotations

import difflib
import tomllib

import pytest

from observer.config.effects.bodies import EndConduction
from observer.config.effects.sensing import SensorLag
from observer.errors import ConfigError
from observer.fit.parameters import get, rounded
from observer.installation import parse, with_effects, write_back
from tests.logs.machines import RIG

TEXT = """\
# bench 3, after the rebuild
[surface]            # bare screw
convection_W_m2K = 15.0   # from the handbook

[[source]]
name = "nut"   # the hot one
torque_Nm=0.3  # catalogue

[[source]]
name = "left.bearing"
heat_W_rpm = 6e-3
"""


def test_only_the_values_change() -> None:
    written = write_back(TEXT, {"surface.convection_W_m2K": 13.91234567, "source.nut.torque_Nm": 0.3331})
    assert written == TEXT.replace("15.0", "13.912").replace("0.3 ", "0.3331 ")


def test_new_keys_join_their_tables() -> None:
    written = write_back(TEXT, {"source.left.bearing.scale": 1.25, "estimator.field_noise_K_sqrt_s": 0.01})
    table = tomllib.loads(written)
    assert table["source"][1] == {"name": "left.bearing", "heat_W_rpm": 6e-3, "scale": 1.25}
    assert table["estimator"] == {"field_noise_K_sqrt_s": 0.01}
    removed = [line for line in difflib.ndiff(TEXT.splitlines(), written.splitlines()) if line[0] == "-"]
    assert removed == []


def test_a_whole_configuration_stays_valid() -> None:
    text = (RIG / "config.toml").read_text()
    values = {"source.right_bearing.scale": 0.75, "surface.convection_W_m2K": 14.0}
    config = parse(tomllib.loads(write_back(text, values)))
    assert {key: get(config, key) for key in values} == values


def test_an_unknown_source_is_rejected() -> None:
    with pytest.raises(ConfigError, match='no source called "motor"'):
        write_back(TEXT, {"source.motor.scale": 1.0})


@pytest.mark.parametrize(
    ("value", "digits"), [(0.0, 0.0), (13.9123456, 13.912), (1.234567e-7, 1.2346e-7), (-98765.43, -98765.0)]
)
def test_values_keep_five_digits(value: float, digits: float) -> None:
    assert rounded(value) == digits


def test_effects_are_added_and_every_line_of_before_stays() -> None:
    own = '[[effect]] # ours\nkind = "sensor_bias"\ntarget = "t1"\noffset_K = 0.10  # from the last check\n'
    found = [
        EndConduction(kind="end_conduction", target="left", conductance_W_K=0.1000123),
        SensorLag(kind="sensor_lag", target="t3", time_constant_s=59.87654),
    ]
    for text in (TEXT, f"{TEXT}\n{own}"):
        written = with_effects(text, found)
        lost = [line for line in difflib.ndiff(text.splitlines(), written.splitlines()) if line[0] == "-"]
        assert lost == []
        before = tomllib.loads(text)
        table = tomllib.loads(written)
        assert table["effect"] == [
            *before.pop("effect", []),
            {"kind": "end_conduction", "target": "left", "conductance_W_K": 0.10001},
            {"kind": "sensor_lag", "target": "t3", "time_constant_s": 59.877},
        ]
        assert {key: value for key, value in table.items() if key != "effect"} == before
