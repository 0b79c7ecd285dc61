"""A surface law that follows the speed: the same loss as the effect `speed_convection`, never both."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from observer.config.effects.film import SpeedConvection
from observer.config.effects.terms import SpeedLoss
from observer.config.machine import Config
from observer.errors import ConfigError
from observer.frames import FloatArray
from observer.installation import parse
from observer.model.build import build_plant
from observer.model.drive import Drive
from observer.model.rod.screw import surface_film_W_m2K, turning_film
from observer.model.simulate import simulate, start
from observer.physics import film
from observer.physics.film import YU_AIR
from tests.logs.machines import table
from tests.logs.simulated import frames

SPEED_RPM = np.array([0.0, 100.0, -800.0, 3000.0])


def screw(**tables: Any) -> Config:
    heater = [{"name": "heater", "shape": "point", "position_m": 0.1, "power_channel": "heater_W"}]
    return parse(table(source=heater, **tables))


def temperatures(config: Config, speed_rpm: FloatArray) -> FloatArray:
    """Open-loop temperatures (K, s) under 20 W for an hour."""
    time_s = 10.0 * np.arange(len(speed_rpm))
    columns = {"heater_W": np.full_like(time_s, 20.0), "n_rpm": speed_rpm}
    columns |= {s.channel: np.full_like(time_s, 20.0) for s in config.sensor}
    plant = build_plant(config)
    drive = Drive(config, plant)
    inputs = drive.run(drive.initial(), frames(config, time_s, columns))[1]
    return simulate(plant, start(plant, 20.0, inputs.law_W[0]), inputs)[1][:, plant.rows.sensor_slice]


def film_of_the_effect(config: Config) -> FloatArray:
    """The film at `SPEED_RPM` that the effect adds at a gain of 1."""
    (term,) = SpeedConvection(kind="speed_convection", gain=1.0, speed_channel="n_rpm").terms(config)
    assert isinstance(term, SpeedLoss)
    return term.film_W_m2K(SPEED_RPM)


def test_law_and_effect_count_turning_alike() -> None:
    """Re = ω d²/ν in both; in the air that Yu prints they are the same number."""
    d_m = 0.032
    reynolds = film.rotating_reynolds(SPEED_RPM, d_m, YU_AIR)
    assert reynolds[3] == pytest.approx(3000.0 * math.pi / 30 * d_m**2 / 15.5e-6)
    law = film.film_W_m2K(film.rotating_nusselt(reynolds, YU_AIR.prandtl), d_m, YU_AIR)
    np.testing.assert_allclose(film_of_the_effect(screw(screw=table()["screw"] | {"diameter_m": d_m})), law)


def test_a_law_with_a_speed_channel_cools_as_its_film_at_rest_with_the_effect() -> None:
    """The gain that makes up for the factor and for the air's temperature turns the effect into the law."""
    law = {"law": "rotating-cylinder", "factor": 3.0, "emissivity": 0.2}
    by_law = screw(surface=law | {"speed_channel": "n_rpm"})
    d_m = by_law.screw.diameter_m
    turning = turning_film(by_law.surface, d_m)
    assert turning is not None
    gain = float(turning(SPEED_RPM)[3] / film_of_the_effect(screw())[3])
    assert gain == pytest.approx(3.0, rel=0.03)  # Yu's constants of air against those at 25 °C
    still = surface_film_W_m2K(by_law.surface, d_m)
    effect = {"kind": "speed_convection", "gain": gain, "speed_channel": "n_rpm"}
    by_effect = screw(surface={"convection_W_m2K": still}, effect=[effect])
    speed = np.where(np.arange(360) < 180, 2000.0, 0.0)
    cooled = temperatures(by_law, speed)
    np.testing.assert_allclose(cooled, temperatures(by_effect, speed), atol=1e-9)
    standing = temperatures(screw(surface=law), speed)
    assert np.abs(cooled - standing).max() > 1.0


def test_at_one_speed_the_channel_is_the_reference_speed() -> None:
    law = {"law": "rotating-cylinder", "factor": 2.0}
    many, speed = {"modes": 60}, np.full(360, 1200.0)
    followed = temperatures(screw(surface=law | {"speed_channel": "n_rpm"}, model=many), speed)
    fixed = temperatures(screw(surface=law | {"speed_rpm": 1200.0}, model=many), speed)
    # of 60 K: 1 mK from a loss taken beside steps of 10 s, the rest from the dropped modes' film at rest
    np.testing.assert_allclose(followed, fixed, atol=5e-3)


def test_turning_described_by_law_and_effect_is_refused() -> None:
    effect = [{"kind": "speed_convection", "gain": 1.0, "speed_channel": "n_rpm"}]
    with pytest.raises(ConfigError, match=r"surface\.law already gives what turning adds"):
        screw(surface={"law": "kendoush", "speed_channel": "n_rpm"}, effect=effect)
