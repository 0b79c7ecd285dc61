"""A displacement sensor reads the thermal error at its place, in the unit of its channel."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from observer.align.aligner import Aligner, AlignPlan, frames_of_log
from observer.config.machine import Config
from observer.errors import UserError
from observer.estimate.open_loop import OpenLoop
from observer.estimate.pipeline import MachineModel
from observer.estimate.replay import simulated_columns
from observer.files.logs import Log
from observer.frames import EstimateQuality, FloatArray, Quality, Reading, contiguous
from observer.model.build import build_plant
from observer.model.drive import Drive
from observer.report.sensitivity import detectable, tolerances
from tests.logs.machines import machine, table
from tests.truth.bar import Bar
from tests.truth.kuznetsov import growth

PROBE_M = 0.3
HELD = {"mounting": "L-III", "stiffness_first_N_m": 1e8, "stiffness_second_N_m": 2e8}


def probed(channel: str = "probe_um", sensor: dict[str, Any] | None = None, **changes: Any) -> Config:
    """The small bar with a probe at a place of the grid."""
    base = table(**changes)
    probe = {"name": "probe", "kind": "displacement", "channel": channel, "position_m": PROBE_M}
    screw = {**base["screw"], "expansion_1_K": 11.8e-6}
    return machine(**changes | {"screw": screw, "sensor": [*base["sensor"], probe | (sensor or {})]})


def log_of(config: Config, rows: int = 400, heater_W: float = 25.0) -> Log:
    """A log in which the heater goes on, and no sensor has a value yet."""
    time_s = 5.0 * np.arange(rows)
    known = {"heater_W": np.where(time_s > 200.0, heater_W, 0.0), "n_rpm": np.zeros(rows)}
    values = [known.get(name, np.full(rows, np.nan)) for name in config.channels]
    cells: FloatArray = np.column_stack(values)
    return Log(Path("probed.csv"), contiguous(time_s), config.channels, cells)


def simulated(config: Config, log: Log) -> dict[str, np.ndarray]:
    """What the model says of a log."""
    plant = build_plant(config)
    drive = Drive(config, plant)
    loop = OpenLoop(plant, drive, 20.0)
    (frames,) = frames_of_log(log, AlignPlan.of(config))
    found = loop.run(frames)
    assert found is not None
    inputs, rows = found
    return simulated_columns(config, plant, log, inputs.time_s, inputs.law_W, rows)


@pytest.mark.parametrize(
    "supports", [None, HELD, HELD | {"first": "right"}, HELD | {"preload_N": 300.0, "gap_m": 5e-6}]
)
@pytest.mark.parametrize(("channel", "metres"), [("probe_um", 1e-6), ("x_mm", 1e-3), ("laser_m", 1.0)])
def test_it_is_the_error_there(supports: dict[str, Any] | None, channel: str, metres: float) -> None:
    more = {} if supports is None else {"supports": supports}
    config = probed(channel, output={"positions_m": [0.0, PROBE_M, 0.4], "reference_degC": 20.0}, **more)
    found = simulated(config, log_of(config))
    error_um = found["error_300_um"]
    assert np.abs(error_um).max() > 5.0
    np.testing.assert_allclose(found[channel] * metres * 1e6, error_um, rtol=1e-6, atol=1e-9)


def test_it_grows_as_the_image_series_says() -> None:
    """Against the closed form of a rod heated at its left end."""
    bar = Bar(length_m=0.4, diameter_m=0.02, convection_W_m2K=20.0)
    source = {"name": "heater", "shape": "point", "position_m": 0.0, "power_channel": "heater_W"}
    config = probed(source=[source])
    log = log_of(config)
    found = simulated(config, log)["probe_um"]
    on_s = 202.5  # between two rows
    for k in (100, 399):
        true_um = 11.8 * growth(bar, 25.0, 0.0, np.array([PROBE_M]), log.time_s[k] - on_s)[0]
        assert found[k] == pytest.approx(true_um, rel=0.005)


def estimated(config: Config, log: Log) -> Any:
    pipeline = MachineModel.of(config, learns=True).pipeline()
    pipeline.gap = None
    (frames,) = frames_of_log(log, AlignPlan.of(config))
    return pipeline.step(frames)


def with_readings(config: Config, log: Log, every: int, more_K: float = 0.0) -> Log:
    """The log with what thermocouples say, and the probe every so many rows."""
    found, rng = simulated(config, log), np.random.default_rng(4)
    values = log.values.copy()
    for sensor in config.sensor:
        j = log.channels.index(sensor.channel)
        noise = 0.05 if sensor.kind == "temperature" else 0.3
        values[:, j] = found[sensor.channel] + noise * rng.standard_normal(len(values))
        if sensor.kind == "displacement":
            values[np.arange(len(values)) % every != every - 1, j] = np.nan
        else:
            values[300:, j] += more_K
    return replace(log, values=values)


OCCASIONAL = {"occasional": True, "noise_um": 0.3, "zero_um": 0.2}


def test_between_probings_nothing_is_missing() -> None:
    config = probed(sensor=OCCASIONAL)
    block = estimated(config, with_readings(config, log_of(config), 100))
    assert np.flatnonzero(np.isfinite(block.innovation_K[:, 3])).tolist() == [99, 199, 299, 399]
    assert (block.sensor_quality[:99, 3] == Quality.MISSING).all(), "it has never been read yet"
    assert (block.sensor_quality[99:, 3] == Quality.GOOD).all()
    assert (block.quality[100:] == EstimateQuality.GOOD).all()
    # in µm, as its standard deviation
    assert np.nanmax(np.abs(block.innovation_K[:, 3])) < 5.0
    assert 0.3 < np.nanmin(block.innovation_sigma_K[:, 3]) < 5.0


def test_check_takes_a_probing_for_one_an_hour() -> None:
    """It is worth something, and less than a reading with each step; its own faults are not reckoned with."""
    configs = [probed(), probed(sensor=OCCASIONAL), probed(sensor=OCCASIONAL | {"occasional": False})]
    without = configs[0].model_copy(update={"sensor": configs[0].sensor[:-1]})
    sigma_um = [tolerances(c)["tolerances"][0]["error_sigma_um"] for c in (without, *configs[1:])]
    assert sigma_um[0] > 1.05 * sigma_um[1]
    assert sigma_um[1] > 1.05 * sigma_um[2]
    assert "probe" not in detectable(configs[1])["minimal_detectable"]


def test_a_value_that_is_held_between_probings_counts_once() -> None:
    """As where a log or a register keeps the last result until the next."""
    config = probed(sensor=OCCASIONAL)
    log = with_readings(config, log_of(config), 100)
    held, j = replace(log, values=log.values.copy()), log.channels.index("probe_um")
    for row in range(100, len(held)):
        held.values[row, j] = log.values[(row + 1) // 100 * 100 - 1, j]
    one, other = (estimated(config, each) for each in (log, held))
    np.testing.assert_array_equal(one.error_sigma_um[99:], other.error_sigma_um[99:])


def test_live_an_occasional_channel_says_only_what_is_new() -> None:
    config = probed(sensor=OCCASIONAL)
    aligner = Aligner(AlignPlan.of(config))
    other = {"t1_degC": 20.0}
    assert not aligner.news_of(Reading(1.0, {"probe_um": math.nan}, {"probe_um": "silent"}))
    assert not aligner.news_of(Reading(1.0, {"probe_um": math.nan}))
    first = Reading(1.0, other | {"probe_um": 3.5})
    assert aligner.news_of(first) == [first]
    aligner.ingest(first)
    aligner.tick(5.0)
    (held,) = aligner.news_of(Reading(6.0, other | {"probe_um": 3.5}))
    assert held is not None
    assert held.values == other
    broken = Reading(7.0, {"probe_um": math.nan}, {"probe_um": "open_circuit"})
    assert aligner.news_of(broken) == [broken]
    changed = Reading(8.0, {"probe_um": 3.6})
    assert aligner.news_of(changed) == [changed]


def test_a_sensor_that_should_come_always_is_missing() -> None:
    config = probed(sensor=OCCASIONAL | {"occasional": False})
    log = with_readings(config, log_of(config), 100)
    log.values[:90, log.channels.index("probe_um")] = 0.0
    block = estimated(config, log)
    assert (block.sensor_quality[120:190, 3] == Quality.MISSING).all()


def test_a_probing_corrects_the_error() -> None:
    """All thermocouples read 1 K too much from the start on: only a probe can know."""
    config = probed(sensor=OCCASIONAL)
    log = with_readings(config, log_of(config, 800, 0.0), 100)
    log.values[:, :3] += 1.0
    deaf = replace(log, values=log.values.copy())
    deaf.values[:, log.channels.index("probe_um")] = np.nan
    config = config.model_copy(update={"tolerance": config.tolerance.model_copy(update={"offset_K": 1.0})})
    found = [estimated(config, one) for one in (deaf, log)]
    there = 15  # of the grid, where the probe is
    assert found[0].error_um[-1, there] > 3.0
    assert abs(found[1].error_um[-1, there]) <= 3.0 * OCCASIONAL["zero_um"]
    assert found[1].error_sigma_um[-1, there] < 0.5 * found[0].error_sigma_um[-1, there]


@pytest.mark.parametrize(
    ("sensor", "more", "said"),
    [
        ({"channel": "probe"}, {}, "is to end in its unit"),
        ({"noise_K": 0.2}, {}, "noise_K has no meaning"),
        ({"offset_K": 0.1}, {}, "offset_K has no meaning"),
        ({}, {"screw": table()["screw"]}, "needs the screw's expansion"),
        ({}, {"estimator": {"kind": "luenberger"}}, "needs estimator.kind"),
    ],
)
def test_what_does_not_fit_is_said(sensor: dict[str, Any], more: dict[str, Any], said: str) -> None:
    probe = {"name": "probe", "kind": "displacement", "channel": "probe_um", "position_m": 0.3} | sensor
    base = table(**more)
    screw = more.get("screw", {**base["screw"], "expansion_1_K": 11.8e-6})
    with pytest.raises(UserError, match=said):
        machine(**more | {"screw": screw, "sensor": [*base["sensor"], probe]})


def test_keys_of_a_displacement_are_no_thermocouples() -> None:
    base = table()["sensor"]
    with pytest.raises(UserError, match="occasional has no meaning"):
        machine(sensor=[base[0] | {"occasional": True}])


def test_no_thermocouple_no_start() -> None:
    probe = {"name": "probe", "kind": "displacement", "channel": "probe_um", "position_m": 0.3}
    with pytest.raises(UserError, match="no sensor measures a temperature"):
        machine(screw={**table()["screw"], "expansion_1_K": 1e-5}, sensor=[probe])


def test_play_is_refused_where_it_bends_what_is_estimated() -> None:
    config = probed(supports=HELD | {"gap_m": 5e-6, "preload_N": 10.0})
    with pytest.raises(UserError, match="bends where the play closes"):
        MachineModel.of(config, learns=True).pipeline()
