"""A day of samples: constant-gain replay beside filterpy's, and reading the log."""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from dataclasses import fields
from pathlib import Path

import numpy as np
from filterpy.kalman import KalmanFilter
from pyarrow import csv

from benchmarks.kalman_step import filterpy_loop
from benchmarks.plants import dense
from benchmarks.table import Result, judged
from benchmarks.timing import medians_s, shown
from observer.estimators.fixed_gain import ConstantGainEstimator
from observer.estimators.kalman import KalmanEstimator
from observer.files.logs import read_log
from observer.files.writer import write_log
from observer.frames import FloatArray
from observer.model.build import build_plant
from observer.model.plant import Plant
from tests.logs.inputs import even_inputs
from tests.logs.machines import config_of

DAY = 172_800
PEER_STEPS = 5_000


def results() -> list[Result]:
    """24 h at 2 Hz: 8 modes and 3 heats, 4 sensors."""
    config = config_of(8, 4, grid=2, engine="constant")
    plant = build_plant(config)
    inputs = even_inputs(plant, DAY)
    constant = ConstantGainEstimator(plant, config.estimator)
    varying = KalmanEstimator(plant, config.estimator)
    estimates = constant.run(constant.initial(), inputs)[1]
    passed = [*inputs, *(getattr(estimates, f.name) for f in fields(estimates))]
    bytes_a_sample = sum(column.nbytes for column in passed) / DAY
    works = {
        "constant": lambda: constant.run(constant.initial(), inputs),
        "varying": lambda: varying.run(varying.initial(), inputs),
        "filterpy": filterpy_loop(plant, inputs.y_degC[:PEER_STEPS]),
        "steady": steady_filterpy(plant, inputs.y_degC[:PEER_STEPS]),
        "copy": lambda: [column.copy() for column in passed],
    }
    taken = medians_s(works, repetitions=5)
    peer_s, steady_s = (taken[name] / PEER_STEPS * DAY for name in ("filterpy", "steady"))
    rate = DAY / taken["constant"]
    return [
        Result(
            "constant-gain replay, 172,800 samples",
            shown(taken["constant"]),
            f"filterpy {shown(peer_s)}",
            f"{peer_s / taken['constant']:.3g} ×",
            goal="≤ 0.4 s",
            met=taken["constant"] <= 0.4,
        ),
        Result(
            f"  its {bytes_a_sample:.0f} bytes a sample, in and out",
            f"{rate * bytes_a_sample / 1e9:.2g} GB/s",
            f"copying them {DAY * bytes_a_sample / taken['copy'] / 1e9:.2g} GB/s",
        ),
        Result(
            "  filterpy with its gain held, no σ, no field",
            shown(taken["constant"]),
            f"filterpy steady-state {shown(steady_s)}",
            f"{steady_s / taken['constant']:.3g} ×",
        ),
        Result(
            "  time-varying Kalman", shown(taken["varying"]), ratio=f"{DAY / taken['varying'] / 1e6:.3g} M/s"
        ),
        *log_reading(),
    ]


def steady_filterpy(plant: Plant, y: FloatArray) -> Callable[[], object]:
    """filterpy with the gain held, its own fast path."""
    Ad, Qd, H = dense(plant, 0.5)
    kf = KalmanFilter(dim_x=len(Ad), dim_z=len(H))
    kf.F, kf.Q, kf.H, kf.R = Ad, Qd, H, np.diag(plant.noise_R_K2)
    for row in y[:200]:
        kf.predict()
        kf.update(row[:, None])

    def work() -> object:
        for row in y:
            kf.predict_steadystate()
            kf.update_steadystate(row[:, None])
        return kf.x

    return work


def log_reading() -> list[Result]:
    """The same file by us and by pyarrow's own reader."""
    rng = np.random.default_rng(1)
    columns = {f"t{i}_degC": np.round(20.0 + rng.standard_normal(DAY), 2) for i in range(1, 6)}
    columns |= {"nut_position_m": np.round(rng.random(DAY), 4), "screw_speed_rpm": np.full(DAY, 1500.0)}
    with tempfile.TemporaryDirectory() as directory:
        path = Path(directory) / "day.csv"
        write_log(path, 0.5 * np.arange(DAY, dtype=float), columns)
        taken = medians_s({"ours": lambda: read_log(path), "pyarrow": lambda: csv.read_csv(path)})
    ratio = taken["ours"] / taken["pyarrow"]
    peer = f"pyarrow {shown(taken['pyarrow'])}"
    return [judged("reading its log, 8 columns, CSV", shown(taken["ours"]), peer, ratio, at_most=3)]
