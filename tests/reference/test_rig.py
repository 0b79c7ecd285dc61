"""An outside code's rig, end to end: log → frames → estimates."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np

from observer.config.machine import Config
from observer.files.logs import Log, read_log
from observer.installation import load
from tests.reference.service_path import replay

RIG = Path(__file__).parents[1] / "data" / "rig"


@cache
def rig() -> tuple[Config, Log]:
    config = load(RIG / "config.toml")
    return config, read_log(RIG / "run_c.csv.gz", config.channels)


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
