"""A nut that moves faster than its position is logged: what the model still gets right, and what it says."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np
import pytest

from observer.config.machine import Config
from observer.files.logs import Log
from observer.frames import EstimateBlock, FloatArray, NutPath
from observer.model.build import build_plant
from observer.model.rod import moving
from observer.model.rod.moving import NutTable, judge_path
from tests.reference.cases import config_of
from tests.reference.service_path import log_of, replay
from tests.truth import screw2d
from tests.truth.bar import Bar, Mesh, nut_share, point_share, shuttle_m, substep_times
from tests.truth.rod import Heat
from tests.truth.series import measured

BAR, MESH = Bar(), Mesh(1.0, 125)
SENSOR_M = (0.05, 0.28, 0.5, 0.72, 0.95)
GRID_M = np.array([0.0, 0.1, 0.2, 0.35, 0.5, 0.65, 0.8, 0.9, 1.0])
LOW_M, HIGH_M, NUT_M = 0.2, 0.8, 0.08
NUT_W, BEARING_W = 30.0, 8.0
END_S, PERIOD_S = 3600.0, 1.0
SETTLED_S = 1200.0


@dataclass(frozen=True, slots=True)
class Case:
    """A log of the two-dimensional screw, its configuration and the true field on the grid (K, g)."""

    config: Config
    log: Log
    field_degC: FloatArray


@cache
def case(speed_m_s: float) -> Case:
    """One hour of a nut that shuttles at a speed, logged once a second; its torque is configured 15 % low."""
    step_s = 0.5
    time_s = step_s * np.arange(round(END_S / step_s) + 1)
    count = len(time_s) - 1
    path_m = shuttle_m(substep_times(time_s, 20), LOW_M, HIGH_M, speed_m_s)
    nut = Heat(nut_share(MESH, NUT_M, path_m), np.full(count, NUT_W))
    bearings = [
        Heat(point_share(MESH, x), np.full(count, BEARING_W), end)
        for x, end in ((0.0, "left"), (1.0, "right"))
    ]
    places = np.concatenate([SENSOR_M, GRID_M])
    truth = screw2d.simulate(BAR, MESH, time_s, [nut], bearings, places)

    every = round(PERIOD_S / step_s)
    temperature = truth.temperature_degC[::every, :, 0]
    rng = np.random.default_rng(7)
    columns = {
        f"t{i}_degC": measured(temperature[:, i - 1], 0.05, rng, 0.01) for i in range(1, len(SENSOR_M) + 1)
    }
    columns["nut_position_m"] = shuttle_m(time_s[::every], LOW_M, HIGH_M, speed_m_s)
    columns["screw_speed_rpm"] = np.full(len(temperature), 1500.0)
    return Case(_config(), log_of(time_s[::every], columns), temperature[:, len(SENSOR_M) :])


def _config() -> Config:
    speed = {"speed_channel": "screw_speed_rpm", "random_walk_W_sqrt_s": 0.1}
    nut = {
        "name": "nut", "shape": "nut", "length_m": NUT_M, "stroke_m": [LOW_M, HIGH_M],
        "position_channel": "nut_position_m", "heat_W_rpm": 0.85 * NUT_W / 1500.0,
    }  # fmt: skip
    ends = [
        {"name": n, "shape": "point", "position_m": x, "heat_W_rpm": BEARING_W / 1500.0}
        for n, x in (("left", 0.0), ("right", 1.0))
    ]
    config = config_of(BAR, [s | speed for s in (nut, *ends)], GRID_M, sensor_m=SENSOR_M)
    fixed = config.ambient.model_copy(update={"channel": None, "temperature_degC": 20.0})
    return config.model_copy(update={"ambient": fixed})


def estimated(this: Case) -> tuple[EstimateBlock, FloatArray]:
    """The estimates, and which rows are settled."""
    block = replay(this.config, this.log)
    return block, block.time_s >= SETTLED_S


# A traverse takes 1.4 s, less than two samples; 5.5 s, whose path has to be folded; twelve.
@pytest.mark.parametrize(("speed_m_s", "regime"), [(0.4171, "points"), (0.1097, "path"), (0.05, "path")])
def test_heat_and_field_are_right_where_the_log_shows_the_path(speed_m_s: float, regime: str) -> None:
    this = case(speed_m_s)
    position_m = this.log.values[:, this.log.channels.index("nut_position_m")]
    assert judge_path(position_m, HIGH_M - LOW_M) == regime
    block, late = estimated(this)
    heat_W = block.heat_W[late]
    off_K = block.field_degC[late] - this.field_degC[late]
    # what each pass of the nut adds and the log cannot place in time: its heat spread over the stroke
    ripple_K = NUT_W / speed_m_s / BAR.capacity_J_mK if regime == "points" else 0.0
    sigma_K = np.hypot(block.field_sigma_K[late], ripple_K)
    inside = np.mean(np.abs(off_K) <= 1.96 * sigma_K)
    heat_inside = np.mean(np.abs(heat_W - [NUT_W, BEARING_W, BEARING_W]) <= 1.96 * block.heat_sigma_W[late])
    print(
        f"{regime}: heats {heat_W.mean(axis=0).round(2)} W, {heat_inside:.1%} inside; "
        f"field {np.sqrt(np.mean(off_K**2)):.3f} K rms, {inside:.1%} inside"
    )
    assert heat_W.mean(axis=0)[0] == pytest.approx(NUT_W, rel=0.02)
    assert heat_W.mean(axis=0)[1:] == pytest.approx(BEARING_W, rel=0.05)
    assert heat_inside >= 0.95
    assert np.sqrt(np.mean(off_K**2)) < 0.08
    # away from the ends σ is a few mK, as small as what rod and rings differ by: see the section's mean in
    # tests/truth/test_screw2d.py
    assert inside >= 0.75


def test_a_log_in_step_with_the_motion_is_known_not_to_show_the_path() -> None:
    """0.4 m/s, 0.6 m, 1 Hz: three positions are ever seen."""
    position_m = shuttle_m(np.arange(3600.0), LOW_M, HIGH_M, 0.4)
    assert len(np.unique(position_m.round(6))) <= 4
    assert judge_path(position_m, HIGH_M - LOW_M) == "undetermined"


@pytest.mark.parametrize("samples_per_traverse", [3.3, 4.7, 7.1, 9.66, 10.3])
def test_a_path_known_by_few_samples_heats_where_the_nut_was(samples_per_traverse: float) -> None:
    """Lines between the samples cut the reversals off; folding the path at what is missing does not."""
    table = build_plant(_config()).moving[0].table
    speed_m_s = (HIGH_M - LOW_M) / (samples_per_traverse * PERIOD_S)
    seen_s, true_s = np.arange(0.0, 600.5, PERIOD_S), np.arange(0.0, 600.01, 0.01)
    seen_m = shuttle_m(seen_s, LOW_M, HIGH_M, speed_m_s)
    truth = _heated(table, true_s, shuttle_m(true_s, LOW_M, HIGH_M, speed_m_s))
    folded = _heated(table, seen_s, seen_m)
    lines = _heated(table, true_s, np.interp(true_s, seen_s, seen_m))
    off, cut = (float(np.linalg.norm(B - truth) / np.linalg.norm(truth)) for B in (folded, lines))
    print(f"{samples_per_traverse} samples a traverse: folded off by {off:.2%}, lines by {cut:.2%}")
    assert cut > 0.01
    assert off < 0.15 * cut


def _heated(table: NutTable, time_s: FloatArray, position_m: FloatArray) -> FloatArray:
    """The nut's input column over a path, averaged over all but its first minute."""
    path = NutPath(time_s, position_m, np.arange(len(time_s) + 1), *np.full((2, len(time_s)), np.nan))
    dt_s = np.diff(time_s, prepend=time_s[0])
    _, B, _ = moving.columns(table, moving.start(table), dt_s, path)
    return np.asarray(B[time_s > 60.0].mean(axis=0))
