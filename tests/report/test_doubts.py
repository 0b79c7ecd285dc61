"""Slips of the unit: refused where no machine is so, doubted where few are, each with the likely unit."""

from __future__ import annotations

from typing import Any

import pytest

from observer.errors import ConfigError
from observer.installation import parse
from observer.report.check import doubts
from tests.system.bad_inputs import MODBUS, changed

POINT = {"name": "end", "shape": "point", "position_m": 0.0}
DRIVE = {"kind": "canopen", "interface": "virtual", "channel": "x", "node_id": 5}
SLIPS: dict[str, tuple[dict[str, Any], str, str]] = {
    "expansion in 1e-6/K": ({"screw__expansion_1_K": 11.8}, "refused", "1.18e-05 (11.8 · 10⁻⁶/K)"),
    "expansion in mm/mK": ({"screw__expansion_1_K": 11.8e-3}, "refused", "1.18e-05 (0.0118 mm/(m K))"),
    "diameter in mm": ({"screw__diameter_m": 40}, "refused", "0.04 (40 mm)"),
    "diameter in cm": ({"screw__diameter_m": 4.0}, "doubted", "screw.diameter_m = 4"),
    "length in mm": ({"screw__length_m": 1000}, "refused", "1 (1000 mm)"),
    "density in g/cm³": ({"screw__density_kg_m3": 7.85}, "refused", "7850 (7.85 g/cm³)"),
    "specific heat in kJ": ({"screw__specific_heat_J_kgK": 0.46}, "refused", "460 (0.46 kJ/kgK)"),
    "conductivity in kW": ({"screw__conductivity_W_mK": 0.05}, "doubted", "50 (0.05 kW/mK)"),
    "conductivity in mW": ({"screw__conductivity_W_mK": 50000}, "refused", "50 (50000 mW/mK)"),
    "much convection": ({"surface__convection_W_m2K": 1500}, "doubted", "convection_W_m2K = 1500"),
    "convection in kW": ({"surface__convection_W_m2K": 0.015}, "doubted", "15 (0.015 kW/m²K)"),
    "ambient in kelvin": ({"ambient__temperature_degC": 295}, "refused", "21.85 (295 K)"),
    "ambient in °F": ({"ambient__temperature_degC": 72}, "doubted", "22.2222 (72 °F)"),
    "noise in mK": ({"sensor__0__noise_K": 50}, "refused", "0.05 (50 mK)"),
    "position in mm": ({"sensor__0__position_m": 250}, "refused", "0.25 (250 mm)"),
    "position in mm, small": ({"sensor__0__position_m": 50}, "refused", "0.05 (50 mm)"),
    "stroke in mm": ({"source__0__stroke_m": [200, 800]}, "refused", "0.8 (800 mm)"),
    "lead in mm": ({"source__0__lead_m": 10}, "refused", "0.01 (10 mm)"),
    "torque in Nmm": ({"source__0__torque_Nm": 300}, "doubted", "0.3 (300 Nmm)"),
    "heat in mW/rpm": (
        {"source__0__heat_W_rpm": 6, "source__0__torque_Nm": None}, "doubted", "0.006 (6 mW/rpm)",
    ),
    "period in ms": ({"estimator__period_s": 500}, "doubted", "0.5 (500 ms)"),
    "driver's period in ms": (
        {"drivers__tc": MODBUS | {"period_s": 500}}, "doubted", "drivers.tc.period_s = 500 is far",
    ),
    "counts per mm": (
        {"drivers__axis": DRIVE | {"counts_per_m": 1000.0}}, "doubted", "1e+06 (1000 counts per mm)",
    ),
    "share in %": ({"source__0__share": 50}, "refused", "0.5 (50 %)"),
    "sensors at one place": ({"sensor__1__position_m": 0.05}, "doubted", "t1 and t2 are both at 0.05 m"),
    "sources at one place": (
        {"source": [POINT, POINT | {"name": "other"}]}, "doubted", "end and other are both at 0 m",
    ),
    "stroke shorter than the nut": (
        {"source__0__stroke_m": [0.4, 0.45]}, "doubted", "the stroke of 0.05 m is shorter than the nut",
    ),
    "nut longer than the screw": ({"source__0__length_m": 1.2}, "refused", "longer than the screw"),
    "noise finer than the device": (
        {"drivers__tc": MODBUS, "sensor__0__noise_K": 0.001}, "doubted", "steps of 0.1 K alone make 0.029 K",
    ),
    "registers that overlap": (
        {"drivers__tc": {"kind": "modbus_tcp", "host": "h", "channels": {
            "a_degC": {"register": 3, "type": "float32"}, "b_degC": {"register": 4}}}},
        "doubted", "a_degC and b_degC both read register 4",
    ),
    "one register by two drivers": (
        {"drivers__tc": MODBUS, "drivers__too": MODBUS | {"channels": {"t2_degC": 0}}},
        "doubted", "t1_degC and t2_degC of drivers.too both read register 1",
    ),
}  # fmt: skip


@pytest.mark.parametrize(("changes", "outcome", "words"), SLIPS.values(), ids=SLIPS)
def test_an_atypical_value_is_reported_with_what_was_probably_meant(changes, outcome, words):
    table = changed(**changes)
    if outcome == "refused":
        with pytest.raises(ConfigError) as caught:
            parse(table)
        said = str(caught.value).splitlines()
    else:
        said = doubts(parse(table))
    (line,) = [one for one in said if words in one]
    assert line


def test_a_page_in_the_clear_is_doubted():
    page = {"listen": "0.0.0.0:8080", "users_file": "users"}
    (doubt,) = doubts(parse(changed(page=page)))
    assert "unencrypted" in doubt
    assert doubts(parse(changed(page=page | {"certificate": "c.pem", "key": "k.pem"}))) == []


def test_good_values_are_not_doubted():
    assert doubts(parse(changed())) == []
