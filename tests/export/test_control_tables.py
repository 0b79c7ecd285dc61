"""Tables in the controls' formats have the correction's sign, read by the rules of each control."""

from __future__ import annotations

import re

import numpy as np

from observer.export.control_tables import klipper, linuxcnc, sinumerik

MACHINE_M = np.array([0.3, 0.2, 0.1])  # a machine that counts opposite to the screw
ERROR_UM = np.array([30.0, 10.0, -5.0])


def test_linuxcnc_adds_the_trims_to_the_position() -> None:
    """What it commands, nominal plus trim, plus the screw's error is where the nut should be."""
    table = linuxcnc(MACHINE_M, ERROR_UM, "title", "X")
    rows = np.array([[float(x) for x in line.split()] for line in table.text.splitlines()])
    assert np.all(np.diff(rows[:, 0]) > 0.0)
    for nominal_mm, forward_mm, reverse_mm in rows:
        error_mm = np.interp(nominal_mm, 1000.0 * MACHINE_M[::-1], ERROR_UM[::-1] / 1000.0)
        np.testing.assert_allclose(nominal_mm + forward_mm + error_mm, nominal_mm, atol=1e-9)
        assert forward_mm == reverse_mm


def test_sinumerik_has_every_point_between_min_and_max() -> None:
    """A positive value moves the axis in the negative direction, so it is the error."""
    text = sinumerik(MACHINE_M, ERROR_UM, "title", "X1", reference=1).text
    values = re.findall(r"^\$AA_ENC_COMP\[0,(\d+),X1\]=(\S+)$", text, flags=re.M)
    assert [int(k) for k, _ in values] == [0, 1, 2]
    np.testing.assert_allclose([float(v) for _, v in values], [-0.015, 0.0, 0.020])
    number = {
        key: float(v) for key, v in re.findall(r"^\$AA_ENC_COMP_(\w+)\[0,X1\]=(\S+)$", text, flags=re.M)
    }
    assert number == {"STEP": 100.0, "MIN": 100.0, "MAX": 300.0, "IS_MODULO": 0.0}
    assert text.endswith("M17\n")


def test_klipper_takes_the_sensor_that_explains_most() -> None:
    rng = np.random.default_rng(1)
    warm_K = np.linspace(0.0, 10.0, 50)
    other_K = np.abs(warm_K - 5.0) + 0.01 * rng.normal(size=50)
    table = klipper(("far", "near"), np.column_stack([other_K, 20.0 + warm_K]), 3.0 * warm_K, "title")
    assert "temp_coeff: 0.003000" in table.text
    assert "near explains" in table.facts[0]
