"""Numbers that the pages about estimators and discovery and decisions 0009, 0010 give for the shipped rig."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from observer import config, installation
from observer.align.aligner import AlignPlan, frames_of_log
from observer.discovery.candidates import library
from observer.files.logs import Log, read_log
from observer.fit.forward import Forward
from observer.fit.parameters import free_keys
from observer.fit.runs import prepare
from observer.fit.tolerance import tolerances
from observer.frames import EstimateBlock, Quality
from observer.tables import laws
from tests.reference.service_path import replay

ROOT = Path(__file__).parents[2]
RIG = ROOT / "tests" / "data" / "rig"
# What `observer calibrate` finds in run_c.
CALIBRATED = {"film": 13.89, "torque": 0.3391, "left": 0.00565, "right": 0.00565}


@cache
def rig() -> tuple[config.Config, Log]:
    settings = installation.load(RIG / "config.toml")
    return settings, read_log(RIG / "run_c.csv.gz", settings.channels)


def _replayed(field_noise_K_sqrt_s: float) -> EstimateBlock:
    settings, log = rig()
    noise = {"field_noise_K_sqrt_s": field_noise_K_sqrt_s}
    return replay(settings.model_copy(update={"estimator": settings.estimator.model_copy(update=noise)}), log)


@pytest.mark.slow
def test_a_model_taken_for_exact_refuses_good_sensors_and_the_default_does_not() -> None:
    exact, default = (
        np.mean(_replayed(noise).sensor_quality == Quality.REJECTED, axis=0)
        for noise in (0.0, config.EstimatorSettings().field_noise_K_sqrt_s)
    )
    assert np.sort(exact)[-2] > 0.02, (
        "two sensors lose 2 and 6 % of their samples, even as the state is opened"
    )
    assert default.max() < 0.01


def _calibrated() -> config.Config:
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


def test_what_tolerances_move_and_how_many_candidates_there_are() -> None:
    settings, _ = rig()
    plan = AlignPlan.of(settings)
    logs = [read_log(RIG / "end_conduction-0.1" / f"run_{run}.csv.gz", settings.channels) for run in "abc"]
    forward = Forward(settings, [prepare(settings, list(frames_of_log(log, plan)), "") for log in logs])
    here = np.concatenate(forward(settings))
    moved_K = [np.sqrt(np.mean((np.concatenate(forward(c)) - here) ** 2)) for c, _ in tolerances(settings)]
    conductivity, heat, place, *rest = np.round(moved_K, 2).tolist()
    film, offset, (ambient, lag) = rest[:4], rest[4:9], rest[9:]
    assert (conductivity, heat, place, min(film), max(film)) == (0.08, 0.21, 0.15, 0.04, 0.07)
    assert (min(offset), max(offset), ambient, lag) == (0.12, 0.13, 0.43, 0.03)
    candidates = library(settings, free_keys(settings))
    assert len({c.name for c in candidates}) >= 40
    assert sum(len(c.shapes) for c in candidates) > 100
