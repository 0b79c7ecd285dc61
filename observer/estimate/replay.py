"""A recorded log through the live path: its frames, the same drive and estimator, results as files."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from observer.align.aligner import AlignPlan, blocks_of_log
from observer.align.walk import Walk
from observer.config.machine import Config
from observer.config.sensors import Sensor
from observer.errors import LogError
from observer.estimate.checkpoint import CheckpointFit, Snapshot, UnfitError, load, recent
from observer.estimate.pipeline import Pipeline
from observer.files.logs import SUFFIXES, TIME, Log
from observer.files.writer import Column, TableSink
from observer.frames import (
    FORCE,
    PARTS,
    EstimateBlock,
    EstimateQuality,
    FloatArray,
    FrameBlock,
    Inputs,
    Layout,
    Quality,
)
from observer.history.history import HeatHistory
from observer.model.drive import Drive
from observer.model.plant import Plant
from observer.model.rod.moving import judge_path
from observer.quality.reasons import NotGood
from observer.record.retention import START_SUFFIX, STATE_SUFFIX

Progress = Callable[[int, int], None]
_SENSOR_LABELS = np.array([quality.label for quality in Quality])
_LABELS = np.array([quality.label for quality in EstimateQuality])


def estimates_of(
    log: Log, plan: AlignPlan, pipeline: Pipeline[Any], progress: Progress, start: Snapshot | None = None
) -> Iterator[tuple[FrameBlock, EstimateBlock]]:
    """Yield the frames of a log in blocks, with their estimates.

    Resets that a recording contains are repeated.

    Args:
        log: The log.
        plan: The plan of its channels.
        pipeline: A pipeline that has not stepped yet.
        progress: Receives the number of processed rows and the total, after each block.
        start: Where the pipeline begins; None begins cold.
    """
    walk = None
    if start is not None:
        pipeline.restore(start.drive, start.estimator, start.gap, start.test)
        if start.walk is not None:
            walk = Walk(plan.channels, plan.expected(), memory=start.walk)
    total = len(log) if log.step is None else int(log.step.sum())
    rows_done = 0
    last_tick_s = math.nan if start is None else start.tick_s
    for frames, afresh in blocks_of_log(log, plan, last_tick_s=last_tick_s, walk=walk):
        if afresh:
            pipeline.reset()
        yield frames, pipeline.step(frames)
        rows_done += len(frames)
        progress(rows_done, total)


def start_of(log: Log, fit: CheckpointFit) -> tuple[Snapshot | None, str]:
    """Return the snapshot at the start of a recording.

    It is looked for beside the recording, under the recording's name. A snapshot that does not fit is left
    out.

    Args:
        log: The log.
        fit: The requirements on the snapshot.

    Returns:
        The snapshot, None after a cold start, and a clause about it for the summary.
    """
    suffix = next((s for s in SUFFIXES if log.path.name.endswith(s)), log.path.suffix)
    stem = log.path.name.removesuffix(suffix)
    candidates = (log.path.with_name(stem + end) for end in (START_SUFFIX, STATE_SUFFIX))
    state_path = next((path for path in candidates if path.exists()), None)
    if log.step is None or state_path is None:
        return None, "cold"
    try:
        snapshot = recent(load(state_path, fit), float(log.time_s[0]), math.inf)
    except UnfitError as error:
        return None, f"cold; {state_path.name} is left out, {error}"
    return (
        snapshot,
        f"warm, from {state_path.name}, {log.time_s[0] - snapshot.tick_s:.3f} s before the first row",
    )


def _counts(block: EstimateBlock) -> tuple[Any, ...]:
    """Return the counts and sums of one block for the summary."""
    heat_W, innovation_K = block.heat_W, block.innovation_K
    return (
        len(block),
        np.bincount(block.quality, minlength=len(EstimateQuality)),
        np.array([np.bincount(codes, minlength=len(EstimateQuality)) for codes in block.part_quality.T]),
        np.array([np.bincount(codes, minlength=len(Quality)) for codes in block.sensor_quality.T]),
        np.bincount(
            block.sensors_used[block.quality == EstimateQuality.GOOD],
            minlength=block.sensor_quality.shape[1] + 1,
        ),
        np.isfinite(heat_W).sum(axis=0),
        np.nansum(heat_W, axis=0),
        np.isfinite(innovation_K).sum(axis=0),
        np.nansum(innovation_K, axis=0),
        np.nansum(innovation_K**2, axis=0),
    )


def _summary(layout: Layout, counts: list[tuple[Any, ...]], duration_s: float) -> dict[str, Any]:
    """Return the summary of a replay; it depends on the log and the configuration only."""
    totals: list[Any] = [sum(column) for column in zip(*counts, strict=True)]
    rows, quality, part_quality, sensor_quality, good_by_used, heats, heat_W, values, sum_K, squares_K2 = (
        totals
    )
    bias_K, squares_K2 = _mean(sum_K, values), _mean(squares_K2, values)
    sensors = zip(layout.sensors, layout.units, squares_K2, bias_K, sensor_quality, strict=True)
    return {
        "rows": rows,
        "duration_s": duration_s,
        "quality": _steps_by_quality(quality),
        **{f"{part}_quality": _steps_by_quality(n) for part, n in zip(PARTS, part_quality, strict=True)},
        "good_by_sensors_used": {str(n): int(steps) for n, steps in enumerate(good_by_used) if steps},
        "heat_mean_W": dict(zip(layout.sources, _mean(heat_W, heats), strict=True)),
        "sensors": {
            name: {
                f"innovation_rms_{unit}": None if square is None else square**0.5,
                f"innovation_bias_{unit}": bias,
                "quality": {q.label: int(n) for q, n in zip(Quality, codes, strict=True)},
            }
            for name, unit, square, bias, codes in sensors
        },
    }


def _steps_by_quality(steps: Sequence[int]) -> dict[str, int]:
    return {q.label: int(n) for q, n in zip(EstimateQuality, steps, strict=True)}


def _mean(total: FloatArray, count: FloatArray) -> list[float | None]:
    return [float(t / n) if n else None for t, n in zip(total, count, strict=True)]


def heat_columns(layout: Layout, estimates: EstimateBlock | HeatHistory) -> dict[str, Column]:
    """Return time in s and heats in W as the columns of a table, (K,) each; those of estimates include
    bounds.
    """
    columns: dict[str, Column] = {TIME: estimates.time_s}
    for j, name in enumerate(layout.sources):
        columns[f"heat_{name}_W"] = estimates.heat_W[:, j]
        columns[f"heat_{name}_sigma_W"] = estimates.heat_sigma_W[:, j]
        if isinstance(estimates, EstimateBlock):
            columns[f"heat_{name}_bound_W"] = estimates.heat_bound_W[:, j]
    return columns


def result_columns(layout: Layout, block: EstimateBlock) -> dict[str, Column]:
    """Return the columns of `estimates.csv` for a block, (K,) each, by name and in their order.

    Units end the names; qualities are words.
    """
    columns = heat_columns(layout, block)
    columns |= layout.along(
        field__degC=block.field_degC, field__sigma_K=block.field_sigma_K, field__bound_K=block.field_bound_K
    )
    if layout.has_error:
        columns |= layout.along(
            error__um=block.error_um,
            error__sigma_um=block.error_sigma_um,
            error__bound_um=block.error_bound_um,
        )
    if layout.has_force:
        columns |= {name: getattr(block, name)[:, 0] for name in FORCE}
    for j, (name, unit) in enumerate(zip(layout.sensors, layout.units, strict=True)):
        columns[f"innovation_{name}_{unit}"] = block.innovation_K[:, j]
        columns[f"quality_{name}"] = _SENSOR_LABELS[block.sensor_quality[:, j]]
    for j, name in enumerate(layout.learned):
        columns[f"learned_{name}"] = block.learned[:, j]
        columns[f"learned_{name}_sigma"] = block.learned_sigma[:, j]
    columns["quality"] = _LABELS[block.quality]
    columns |= {f"{part}_quality": _LABELS[block.part_quality[:, q]] for q, part in enumerate(PARTS)}
    columns["sensors_used"] = block.sensors_used.astype(float)
    columns["sensors"] = np.full(len(block), float(len(layout.sensors)))
    return columns


def write_estimates(
    sink: TableSink,
    log: Log,
    plan: AlignPlan,
    pipeline: Pipeline[Any],
    progress: Progress,
    start: Snapshot | None = None,
    follow: Callable[[FrameBlock, EstimateBlock], None] = lambda _frames, _block: None,
) -> dict[str, Any]:
    """Write the estimates of a log into a table, and return their summary.

    Args:
        sink: Takes the columns of each block.
        log: The log.
        plan: The plan of its channels.
        pipeline: A pipeline that has not stepped yet.
        progress: Receives the number of processed rows and the total.
        start: Where the pipeline begins; None begins cold.
        follow: Receives every block with its frames.

    Returns:
        The summary: rows, duration, steps by quality, mean heats, innovations, and the reasons for steps that
        are not good.

    Raises:
        LogError: If the log gives no estimate.
    """
    layout, not_good = pipeline.layout, NotGood(plan.channels)
    counts, times = [], []
    for frames, block in estimates_of(log, plan, pipeline, progress, start):
        sink.write(result_columns(layout, block))
        counts.append(_counts(block))
        times += block.time_s[[0, -1]].tolist()
        not_good.take(frames, block)
        follow(frames, block)
    if not counts:
        raise LogError(f"{log.path}: holds readings but no tick of the estimator; record for longer")
    not_good.note(pipeline.history)
    return {
        **_summary(layout, counts, times[-1] - times[0]),
        "reasons": not_good.reasons,
        "heat_reasons": not_good.of_heats,
        "gap": None if pipeline.gap is None else pipeline.gap.history,
    }


def nut_paths(config: Config, log: Log) -> Mapping[str, str]:
    """Return the quality of the nut's path in the log, by moving source, as `judge_path` names it."""
    paths = {}
    for source in config.source:
        if source.position_channel is not None:
            low, high = source.stroke_m or (0.0, config.screw.length_m)
            column = log.values[:, log.channels.index(source.position_channel)]
            paths[source.name] = judge_path(column, high - low)
    return paths


def speeds(config: Config, log: Log) -> Mapping[str, float]:
    """Return the mean absolute speed over the log, in rpm, by source with a speed; a column without a value
    is left out.
    """
    speeds_rpm = {}
    for source in config.source:
        if source.speed_channel is not None:
            column = np.abs(log.values[:, log.channels.index(source.speed_channel)])
            if np.isfinite(column).any():
                speeds_rpm[source.name] = float(np.nanmean(column))
    return speeds_rpm


def inputs_of(log: Iterable[FrameBlock], drive: Drive) -> list[Inputs]:
    """Return the inputs of the plant over the frames of a log, by the same path as a live reading."""
    state, blocks = drive.initial(), []
    for frames in log:
        state, inputs = drive.run(state, frames)
        blocks.append(inputs)
    return blocks


def history_summary(
    layout: Layout, history: HeatHistory, log: Log, extra: Mapping[str, Any]
) -> dict[str, Any]:
    """Return the summary of the heats over a log.

    Args:
        layout: The names of sources and sensors.
        history: The heats with their σ and residuals.
        log: The log.
        extra: Further entries.

    Raises:
        LogError: If no heat can be estimated from the log.
    """
    if not np.isfinite(history.heat_W).any():
        raise LogError(
            f"{log.path}: no sensor has a value while all inputs are known, so no heat can be estimated; "
            "check the sensors' channels"
        )
    names = layout.sources
    return {
        "log": log.path.name,
        "rows": len(history),
        "duration_s": float(history.time_s[-1] - history.time_s[0]),
        "heat_mean_W": _by_name(names, history.heat_W),
        "heat_sigma_mean_W": _by_name(names, history.heat_sigma_W),
        "heat_peak_W": {
            name: float(np.nanmax(heat)) for name, heat in zip(names, history.heat_W.T, strict=True)
        },
        "residual_rms_K": {
            name: None if mean is None else mean**0.5
            for name, mean in _by_name(layout.sensors, history.residual_K**2).items()
        },
        **history.details,
        "warnings": list(history.warnings),
        **extra,
    }


def _by_name(names: tuple[str, ...], values: FloatArray) -> dict[str, float | None]:
    """Return the mean of each column (K, n), None without a finite value."""
    is_finite = np.isfinite(values)
    return {
        name: float(column[finite].mean()) if finite.any() else None
        for name, column, finite in zip(names, values.T, is_finite.T, strict=True)
    }


def program_of(log: Log, config: Config) -> Log:
    """Return a log as a program, with missing values for sensors that it lacks.

    Raises:
        LogError: If it lacks an input; it names the column.
    """
    lacking = config.sensor_channels - set(log.channels)
    present_channels = [c for c in config.channels if c not in lacking]
    log = log.with_channels(present_channels)
    values = {c: log.values[:, i] for i, c in enumerate(log.channels)}
    missing = np.full(len(log), np.nan)
    return replace(
        log,
        channels=config.channels,
        values=np.column_stack([values.get(c, missing) for c in config.channels]),
    )


def simulated_columns(
    config: Config, plant: Plant, log: Log, time_s: FloatArray, law_W: FloatArray, rows: FloatArray
) -> dict[str, FloatArray]:
    """Return the columns of a simulated log: sensors, inputs, heats, field, thermal error.

    Args:
        config: The configuration.
        plant: Its plant.
        log: The program.
        time_s: The times of the K steps, a part of the program's.
        law_W: The heats of all sources, (K, m).
        rows: The plant's outputs, (K, R).

    Returns:
        Columns (K,) by name; displacements are in the unit of their channel.
    """
    meaning, layout = plant.rows, plant.layout
    columns = {s.channel: rows[:, i] / s.channel_scale for i, s in enumerate(config.sensor) if not s.along}
    at = np.searchsorted(log.time_s, time_s)
    sensors = config.sensor_channels
    input_columns = {c: log.values[at, i] for i, c in enumerate(log.channels) if c not in sensors}
    columns |= _displacements(config, plant, rows, input_columns) | input_columns
    columns |= {f"heat_{name}_W": law_W[:, j] for j, name in enumerate(plant.source_names)}
    columns |= layout.along(field__degC=rows[:, meaning.field_slice])
    columns |= layout.along(error__um=meaning.error_um(rows)) if layout.has_error else {}
    return columns | ({"force_N": meaning.force_N(rows)[:, 0]} if layout.has_force else {})


def _displacements(
    config: Config, plant: Plant, rows: FloatArray, input_columns: Mapping[str, FloatArray]
) -> dict[str, FloatArray]:
    """Return the readings of displacement sensors that the output rows do not contain.

    These are sensors that move with a nut, whose position is an input. With play in a support, they are all
    displacement sensors, because the rows are those of a screw without play.
    """
    restraint = plant.rows.restraint
    is_linear = restraint is None or restraint.linear
    moved = {
        s.measured_channel: s
        for s in config.sensor
        if s.along or (s.kind == "displacement" and not is_linear)
    }
    if not moved:
        return {}
    error_um, grid_m = plant.rows.error_um(rows), plant.layout.position_m
    way_m = {
        s.name: input_columns[str(s.position_channel)]
        for s in config.source
        if s.position_channel in input_columns
    }

    def read(sensor: Sensor) -> FloatArray:
        at_m = way_m[sensor.along] if sensor.along else np.full(len(rows), sensor.position_m or 0.0)
        read_um = [np.interp(x, grid_m, row) for x, row in zip(at_m, error_um, strict=True)]
        return np.array(read_um) / sensor.channel_scale

    return {channel: read(sensor) for channel, sensor in moved.items()}
