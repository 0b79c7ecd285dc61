"""A log through the same path as the service's: rows → frames → inputs → estimates, or open loop."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields
from pathlib import Path

import numpy as np

from observer.align.aligner import AlignPlan, frames_of_log
from observer.config.machine import Config
from observer.estimators.kalman import KalmanEstimator
from observer.files.logs import Log
from observer.frames import EstimateBlock, FloatArray, Inputs
from observer.model import simulate
from observer.model.build import build_plant
from observer.model.drive import Drive
from observer.model.plant import Plant


def log_of(time_s: FloatArray, columns: Mapping[str, FloatArray]) -> Log:
    """Columns as the log they would be."""
    return Log(Path("log.csv"), time_s, tuple(columns), np.column_stack(list(columns.values())))


def inputs_of(config: Config, plant: Plant, log: Log) -> list[Inputs]:
    """The inputs of a whole log, block by block."""
    drive = Drive(config, plant)
    state, blocks = drive.initial(), []
    for frames in frames_of_log(log, AlignPlan.of(config)):
        state, inputs = drive.run(state, frames)
        blocks.append(inputs)
    return blocks


def replay(config: Config, log: Log, plant: Plant | None = None) -> EstimateBlock:
    """The Kalman filter's estimates of a whole log."""
    plant = plant or build_plant(config)
    estimator = KalmanEstimator(plant, config.estimator)
    state, blocks = estimator.initial(), []
    for inputs in inputs_of(config, plant, log):
        state, block = estimator.run(state, inputs)
        blocks.append(block)
    return EstimateBlock(
        *(np.concatenate([getattr(b, f.name) for b in blocks]) for f in fields(EstimateBlock))
    )


def open_loop(config: Config, log: Log, start_degC: float) -> tuple[Plant, FloatArray]:
    """The plant and its output rows (K, R) with the heats by their laws, from a uniform start."""
    plant = build_plant(config)
    blocks = inputs_of(config, plant, log)
    state = simulate.start(plant, start_degC, blocks[0].law_W[0])
    rows = []
    for inputs in blocks:
        state, block = simulate.simulate(plant, state, inputs)
        rows.append(block)
    return plant, np.concatenate(rows)
