"""What a configuration states of parameters before a calibration."""

from __future__ import annotations

import numpy as np
import pytest

from observer.fit.calibrate import calibrate
from observer.fit.parameters import FILM, replaced
from observer.fit.prior import PHYSICAL, prior_of, range_of
from tests.logs.machines import machine
from tests.logs.simulated import made_log

SHORT_MIN = 6.0


def test_a_film_that_a_log_hardly_shows_stays_within_its_tolerance() -> None:
    # six minutes with the heater off hardly cool the bar: without a prior the film ends at 0 or 100 W/m²K
    config = machine(calibrate={"free": [FILM, "source.bearing.l.scale"]}, tolerance={"offset_K": 0.3})
    for seed in range(3):
        log = made_log(config, seed, minutes=SHORT_MIN, heater_W=0.0)
        film = calibrate(config, [[log]]).values.get(FILM, 20.0)
        assert abs(film - 20.0) < 2 * config.tolerance.convection * 20.0


def test_the_range_holds_the_configured_value_and_is_physical() -> None:
    config = machine()
    assert range_of(config, FILM) == (2.0, 250.0)
    outside = replaced(config, {FILM: 300.0})
    assert range_of(outside, FILM) == (2.0, 300.0)
    assert range_of(config, "source.heater.scale") == (0.1, 10.0)
    assert all(entry.source and entry.low < entry.high for entry in PHYSICAL.values())


def test_a_tolerance_of_an_earlier_calibration_still_lets_the_machine_change() -> None:
    config = machine(tolerance={"convection": 0.01, "conductivity": 0.02})
    keys = (FILM, "screw.conductivity_W_mK")
    assert prior_of(config, keys).sigma / np.array([20.0, 50.0]) == pytest.approx([0.1, 0.02])


def test_a_parameter_that_is_stated_as_exact_but_free_has_no_prior() -> None:
    config = machine(tolerance={"convection": 0.0})
    assert prior_of(config, (FILM,)).sigma == [np.inf]
