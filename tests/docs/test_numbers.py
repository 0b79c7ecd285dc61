"""Numbers that the pages about the estimators and decision 0009 give for the shipped rig."""

from __future__ import annotations

import re
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from observer import config
from observer.frames import EstimateBlock, Quality
from observer.logs import Log, read_log
from tests.reference.service_path import replay

ROOT = Path(__file__).parents[2]
RIG = ROOT / "tests" / "data" / "rig"
ESTIMATORS = (ROOT / "docs" / "explanation" / "estimators.md").read_text(encoding="utf-8")
# What `observer calibrate` finds in run_c.
CALIBRATED = {"film": 13.73, "torque": 0.3331, "left": 0.00566, "right": 0.00564}


@cache
def rig() -> tuple[config.Config, Log]:
    settings = config.load(RIG / "config.toml")
    return settings, read_log(RIG / "run_c.csv.gz", settings.channels)


def _replayed(field_noise_K_sqrt_s: float) -> EstimateBlock:
    settings, log = rig()
    noise = {"field_noise_K_sqrt_s": field_noise_K_sqrt_s}
    return replay(settings.model_copy(update={"estimator": settings.estimator.model_copy(update=noise)}), log)


def _row(title: str) -> list[str]:
    """The cells of the one line of a table that begins so."""
    (line,) = re.findall(rf"^\| {re.escape(title)} \| (.*) \|$", ESTIMATORS, flags=re.M)
    return [cell.strip() for cell in line.split("|")]


@pytest.mark.slow
def test_how_many_samples_the_gate_refuses() -> None:
    levels = [float(cell) for cell in _row("`field_noise_K_sqrt_s`")]
    for level, cell in zip(levels, _row("`run_c`, the shipped log"), strict=True):
        refused = 100 * np.mean(_replayed(level).sensor_quality == Quality.REJECTED, axis=0)[1:4]
        said = [float(number) for number in re.findall(r"[\d.]+", cell)]
        # the page rounds to a percent, or to a tenth where that says nothing
        np.testing.assert_allclose(refused, said, atol=0.55 if max(said) > 1 else 0.055)


def _calibrated() -> config.Config:
    settings, _ = rig()
    nut, left, right = settings.source
    return settings.model_copy(
        update={
            "surface": config.Surface(convection_W_m2K=CALIBRATED["film"]),
            "source": (
                nut.model_copy(update={"torque_Nm": CALIBRATED["torque"]}),
                left.model_copy(update={"heat_W_rpm": CALIBRATED["left"]}),
                right.model_copy(update={"heat_W_rpm": CALIBRATED["right"]}),
            ),
        }
    )


def test_a_start_on_a_warm_machine_is_within_its_sigmas() -> None:
    settings, log = rig()
    begin = int(np.searchsorted(log.time_s, 2400.0))  # half an hour after the nut began to run
    warm = replace(log, time_s=log.time_s[begin:][:1200], values=log.values[begin:][:1200])
    block = replay(_calibrated(), warm)
    speed_rpm = warm.values[:, warm.channels.index("screw_speed_rpm")]
    law_W = speed_rpm[:, None] * np.array([CALIBRATED["left"], CALIBRATED["right"]])
    off = (block.heat_W[:, 1:] - law_W) / block.heat_sigma_W[:, 1:]
    # two heats that wander a little, over ten minutes: 3.5 σ is not passed by chance
    assert np.abs(off).max() < 3.5
    assert not (block.sensor_quality[:, [0, 4]] == Quality.REJECTED).any()
    ends = block.field_sigma_K[60, [0, -1]]
    assert ends.max() < 1.0, "half a minute is enough to know the ends to a kelvin"
