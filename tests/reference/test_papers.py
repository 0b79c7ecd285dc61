"""The modal screw, its supports and the estimator against the closed forms of Kuznetsov and Yu."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from observer.config.machine import Config
from observer.estimators import build_estimator
from observer.frames import FloatArray
from observer.model.build import build_plant
from observer.model.drive import Drive
from observer.model.plant import Plant
from tests.logs.simulated import frames
from tests.reference.cases import config_of, known, play, point
from tests.truth import kuznetsov, yu
from tests.truth.bar import Bar, End

BAR = Bar(length_m=0.6, diameter_m=0.03, convection_W_m2K=12.0)
GRID_M = np.array([0.0, 0.01, 0.05, 0.2, 0.33, 0.5, 0.6])
BOTH = [point("left", 0.0), point("right", BAR.length_m)]
MANY = {"modes": 400}


def two_heats(heats_W: tuple[float, float], time_s: FloatArray, **tables: object) -> tuple[FloatArray, Plant]:
    """Rows of the modal screw under two end heats from the start, in cold air at 0 °C."""
    output = {"positions_m": GRID_M.tolist(), "reference_degC": 0.0}
    plant = build_plant(config_of(BAR, BOTH, GRID_M, **({"model": MANY, "output": output} | tables)))
    z = known(plant, len(time_s), ambient=0.0, reference=0.0)
    return play(plant, time_s, np.tile(heats_W, (len(time_s) - 1, 1)), z, 0.0), plant


@pytest.mark.parametrize("later_s", [5.0, 60.0, 900.0, 20_000.0])
def test_kuznetsovs_series_and_the_modal_rod_agree(later_s: float) -> None:
    """Field and growth, right beside the heats too. What is left is the truncation at 400 modes: nothing."""
    rows, plant = two_heats((6.0, 9.0), np.array([0.0, later_s]))
    series = kuznetsov.field(BAR, 6.0, 9.0, GRID_M, later_s)
    np.testing.assert_allclose(rows[-1, plant.rows.field_slice], series, rtol=0, atol=1e-6 * series.max())
    grown_um = 1e6 * BAR.expansion_1_K * kuznetsov.growth(BAR, 6.0, 9.0, GRID_M, later_s)
    np.testing.assert_allclose(rows[-1, plant.rows.error_slice], grown_um, rtol=0, atol=1e-6 * grown_um.max())


LONG = replace(BAR, length_m=2.0)
NEAR_M = np.array([0.0, 0.02, 0.05, 0.1, 0.25])


def long_screw(model: dict[str, int], bar: Bar = LONG) -> Plant:
    ends = (End("prescribed"), End())
    return build_plant(config_of(bar, [point("idle", 1.0)], NEAR_M, ends=ends, model=model))


def test_a_face_that_jumps_warms_a_long_screw_as_yus_step_with_a_film() -> None:
    plant = long_screw(MANY)
    z = known(plant, 2, ambient=0.0, left=10.0, reference=0.0)
    z[0] = z[1]  # the jump stands from the first step on
    rows = play(plant, np.array([0.0, 900.0]), np.zeros((1, 1)), z, 0.0)
    wanted = yu.step_with_film(LONG, 10.0, NEAR_M, 900.0)
    np.testing.assert_allclose(rows[-1, plant.rows.field_slice], wanted, rtol=0, atol=1e-6)


def test_a_face_that_swings_is_felt_with_yus_amplitudes_and_lags() -> None:
    bare = replace(LONG, convection_W_m2K=0.0)
    plant = long_screw({"modes": 200}, bare)
    period_s, harmonics = 1800.0, [(5.0, 0.4), (2.0, -1.0)]
    omega = 2.0 * math.pi / period_s
    time_s = np.arange(0.0, 12 * period_s + 1.0, 6.0)
    face = yu.periodic(bare, harmonics, omega, 0.0, time_s)
    z = known(plant, len(time_s), ambient=0.0, left=face, reference=0.0)
    rows = play(plant, time_s, np.zeros((len(time_s) - 1, 1)), z, 0.0)[:, plant.rows.field_slice]
    last = time_s >= 11 * period_s
    for i, x_m in enumerate(NEAR_M):
        wanted = yu.periodic(bare, harmonics, omega, float(x_m), time_s[last])
        # the start-up fades as t^(-1/2) for what the mean of the first swings has left; lines of 6 s cut
        # the swing's crests by (ω 6 s)²/8 of 5 K
        np.testing.assert_allclose(rows[last, i], wanted, rtol=0, atol=0.05)


def test_the_estimator_finds_kuznetsovs_two_heats() -> None:
    """Temperatures by the series, from sensors off the ends, and nothing known of the heats."""
    places = [0.03, 0.3, 0.57]
    blind = [{"name": s["name"], "shape": "point", "position_m": s["position_m"]} for s in BOTH]
    config: Config = config_of(BAR, blind, GRID_M, sensor_m=places, ambient={"temperature_degC": 0.0})
    time_s = np.arange(0.0, 3600.0, 2.0)
    true_W = {"left": 6.0, "right": 9.0}
    begin_s = 200.0
    measured = np.zeros((len(time_s), 3))
    for k in np.flatnonzero(time_s > begin_s):
        measured[k] = kuznetsov.field(BAR, *true_W.values(), np.array(places), time_s[k] - begin_s, images=6)
    columns = {s.channel: measured[:, i] for i, s in enumerate(config.sensor)}
    plant = build_plant(config)
    drive, estimator = Drive(config, plant), build_estimator(plant, config.estimator)
    _, inputs = drive.run(drive.initial(), frames(config, time_s, columns))
    _, block = estimator.run(estimator.initial(), inputs)
    late = time_s > 2400.0
    for j, name in enumerate(true_W):
        off_W = block.heat_W[late, j] - true_W[name]
        assert np.abs(off_W).max() < 0.05 * true_W[name]
        assert (np.abs(off_W) < 2.0 * block.heat_sigma_W[late, j]).all()
    series = kuznetsov.field(BAR, 6.0, 9.0, GRID_M, time_s[-1] - begin_s)
    np.testing.assert_allclose(block.field_degC[-1], series, rtol=0, atol=0.05)
