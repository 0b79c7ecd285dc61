"""A service's life without its wires: what it recorded, and what it published of it."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

from observer.align.aligner import Aligner
from observer.bus.codec import EstimateEncoder, config_json
from observer.estimate.checkpoint import CheckpointFit, Snapshot, pack
from observer.estimate.pipeline import MachineModel
from observer.frames import Reading
from observer.installation import Installation, load
from observer.record.recorder import Companions, Recorder
from observer.record.step_columns import StepSource
from observer.record.step_files import StepAppender

DEMO = Path(__file__).parents[2] / "config" / "demo.toml"
BEGIN_S = 1_700_000_000.0
PERIOD_S = 0.5


def configuration(folder: Path, **changed: object) -> Installation:
    """The demo's configuration, recording into a folder, each table changed as given."""
    config = load(DEMO)
    record = config.record.model_copy(update={"directory": folder})
    return config.model_copy(update={"record": record, **changed})


def lived(
    config: Installation,
    ticks: int,
    *,
    begin_s: float = BEGIN_S,
    rotate_bytes: float = 1e9,
    instance: str = "00000001",
    start: Snapshot | None = None,
    resets: tuple[int, ...] = (),
    keeps_steps: bool = True,
) -> tuple[list[bytes], list[bytes], Snapshot]:
    """Do as the loop does; returns estimates, readings as they were published, and where it stood at the end.

    A thermocouple falls silent now and then, another fails, readings come late. Without `keeps_steps` only
    the readings are recorded.
    """
    machine = MachineModel.of(config, learns=True)
    fit, pipeline = CheckpointFit.of(machine), machine.pipeline()
    aligner = Aligner(machine.plan, math.nan if start is None else start.tick_s)
    if start is not None:
        pipeline.restore(start.drive, start.estimator, start.gap)
    name = f"{config.machine.name}-{config.machine.axis}"
    recorder = Recorder(
        config.record.directory, name, config.channels,
        rotate_bytes, 5.0, None,
        Companions(
            None if start is None else pack(start, fit), config_json(config, instance).encode(),
            partial(pack, fit=fit),
        ),
    )  # fmt: skip
    source = StepSource(machine.layout, machine.plan.channels, json.loads(config_json(config, instance)))
    steps = StepAppender(config.record.directory, name, source)
    encoder, dice = EstimateEncoder(pipeline.layout, instance), np.random.default_rng(int(begin_s))
    sensors = [sensor.channel for sensor in config.sensor]
    estimates, readings, standing = [], [], start
    for k in range(ticks):
        tick_s = begin_s + k * PERIOD_S
        values = {name: 22.0 + 0.002 * k + dice.normal(0.0, 0.03) for name in sensors}
        values |= {name: 22.0 for name in config.channels if name not in sensors}
        values |= {name: 0.2 + 0.1 * math.sin(0.1 * k) for name in config.channels if "position" in name}
        faults = {sensors[0]: "open_circuit"} if 40 <= k % 100 < 50 else {}
        if k % 70 > 60:
            del values[sensors[1]]
        if k in resets:
            pipeline.reset()
            row = aligner.ingest(Reading(math.nextafter(tick_s, -math.inf), {}))
            recorder.command(row.time_s, "reset", "done by anna")
        recorder.reading(aligner.ingest(Reading(tick_s - 0.2, values, faults)))
        frame = aligner.tick(tick_s)
        block = pipeline.step(frame)
        estimates.append(encoder.cbor(block, 0, k))
        readings.append(encoder.readings(frame, 0, k))
        if keeps_steps:
            assert steps.append(source.rows(frame, block, k)) == 1
        standing = Snapshot(tick_s, *pipeline.snapshot())
        known = {"walk": aligner.memory, "test": pipeline.test_state, "sequence": k + 1}
        recorder.tick(float(frame.time_s[0]), partial(replace, standing, **known))
    assert recorder.close(10.0)
    steps.close()
    assert standing is not None
    return estimates, readings, standing
