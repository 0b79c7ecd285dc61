"""An outside code's rig, end to end: log → frames → estimates, and open loop after fitting what is free."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np

from observer.config import Config
from observer.files.logs import Log, read_log
from observer.frames import FloatArray
from observer.installation import load
from tests.reference.service_path import open_loop, replay

RIG = Path(__file__).parents[1] / "data" / "rig"
WINDOW = 60
"""Rows of a 30 s mean at 2 Hz."""


@cache
def rig() -> tuple[Config, Log]:
    config = load(RIG / "config.toml")
    return config, read_log(RIG / "run_c.csv.gz", config.channels)


def with_parameters(config: Config, factor: FloatArray) -> Config:
    """The configuration with film, torque and both bearings' heats times a factor each."""
    film, torque, left, right = factor
    nut, first, second = config.source
    surface = config.surface.model_copy(update={"convection_W_m2K": film * config.surface.convection_W_m2K})
    sources = (
        nut.model_copy(update={"scale": float(torque)}),
        first.model_copy(update={"scale": float(left)}),
        second.model_copy(update={"scale": float(right)}),
    )
    return config.model_copy(update={"surface": surface, "source": sources})


def residual_K(config: Config, log: Log) -> FloatArray:
    """30 s means of measured minus predicted, (windows, sensors)."""
    sensors = [log.channels.index(s.channel) for s in config.sensor]
    measured = log.values[:, sensors]
    _, rows = open_loop(config, log, start_degC=float(measured[:WINDOW].mean()))
    off = measured - rows[:, : len(sensors)]
    whole = len(off) // WINDOW * WINDOW
    return np.asarray(off[:whole].reshape(-1, WINDOW, len(sensors)).mean(axis=1))


def rms(values: FloatArray) -> float:
    return float(np.sqrt(np.mean(values**2)))


def test_the_free_parameters_close_the_open_loop_gap() -> None:
    config, log = rig()
    factor = np.ones(4)
    before = residual_K(config, log)
    for _ in range(4):  # Gauss–Newton: nearly linear in all four
        base = residual_K(with_parameters(config, factor), log).ravel()
        columns = [
            (residual_K(with_parameters(config, factor + 0.01 * unit), log).ravel() - base) / 0.01
            for unit in np.eye(4)
        ]
        factor = factor - np.linalg.lstsq(np.column_stack(columns), base, rcond=None)[0]
    after = residual_K(with_parameters(config, factor), log)
    print(f"open loop {rms(before):.2f} K → {rms(after):.3f} K rms; factors {factor.round(3)}")
    # Noise leaves 0.05/√60 = 0.007 K of a 30 s mean; the rest is what the rig hides on purpose: k and ρc are
    # off by some percent and not free, the film is uneven. With the right four 0.09 K is left.
    assert rms(after) < 0.10
    assert rms(after) < 0.2 * rms(before)
    assert (np.abs(factor - 1.0) < 0.25).all()  # configured 1–15 % off


def test_the_estimates_of_the_rig_stay_with_its_sensors() -> None:
    config, log = rig()
    # k and ρc are off by some percent: a filter that takes its model for exact ends up refusing good sensors
    inexact = config.estimator.model_copy(update={"field_noise_K_sqrt_s": 0.002})
    block = replay(config.model_copy(update={"estimator": inexact}), log)
    running = block.time_s > 900.0
    innovation_K = block.innovation_K[running]
    # noise 0.05 K, steps of 0.01 K, a little for the prediction; heats absorb what the model does not know
    assert np.nanstd(innovation_K) < 0.06
    assert np.mean(block.sensor_quality[running] == 0) > 0.99
    speed_rpm = log.values[:, log.channels.index("screw_speed_rpm")]
    heat_W = block.heat_W.sum(axis=1)
    at_rest_W, fast_W = heat_W[-1800:].mean(), heat_W[(speed_rpm > 2000.0) & running].mean()
    assert abs(at_rest_W) < 0.05 * fast_W
