"""Friction against the printed formulas in their own units, hand-worked numbers, and power balances."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from observer.physics import friction

SPEEDS = np.array([0.0, 20.0, 49.9, 50.1, 180.0, 216.0, 3000.0])


def test_palmgrens_torques_are_the_printed_ones_in_newton_millimetres() -> None:
    """Yu's 7210AC (50/90 mm, so 70 mm in the mean) under 500 N with an oil of 40 mm²/s."""
    d_mm, nu = 70.0, 40.0
    printed_Nmm = [
        160e-7 * 2 * d_mm**3 if nu * n < 2000 else 1e-7 * 2 * (nu * n) ** (2 / 3) * d_mm**3 for n in SPEEDS
    ]
    wet_Nm = friction.lubricant_torque_Nm(SPEEDS, 2.0, nu, d_mm / 1000)
    np.testing.assert_allclose(1000 * wet_Nm, printed_Nmm, rtol=1e-12)
    # worked by hand: (40 · 216)^(2/3) = 421.06, times 2e-7 · 343000
    assert 1000 * wet_Nm[5] == pytest.approx(28.885, rel=1e-4)

    kind = friction.BEARING_TYPES["angular_contact"]
    f1 = friction.load_factor(kind, 190.0, 19_000.0)
    assert f1 == pytest.approx(0.0013 * 0.01**0.33)
    dry_Nm = friction.load_torque_Nm(f1, friction.bearing_load_N(kind, 500.0, 0.0), d_mm / 1000)
    assert 1000 * dry_Nm == pytest.approx(f1 * 500.0 * d_mm)


def test_the_heat_is_the_printed_one() -> None:
    """1.047e-4 is π/30 in N mm, rounded by the print."""
    heat_W = friction.friction_heat_W(0.035, np.array([-216.0, 0.0, 216.0]))
    np.testing.assert_allclose(heat_W, [1.047e-4 * 216 * 35.0, 0.0, 1.047e-4 * 216 * 35.0], rtol=3e-4)


def test_a_radial_load_alone_is_the_load_that_acts() -> None:
    pair = friction.BEARING_TYPES["angular_contact_pair"]
    assert friction.bearing_load_N(pair, 0.0, 300.0) == 300.0
    assert friction.bearing_load_N(pair, 1000.0, 300.0) == pytest.approx(1440.0 - 30.0)


def test_viscosity_lies_on_the_line_of_the_standard_chart() -> None:
    degC = np.array([-10.0, 0.0, 20.0, 40.0, 60.0, 100.0, 130.0])
    nu = np.array([friction.viscosity_mm2_s(t, 46.0, 6.8) for t in degC])
    assert nu[3] == pytest.approx(46.0)
    assert nu[5] == pytest.approx(6.8)
    chart = np.log10(np.log10(nu + 0.7))
    line = np.polyfit(np.log10(degC + 273.15), chart, 1)
    np.testing.assert_allclose(np.polyval(line, np.log10(degC + 273.15)), chart, atol=1e-12)
    assert (np.diff(nu) < 0).all()


@given(preload_N=st.floats(1.0, 2e4), efficiency=st.floats(0.7, 0.999), lead_m=st.floats(1e-3, 0.05))
def test_a_preloaded_nut_turns_all_its_power_into_heat(
    preload_N: float, efficiency: float, lead_m: float
) -> None:
    """In a turn, driving one half takes F l and its waste; the other gives F l back, less the same waste."""
    work_J = preload_N * lead_m
    wasted_J = work_J / efficiency - work_J
    driven_J, returned_J = work_J + wasted_J, work_J - wasted_J
    torque_Nm = friction.preload_torque_Nm(preload_N, efficiency, lead_m)
    assert 2 * math.pi * torque_Nm == pytest.approx(driven_J - returned_J, rel=1e-9)
    assert friction.load_friction_torque_Nm(preload_N, efficiency, lead_m) == pytest.approx(torque_Nm / 2)


def test_a_nut_that_turns_with_the_screw_rubs_nothing_and_yet_both_drives_warm() -> None:
    screw, nut = np.array([216.0, 216.0, -216.0]), np.array([216.0, 180.0, 180.0])
    alone = friction.relative_heat_W(0.3, screw, nut)
    np.testing.assert_allclose(alone, friction.friction_heat_W(0.3, np.array([0.0, 36.0, 396.0])), atol=1e-12)
    both = friction.dual_drive_heat_W(0.02, 0.03, screw, nut)
    # Yu: 1.047e-4 (n_N M_N + n_S M_S), N mm
    np.testing.assert_allclose(both, 1.047e-4 * (np.abs(nut) * 30.0 + np.abs(screw) * 20.0), rtol=3e-4)


def test_kims_share_of_the_stroke() -> None:
    assert friction.stroke_share((0.1, 0.4), 0.5) == pytest.approx(0.6)
