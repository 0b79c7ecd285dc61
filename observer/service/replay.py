"""A recorded log through the live path: its frames, the same drive and estimator, results as files."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

from observer.config import Config
from observer.errors import LogError
from observer.estimators.selftest import Fault
from observer.files.logs import SUFFIXES, TIME, Log
from observer.files.results import write_json
from observer.files.writer import Column, TableWriter
from observer.frames import EstimateBlock, EstimateQuality, FloatArray, Layout, Quality
from observer.model.rod.moving import judge_path
from observer.service.align import AlignPlan, blocks_of_log
from observer.service.checkpoint import START_SUFFIX, Fit, Snapshot, UnfitError, load, recent
from observer.service.pipeline import Pipeline
from observer.service.reasons import sentence

Progress = Callable[[int, int], None]
_SENSOR_LABELS = np.array([quality.label for quality in Quality])
_LABELS = np.array([quality.label for quality in EstimateQuality])


def estimates_of(
    log: Log, plan: AlignPlan, pipeline: Pipeline[Any], progress: Progress, start: Snapshot | None = None
) -> Iterator[EstimateBlock]:
    """The estimates of a log in blocks, by a pipeline that begins cold or, with `start`, there.

    `progress` is told the rows done and their total.
    """
    if start is not None:
        pipeline.restore(start.drive, start.estimator)
    total = len(log) if log.step is None else int(log.step.sum())
    done = 0
    last_tick_s = math.nan if start is None else start.tick_s
    for frames, afresh in blocks_of_log(log, plan, last_tick_s=last_tick_s):
        if afresh:
            pipeline.reset()
        yield pipeline.step(frames)
        done += len(frames)
        progress(done, total)


def lasting(pipeline: Pipeline[Any]) -> dict[str, int]:
    """What the self-test has found, as sentences, and in how many steps; not what only was not known yet."""
    return {sentence(found): n for found, n in pipeline.history if found.fault is not Fault.UNKNOWN}


def start_of(log: Log, fit: Fit) -> tuple[Snapshot | None, str]:
    """Where the service stood when it began a recording, None if cold, and a sentence that says so."""
    suffix = next((s for s in SUFFIXES if log.path.name.endswith(s)), log.path.suffix)
    beside = log.path.with_name(log.path.name.removesuffix(suffix) + START_SUFFIX)
    if log.step is None or not beside.exists():
        return None, "cold"
    try:
        snapshot = recent(load(beside, fit), float(log.time_s[0]), math.inf)
    except UnfitError as error:
        return None, f"cold; {beside.name} is left out, {error}"
    return snapshot, f"warm, from {beside.name}, {log.time_s[0] - snapshot.tick_s:.3f} s before the first row"


class Tally:
    """Adds blocks of estimates up to a replay in numbers: the same for the same log and configuration."""

    def __init__(self, layout: Layout) -> None:
        self._layout = layout
        sensors, sources = len(layout.sensors), len(layout.sources)
        self._times: list[float] = []
        self._rows = 0
        self._quality = np.zeros(len(EstimateQuality), np.int64)
        self._sensor_quality = np.zeros((sensors, len(Quality)), np.int64)
        self._heat, self._heat_count = np.zeros(sources), np.zeros(sources)
        self._count, self._sum, self._squares = np.zeros(sensors), np.zeros(sensors), np.zeros(sensors)

    def add(self, block: EstimateBlock) -> None:
        """Count a block in."""
        self._rows += len(block)
        self._times = [*self._times[:1], *block.time_s[[0, -1]].tolist()]
        self._quality += np.bincount(block.quality, minlength=len(EstimateQuality))
        for j, codes in enumerate(block.sensor_quality.T):
            self._sensor_quality[j] += np.bincount(codes, minlength=len(Quality))
        self._heat += np.nansum(block.heat_W, axis=0)
        self._heat_count += np.isfinite(block.heat_W).sum(axis=0)
        self._count += np.isfinite(block.innovation_K).sum(axis=0)
        self._sum += np.nansum(block.innovation_K, axis=0)
        self._squares += np.nansum(block.innovation_K**2, axis=0)

    def summary(self) -> dict[str, Any]:
        """All that was counted."""
        bias_K, rms_K = _mean(self._sum, self._count), _mean(self._squares, self._count)
        sensors = {
            name: {
                "innovation_rms_K": None if square is None else square**0.5,
                "innovation_bias_K": bias,
                "quality": {q.label: int(n) for q, n in zip(Quality, counts, strict=True)},
            }
            for name, square, bias, counts in zip(
                self._layout.sensors, rms_K, bias_K, self._sensor_quality, strict=True
            )
        }
        return {
            "rows": self._rows,
            "duration_s": self._times[-1] - self._times[0] if self._times else 0.0,
            "quality": {q.label: int(n) for q, n in zip(EstimateQuality, self._quality, strict=True)},
            "heat_mean_W": dict(zip(self._layout.sources, _mean(self._heat, self._heat_count), strict=True)),
            "sensors": sensors,
        }


def _mean(total: FloatArray, count: FloatArray) -> list[float | None]:
    return [float(t / n) if n else None for t, n in zip(total, count, strict=True)]


def result_columns(layout: Layout, block: EstimateBlock) -> dict[str, Column]:
    """The columns of `estimates.csv` for a block."""
    columns: dict[str, Column] = {TIME: block.time_s}
    for j, name in enumerate(layout.sources):
        columns[f"heat_{name}_W"] = block.heat_W[:, j]
        columns[f"heat_{name}_sigma_W"] = block.heat_sigma_W[:, j]
    places = [f"{1000 * x_m:.10g}" for x_m in layout.position_m]
    for j, mm in enumerate(places):
        columns[f"field_{mm}_degC"] = block.field_degC[:, j]
        columns[f"field_{mm}_sigma_K"] = block.field_sigma_K[:, j]
    if layout.has_error:
        for j, mm in enumerate(places):
            columns[f"error_{mm}_um"] = block.error_um[:, j]
            columns[f"error_{mm}_sigma_um"] = block.error_sigma_um[:, j]
    for j, name in enumerate(layout.sensors):
        columns[f"innovation_{name}_K"] = block.innovation_K[:, j]
        columns[f"quality_{name}"] = _SENSOR_LABELS[block.sensor_quality[:, j]]
    columns["quality"] = _LABELS[block.quality]
    return columns


def write_results(
    output: Path,
    suffix: str,
    layout: Layout,
    blocks: Iterator[EstimateBlock],
    log: Log,
    digest: str,
    more: Mapping[str, Any] = MappingProxyType({}),
) -> dict[str, Any]:
    """Write `estimates` + suffix and `summary.json` into `output`; both appear complete or not at all.

    Returns the content of `summary.json`: the summary, and `more` that the caller knows of the log. Raises
    `LogError` where they cannot be written, or when there is no estimate to write.
    """
    tally = Tally(layout)
    with TableWriter(output / f"estimates{suffix}") as writer:
        for block in blocks:
            writer.write(result_columns(layout, block))
            tally.add(block)
        summary = {"log": log.path.name, "config": digest, **tally.summary(), **more}
        if not summary["rows"]:
            raise LogError(f"{log.path}: holds readings but no tick of the estimator; record for longer")
    write_json(output / "summary.json", summary)
    return summary


def nut_paths(config: Config, log: Log) -> Mapping[str, str]:
    """Return, per moving source, whether the log tells the nut's path."""
    found = {}
    for source in config.source:
        if source.position_channel is not None:
            low, high = source.stroke_m or (0.0, config.screw.length_m)
            column = log.values[:, log.channels.index(source.position_channel)]
            found[source.name] = judge_path(column, high - low)
    return found
