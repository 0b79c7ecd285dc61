"""From a sample to a subscriber in another process, at 100 Hz, in turn with a bare put of the same bytes."""

from __future__ import annotations

import itertools
import json
import os
import statistics
import subprocess
import sys
import time
from collections.abc import Callable

import numpy as np
import zenoh

from benchmarks.table import Result, judged
from benchmarks.timing import shown
from observer.align.aligner import Aligner, AlignPlan
from observer.bus.codec import EstimateEncoder
from observer.bus.session import session_config
from observer.config.machine import Config
from observer.estimate.pipeline import Pipeline
from observer.estimators.kalman import KalmanEstimator
from observer.frames import EstimateBlock, Reading
from observer.model.build import build_plant
from observer.model.drive import Drive
from tests.bus.router import free_port
from tests.logs.machines import config_of

PREFIX = "ballscrew/benchmark/x"
PERIOD_S = 0.01
SENSORS = 4
RUNS, MESSAGES = 5, 400
"""Messages of each kind in a run; the first ones after a subscriber's declaration may be lost."""
WARM_UP = 20


def results() -> list[Result]:
    """8 modes and 3 heats, 4 sensors, 200 points: p50 and p99, median of the runs."""
    p50: dict[str, list[float]] = {"estimate": [], "bare": []}
    p99: dict[str, list[float]] = {"estimate": [], "bare": []}
    for _ in range(3 * RUNS):
        if len(p50["bare"]) == RUNS:
            break
        for kind, latency_s in one_run().items():
            p50[kind].append(float(np.quantile(latency_s, 0.5)))
            p99[kind].append(float(np.quantile(latency_s, 0.99)))
    rows = []
    for name, taken, bound in (("p50", p50, 1.5), ("p99", p99, 2.0)):
        ours, bare = (statistics.median(taken[kind]) for kind in ("estimate", "bare"))
        ratio = statistics.median(a / b for a, b in zip(taken["estimate"], taken["bare"], strict=True))
        work = f"sample in → estimate at a subscriber, 100 Hz, {name}"
        rows.append(judged(work, shown(ours), f"bare put {shown(bare)}", ratio, at_most=bound))
    return rows


def one_run() -> dict[str, list[float]]:
    """Latencies in seconds of both kinds, sent in turn in one stream; none where a message was dropped."""
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    command = [sys.executable, "-m", "benchmarks.subscriber", endpoint, PREFIX]
    with zenoh.open(session_config("router", (), (endpoint,))) as session:
        process = subprocess.Popen(command, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, text=True)
        try:
            assert process.stdout is not None
            process.stdout.readline()
            time.sleep(0.5)
            sent = _send(session)
            end = session.declare_publisher(f"{PREFIX}/end")
            end.put(b"")
            arrivals = json.loads(process.communicate(timeout=30)[0])
        finally:
            process.kill()
    if any(len(arrivals[kind]) != len(sent[kind]) for kind in sent):
        return {}
    return {
        kind: [(b - a) * 1e-9 for a, b in zip(sent[kind][WARM_UP:], arrivals[kind][WARM_UP:], strict=True)]
        for kind in sent
    }


def _send(session: zenoh.Session) -> dict[str, list[int]]:
    """Send both kinds in turn at 100 Hz each; returns when each sample was in, in monotonic ns."""
    drop = zenoh.CongestionControl.DROP
    publishers = {
        kind: session.declare_publisher(f"{PREFIX}/{kind}", congestion_control=drop, express=True)
        for kind in ("estimate", "bare")
    }
    (estimate, settle), readings = _path(), _readings(2 * MESSAGES)
    payload = b""
    sent: dict[str, list[int]] = {kind: [] for kind in publishers}
    due_s = time.monotonic()
    for i in range(2 * MESSAGES):
        kind = ("estimate", "bare")[i % 2]
        due_s += PERIOD_S / 2.0
        time.sleep(max(0.0, due_s - time.monotonic()))
        sent[kind].append(time.monotonic_ns())
        if kind == "estimate":
            payload = estimate(readings[i])
        publishers[kind].put(payload)
        if kind == "estimate":
            os.sched_yield()  # as the publisher does
            settle()
    return sent


def _readings(count: int) -> list[Reading]:
    """What the drivers deliver, made beforehand."""
    rng = np.random.default_rng(2)
    return [
        Reading(
            PERIOD_S * i,
            {f"t{n}_degC": float(t) for n, t in enumerate(20.0 + 0.1 * rng.standard_normal(SENSORS), 1)}
            | {"nut_position_m": float(0.5 + 0.2 * np.sin(0.01 * i)), "screw_speed_rpm": 1500.0},
        )
        for i in range(count)
    ]


def _path() -> tuple[Callable[[Reading], bytes], Callable[[], object]]:
    """What the service does with a sample, from aligning to encoding; and what it does once that is sent."""
    config = axis_config()
    plant = build_plant(config)
    aligner = Aligner(AlignPlan.of(config))
    pipeline = Pipeline(Drive(config, plant), KalmanEstimator(plant, config.estimator))
    encoder = EstimateEncoder(plant.layout, "ab12cd34")
    sequence = itertools.count()

    def step(reading: Reading) -> bytes:
        aligner.ingest(reading)
        block: EstimateBlock = pipeline.step(aligner.tick(reading.time_s + 1e-6))
        return encoder.cbor(block, 0, next(sequence))

    step(Reading(-PERIOD_S, _readings(1)[0].values))
    return step, lambda: pipeline.inputs


def axis_config() -> Config:
    """The size of the published table, with 200 points and a moving nut."""
    return config_of(8, SENSORS, grid=200, moving=True)
