"""Two hundred machines whose heats wander as the configuration says, in one finite-volume solution."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from observer.config.machine import Config
from observer.estimators.kalman import KalmanEstimator
from observer.files.logs import Log
from observer.frames import EstimateBlock, FloatArray
from observer.model.build import build_plant
from tests.reference.cases import config_of
from tests.reference.service_path import inputs_of
from tests.truth.bar import Bar, Mesh, nut_share, shuttle_m, substep_times
from tests.truth.rod import Heat, simulate

BAR = Bar()
RUNS = 200
PERIOD_S = 2.0
STEPS = 1800
SENSOR_M = (0.05, 0.28, 0.5, 0.72, 0.95)
GRID_M = np.array([0.0, 0.15, 0.4, 0.6, 0.85, 1.0])
NOISE_K = 0.05
WALK_W_SQRT_S = 0.1
INITIAL_SIGMA_W = 5.0
LAW_UNCERTAINTY = 0.2
STROKE_M = (0.2, 0.7)
NUT_SPEED_M_S = 0.2
POSITION_PERIOD_S = 0.1
"""A traverse takes 2.5 s: a driver that polls the position every 0.1 s sees 25 samples of it."""


@dataclass(frozen=True, slots=True)
class Campaign:
    """The truth of every run, heats (K, m, R), field and error (K, g, R); and the estimates of each run."""

    heat_W: FloatArray
    field_degC: FloatArray
    error_um: FloatArray
    estimates: tuple[EstimateBlock, ...]


def campaign_config() -> Config:
    """The screw with a moving nut and two bearings whose laws follow the speed."""
    wander = {
        "speed_channel": "screw_speed_rpm",
        "random_walk_W_sqrt_s": WALK_W_SQRT_S,
        "initial_sigma_W": INITIAL_SIGMA_W,
        "law_uncertainty": LAW_UNCERTAINTY,
    }
    nut = {
        "name": "nut", "shape": "nut", "length_m": 0.08, "stroke_m": [0.16, 0.74],
        "position_channel": "nut_position_m", "torque_Nm": 0.3, "share": 0.5,
    }  # fmt: skip
    left = {"name": "left", "shape": "point", "position_m": 0.0, "heat_W_rpm": 0.006}
    right = {"name": "right", "shape": "point", "position_m": 1.0, "heat_W_rpm": 0.006}
    config = config_of(BAR, [s | wander for s in (nut, left, right)], GRID_M, sensor_m=SENSOR_M)
    settings = {"period_s": PERIOD_S, "field_noise_K_sqrt_s": 0.0}  # this truth does not wander by itself
    return config.model_copy(update={"estimator": config.estimator.model_copy(update=settings)})


def run_campaign(seed: int) -> Campaign:
    """Draw, simulate and estimate every run."""
    rng = np.random.default_rng(seed)
    config = campaign_config()
    plant = build_plant(config)
    time_s = PERIOD_S * np.arange(STEPS + 1)
    speed_rpm = np.where((time_s > 1200.0) & (time_s <= 2400.0), 2000.0, 1500.0)
    (inputs,) = inputs_of(config, plant, _recording(time_s, speed_rpm))

    law_W = inputs.law_W
    deviation_W = _deviations(rng, inputs.law_jump_W)
    heat_W = law_W[1:, :, None] + 0.5 * (deviation_W[1:] + deviation_W[:-1])
    mesh = Mesh(BAR.length_m, 250)
    path_m = shuttle_m(substep_times(time_s, 20), *STROKE_M, NUT_SPEED_M_S)
    heats = [
        Heat(nut_share(mesh, 0.08, path_m), heat_W[:, 0]),
        Heat(np.eye(mesh.cells)[0], heat_W[:, 1], "left"),
        Heat(np.eye(mesh.cells)[-1], heat_W[:, 2], "right"),
    ]
    places = np.concatenate([SENSOR_M, GRID_M])
    start = _smooth_fields(rng, mesh, config.estimator.initial_sigma_K)
    truth = simulate(BAR, mesh, time_s, heats, places, initial_degC=start, runs=RUNS)

    shown = truth.temperature_degC[:, : len(SENSOR_M)]
    shown = shown + NOISE_K * rng.standard_normal(shown.shape)
    estimator = KalmanEstimator(plant, config.estimator)
    blocks = tuple(
        estimator.run(estimator.initial(), inputs._replace(y_degC=np.ascontiguousarray(shown[:, :, r])))[1]
        for r in range(RUNS)
    )
    grid = slice(len(SENSOR_M), None)
    return Campaign(
        law_W[:, :, None] + deviation_W,
        truth.temperature_degC[:, grid],
        truth.error_um(BAR, 20.0)[:, grid],
        blocks,
    )


def _recording(time_s: FloatArray, speed_rpm: FloatArray) -> Log:
    """A recording as the service writes it: a tick every period, the nut's position in between."""
    every = round(PERIOD_S / POSITION_PERIOD_S)
    row_s = POSITION_PERIOD_S * np.arange(every * STEPS + 1)
    row_s[::every] = time_s
    step = np.zeros(len(row_s), np.bool_)
    step[::every] = True
    columns = {f"t{i}_degC": 20.0 + 0.0 * time_s for i in range(1, len(SENSOR_M) + 1)}
    columns |= {"screw_speed_rpm": speed_rpm, "ambient_degC": 20.0 + 0.0 * time_s}
    table = np.full((len(row_s), len(columns) + 1), np.nan)
    table[::every, :-1] = np.column_stack(list(columns.values()))
    table[:, -1] = shuttle_m(row_s, *STROKE_M, NUT_SPEED_M_S)
    return Log(Path("campaign.csv"), row_s, (*columns, "nut_position_m"), table, step, (None,) * len(row_s))


def _deviations(rng: np.random.Generator, law_jump_W: FloatArray) -> FloatArray:
    """Deviations of the heats from their laws at each tick, (K, m, R): start, walk, share of each jump."""
    steps, sources = law_jump_W.shape
    moves = WALK_W_SQRT_S * np.sqrt(PERIOD_S) * rng.standard_normal((steps, sources, RUNS))
    moves += LAW_UNCERTAINTY * law_jump_W[:, :, None] * rng.standard_normal((steps, sources, RUNS))
    moves[0] = INITIAL_SIGMA_W * rng.standard_normal((sources, RUNS))
    return np.cumsum(moves, axis=0)


def _smooth_fields(rng: np.random.Generator, mesh: Mesh, sigma_K: float) -> FloatArray:
    """Fields at the start, (cells, R): an unknown level and a shape smooth over a quarter of the screw."""
    x = mesh.centres_m / mesh.length_m
    shape = np.exp(-0.5 * ((x[:, None] - x) / 0.25) ** 2) + 1e-9 * np.eye(len(x))
    level = rng.standard_normal(RUNS)
    wave = np.linalg.cholesky(shape) @ rng.standard_normal((len(x), RUNS))
    return 20.0 + sigma_K * np.sqrt(0.5) * (level + wave)
