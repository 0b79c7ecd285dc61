"""Numbers that the pages about estimators and discovery and decisions 0009, 0010 give for the shipped rig."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np

from observer import installation
from observer.config import laws
from observer.config.machine import Config
from observer.files.logs import Log, read_log
from tests.reference.service_path import replay

ROOT = Path(__file__).parents[2]
RIG = ROOT / "tests" / "data" / "rig"
# What `observer calibrate` finds in run_c.
CALIBRATED = {"film": 13.89, "torque": 0.3391, "left": 0.00565, "right": 0.00565}


@cache
def rig() -> tuple[Config, Log]:
    settings = installation.load(RIG / "config.toml")
    return settings, read_log(RIG / "run_c.csv.gz", settings.channels)


def _calibrated() -> Config:
    settings, _ = rig()
    nut, left, right = settings.source
    return settings.model_copy(
        update={
            "surface": laws.Surface(convection_W_m2K=CALIBRATED["film"]),
            "source": (
                nut.model_copy(update={"torque_Nm": CALIBRATED["torque"]}),
                left.model_copy(update={"heat_W_rpm": CALIBRATED["left"]}),
                right.model_copy(update={"heat_W_rpm": CALIBRATED["right"]}),
            ),
        }
    )


def test_a_start_on_a_warm_machine_knows_the_ends_within_its_sigmas() -> None:
    _, log = rig()
    begin = int(np.searchsorted(log.time_s, 3060.0))  # a minute after forty minutes at full speed
    warm = replace(log, time_s=log.time_s[begin:][:240], values=log.values[begin:][:240])
    cold = replace(log, time_s=log.time_s[: begin + 240], values=log.values[: begin + 240])
    started, from_the_beginning = replay(_calibrated(), warm), replay(_calibrated(), cold)
    minute, ends = 120, [0, -1]
    off_K = started.field_degC[minute, ends] - from_the_beginning.field_degC[begin + minute, ends]
    assert (np.abs(off_K) < 3 * started.field_sigma_K[minute, ends]).all()
    assert started.field_sigma_K[minute, ends].max() < 0.6, "so wide a band would hold anything"
