"""Designs of fixed gains for all shipped machines: no warning of a library reaches the user."""

from __future__ import annotations

import warnings
from pathlib import Path

import numpy as np
import pytest

from observer.errors import UserError
from observer.estimators import build_estimator
from observer.estimators.design.gains import accumulated
from observer.estimators.fixed_gain import FixedGainEstimator, GainBank
from observer.installation import load
from observer.model.build import build_plant

SHIPPED = sorted((Path(__file__).parents[2] / "config").glob("*.toml"))
SETTINGS = (
    {"kind": "luenberger"},
    {"kind": "luenberger", "pole_rule": "kim"},
    {"kind": "luenberger", "bandwidth_1_s": 1e-5},
    {"kind": "kalman", "engine": "constant"},
)
SHORTEST_BIN, PERIOD_BIN, LONGEST_BIN = 0, 8, 127


@pytest.mark.parametrize("path", SHIPPED, ids=lambda path: path.stem)
def test_no_design_warns_whatever_sensors_and_step_are_left(path: Path) -> None:
    config = load(path)
    plant = build_plant(config)
    every_sensor = (1 << plant.rows.sensors) - 1
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for settings in SETTINGS:
            try:
                estimator = build_estimator(plant, config.estimator.model_copy(update=settings))
            except UserError:  # a design that the machine cannot have is refused in words
                continue
            assert isinstance(estimator, FixedGainEstimator)
            bank = GainBank(estimator.plant, config.estimator.period_s, estimator.gain)
            for step_bin in (SHORTEST_BIN, PERIOD_BIN, LONGEST_BIN):
                for sensors in {every_sensor, every_sensor - 1, 1}:
                    bank.add((step_bin << plant.rows.sensors) + sensors)
            assert np.isfinite(bank.gains.K).all()


def test_what_accumulates_is_the_sum_over_all_steps() -> None:
    M, Q = np.array([[0.9, 5.0], [0.0, 0.5]]), np.diag([1.0, 2.0])
    Sigma = accumulated(M, Q)
    assert Sigma is not None
    powers = [np.linalg.matrix_power(M, k) for k in range(400)]
    # 0.9^800 is far below rounding, and 400 additions lose less than four digits of sixteen
    np.testing.assert_allclose(Sigma, sum(P @ Q @ P.T for P in powers), rtol=1e-12)


def test_a_sum_that_grows_without_limit_is_not_given() -> None:
    assert accumulated(np.array([[2.0]]), np.array([[1.0]])) is None
