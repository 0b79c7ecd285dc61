"""The heat that effects take, against closed forms on fields that are written down."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from observer.config.effects.catalogue import BY_KIND
from observer.config.machine import Config
from observer.discovery.family import ScrewHistory, loss_W
from tests.logs.machines import machine

STEPS, LENGTH_M, DIAMETER_M = 60, 0.4, 0.02
AIR_DEGC, SPEED_RPM = 20.0, 1000.0
SURFACE_M2 = np.pi * DIAMETER_M * LENGTH_M


def history(left_K: float, right_K: float) -> ScrewHistory:
    """A screw that is so much warmer than the air at its ends, straight between them."""
    position_m = np.linspace(0.0, LENGTH_M, 9)
    excess_K = left_K + (right_K - left_K) * position_m / LENGTH_M
    return ScrewHistory(
        position_m=position_m,
        temperature_degC=np.tile(AIR_DEGC + excess_K, (STEPS, 1)),
        ambient_degC=np.full(STEPS, AIR_DEGC),
        length_s=np.full(STEPS, 10.0),
        channels={"n_rpm": np.where(np.arange(STEPS) < 30, SPEED_RPM, 0.0)},
        counted=np.ones(STEPS, dtype=bool),
    )


def taken(effect: dict[str, Any], of: ScrewHistory) -> Any:
    config: Config = machine()
    return loss_W(BY_KIND[effect["kind"]].model_validate(effect), config, of)


def test_a_film_takes_heat_from_the_whole_surface() -> None:
    found = taken({"kind": "surface_convection", "coefficient_W_m2K": 3.0}, history(0.0, 20.0))
    assert found == pytest.approx(np.full(STEPS, 3.0 * SURFACE_M2 * 10.0))


def test_an_uneven_film_takes_heat_from_its_own_stretch() -> None:
    """From 0.03 to 0.1 m, between places, the rise is 3.25 K on average."""
    stretch = {"kind": "uneven_convection", "from_m": 0.03, "to_m": 0.1, "extra_W_m2K": -4.0}
    assert taken(stretch, history(0.0, 20.0)) == pytest.approx(-4.0 * np.pi * DIAMETER_M * 0.07 * 3.25)


def test_radiation_goes_with_the_fourth_power() -> None:
    rise_K = 60.0
    fourth = (AIR_DEGC + rise_K + 273.15) ** 4 - (AIR_DEGC + 273.15) ** 4
    found = taken({"kind": "radiation", "emissivity": 0.5}, history(rise_K, rise_K))
    assert found == pytest.approx(0.5 * 5.670374419e-8 * fourth * SURFACE_M2)


def test_speed_convection_and_coolant_take_heat_only_while_the_screw_turns() -> None:
    found = taken({"kind": "speed_convection", "gain": 0.2}, history(10.0, 10.0))
    assert found[0] > 0.0
    assert found[:30] == pytest.approx(found[0])
    assert found[30:] == pytest.approx(0.0)
    cold = taken({"kind": "coolant", "conductance_W_K": 0.3, "inlet_degC": 24.0}, history(10.0, 10.0))
    assert cold[:30] == pytest.approx(0.3 * 6.0)  # to the inlet, not to the air
    assert cold[30:] == pytest.approx(0.0)


@pytest.mark.parametrize(("target", "rise_K"), [("left", 4.0), ("right", 14.0)])
def test_an_effect_at_an_end_takes_heat_at_the_rise_of_that_end(target: str, rise_K: float) -> None:
    end = {"kind": "end_conduction", "target": target, "conductance_W_K": 0.5}
    assert taken(end, history(4.0, 14.0)) == pytest.approx(0.5 * rise_K)
    heat = {"kind": "end_heat", "target": target, "heat_W_rpm": 2e-3}
    assert taken(heat, history(4.0, 14.0))[[0, -1]] == pytest.approx([-2.0, 0.0])


def test_an_attached_body_takes_the_heat_that_it_stores() -> None:
    """A step of the screw's end by 10 K: C (1 − e^{−t/τ}) 10 K in all."""
    of = history(0.0, 0.0)
    of.temperature_degC[1:] += 10.0
    body = {"kind": "attached_mass", "target": "right", "capacity_J_K": 300.0, "conductance_W_K": 1.5}
    stored_J = np.cumsum(taken(body, of) * of.length_s)
    since_s = np.cumsum(of.length_s) - of.length_s[0]
    assert stored_J == pytest.approx(3000.0 * (1 - np.exp(-since_s / 200.0)))


@pytest.mark.parametrize(
    "effect",
    [
        {"kind": "sensor_lag", "target": "a", "time_constant_s": 50.0},
        {"kind": "ambient_drift", "rate_K_h": 2.0},
        {"kind": "friction_speed", "target": "bearing.l", "exponent": 1.4},
    ],
)
def test_what_takes_no_heat_from_the_screw_takes_none(effect: dict[str, Any]) -> None:
    assert taken(effect, history(5.0, 5.0)) == pytest.approx(np.zeros(STEPS))
