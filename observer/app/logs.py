"""What is done with a log as it is: replay, forecast, heats, and a prediction by the laws alone."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from observer.align.aligner import doubts, frames_of_log, refuse_empty
from observer.config import Output
from observer.errors import LogError, UserError
from observer.estimate.pipeline import MachineModel
from observer.estimate.replay import OpenLoop, OpenLoopGap, read_program, simulated_columns
from observer.files.folders import results_in, write_json
from observer.files.logs import Log, read_log, suffix_of
from observer.frames import EstimateBlock, FloatArray, FrameBlock, NutPath
from observer.history.history import MethodOptions
from observer.installation import Installation

Progress = Callable[[int, int], None]


def replay(
    log_path: Path,
    config: Installation,
    output: Path,
    suffix: str,
    *,
    progress: Progress,
    machine: MachineModel | None = None,
    picture: bool = True,
    **accept: bool,
) -> dict[str, Any]:
    """Run a log through the live path; write estimates, `summary.json` and `overview.png` into `output`.

    `machine` is what was built of the same configuration before; `picture` says whether there is to be one.
    `accept` is handed to `read_log`. Returns the summary. Raises `LogError` or `ConfigError`.
    """
    from observer.estimate.checkpoint import CheckpointFit
    from observer.estimate.replay import nut_paths, speeds, start_of, write_estimates
    from observer.report.collect import ReplaySamples
    from observer.report.pictures import write_overview

    log = _recorded(log_path, config, **accept)
    machine = machine or MachineModel.of(config, learns=True)
    pipeline = machine.pipeline()
    start, kind_of_start = start_of(log, CheckpointFit.of(machine))
    samples, open_loop = ReplaySamples(config, pipeline.layout), OpenLoopGap(machine.plant, machine.drive)
    paths: list[Mapping[str, NutPath]] = []

    def follow(frames: FrameBlock, block: EstimateBlock) -> None:
        open_loop.take(frames)
        paths.append(frames.path)
        if picture:
            samples.take(pipeline.inputs, block)

    with results_in(output) as part:
        numbers = write_estimates(
            part / f"estimates{suffix}", log, machine.plan, pipeline, progress, start, follow
        )
        summary = {
            "log": log.path.name,
            "config": config.digest,
            **numbers,
            "nut_path": nut_paths(config, log),
            "speed_mean_rpm": speeds(config, log),
            "open_loop_rms_K": open_loop.rms_K,
            "doubts": doubts(log, paths, config),
            "start": kind_of_start,
        }
        write_json(part / "summary.json", summary)
        if picture:
            write_overview(part / "overview.png", config, samples, f"replay of {log_path.name}")
    return summary


def _recorded(path: Path, config: Installation, **accept: bool) -> Log:
    from observer.record.recent import is_can_recording, read_can_log

    if is_can_recording(path):
        return read_can_log(path, config)
    return channels_of(path, config, **accept)


def channels_of(path: Path, config: Installation, **accept: bool) -> Log:
    """A log of channels, each input of which has a value somewhere."""
    log = read_log(path, config.channels, rows_apart_s=config.log.rows_apart_s, **accept)
    refuse_empty(log, config, sensors=True)
    return log


def forecast(
    log_path: Path,
    config: Installation,
    output: Path,
    *,
    program: Path | None,
    hours: float | None,
    progress: Progress,
    **accept: bool,
) -> list[str]:
    """Replay a log and forecast from its end; write `forecast.csv`, `.json` and `.png` into `output`.

    The program is learnt from the log's end, or given as a log of the input channels. `accept` is handed to
    `read_log`. Returns sentences. Raises `LogError` or `ConfigError`.
    """
    from observer.estimate.checkpoint import CheckpointFit
    from observer.estimate.replay import estimates_of, start_of
    from observer.files.writer import write_log
    from observer.forecast.document import document, sentences
    from observer.forecast.document import forecast as look_ahead
    from observer.forecast.program import given, learnt
    from observer.frames import EstimateQuality
    from observer.live.forecasting import Learner, forecast_columns, program_bins
    from observer.report.pictures import write_forecast

    settings = config.forecast
    log, machine = _recorded(log_path, config, **accept), MachineModel.of(config, learns=True)
    pipeline, learner = machine.pipeline(), Learner(machine)
    start, _ = start_of(log, CheckpointFit.of(machine))
    last: EstimateBlock | None = None
    for _, block in estimates_of(log, machine.plan, pipeline, progress, start):
        learner.take(pipeline.inputs, block)
        last = block
    if last is None:
        raise LogError(f"{log_path}: holds readings but no tick of the estimator; record for longer")
    try:
        ran = learner.bins
        does = learnt(ran) if program is None else given(program_bins(program, machine), ran)
        state = pipeline.snapshot()[1]
        found = look_ahead(config, machine.plant, state, does, hours or settings.hours, settings.within_um)
    except ValueError as error:
        raise LogError(f"{log_path}: no forecast from its end: {error}") from None
    quality = EstimateQuality(int(last.quality[-1]))
    forecasted = document(found, machine.plant, quality, "", settings.within_um)
    with results_in(output) as part:
        columns = forecast_columns(machine.plant.layout, found)
        write_log(part / "forecast.csv", found.now_s + found.ahead.time_s, columns)
        write_json(part / "forecast.json", forecasted)
        title = f"{config.machine.name}, axis {config.machine.axis}: forecast from the end of {log_path.name}"
        write_forecast(
            part / "forecast.png", title, machine.plant.layout.position_m, found, settings.within_um
        )
    lines = sentences(found, machine.plant, settings.within_um)
    return lines if forecasted["reason"] is None else [*lines, f"Doubtful: {forecasted['reason']}."]


def identify(
    log_path: Path,
    config: Installation,
    output: Path,
    options: MethodOptions,
    *,
    progress: Callable[[str], None],
    suffix: str = ".csv",
    picture: bool = True,
    **accept: bool,
) -> dict[str, Any]:
    """Estimate the heats over a whole log at once; write `heat.csv`, `summary.json` and `heat.png`.

    `suffix` is that of the heats' file; `picture` says whether there is to be one. `accept` is handed to
    `read_log`. Returns the summary. Raises `LogError`, `ConfigError` or `UserError`.
    """
    from observer.estimate.replay import inputs_of, nut_paths, speeds, write_history
    from observer.history.identify import heat_history
    from observer.history.tolerances import changes_within
    from observer.report.pictures import write_heat_history

    options.check()
    progress("reading the log")
    log = _recorded(log_path, config, **accept)
    # no field is reported, so the inputs of a long log need not carry its rows
    ends_only = Output(positions_m=(0.0, config.screw.length_m))
    machine = MachineModel.of(config.model_copy(update={"output": ends_only}))
    frames = list(frames_of_log(log, machine.plan))
    blocks = inputs_of(frames, machine.drive)
    odd = doubts(log, [block.path for block in frames], config)
    progress(f"heats by {options.method}, and their σ")
    try:
        history = heat_history(
            machine.plant, config.estimator, blocks, options, partial(changes_within, machine.config, blocks)
        )
    except UserError as error:
        raise LogError(f"{log_path}: {error}") from None
    more: dict[str, Any] = {
        "config": config.digest,
        "method": options.method,
        "nut_path": nut_paths(config, log),
        "speed_mean_rpm": speeds(config, log),
        "doubts": odd,
    }
    progress("writing and drawing")
    with results_in(output) as part:
        summary = write_history(part, machine.plant.layout, history, log, more, suffix)
        title, by = f"heats in {log_path.name}", f"by {options.method}"
        if picture:
            write_heat_history(part / "heat.png", config, history, blocks, title, by)
    return summary


def simulate(
    program: Path,
    config: Installation,
    output: Path,
    start_degC: float | None,
    progress: Progress,
    warn: Callable[[list[str]], None] = lambda _sentences: None,
) -> FloatArray:
    """Predict a run from the heat laws alone and write it as a log, with `overview.png` beside it.

    The program is a log of the input channels; where it also holds the sensors' channels, their first values
    give the initial field. `warn` gets what is doubtful about it. Returns the last predicted sensor
    temperatures in °C.
    """
    from observer.files.writer import write_log
    from observer.report.collect import Decimator, simulated
    from observer.report.pictures import write_simulation_overview

    suffix_of(output)
    machine = MachineModel.of(config)
    log = read_program(program, config)
    refuse_empty(log, config, sensors=False)
    warn([words.text for words in log.words])
    samples = Decimator()
    parts: list[tuple[FloatArray, FloatArray, FloatArray]] = []
    done = 0
    loop = OpenLoop(machine.plant, machine.drive, start_degC)
    for frames in frames_of_log(log, machine.plan):
        if (found := loop.run(frames)) is None:
            continue
        inputs, rows = found
        samples.add(simulated(inputs, rows, machine.plant.rows))
        parts.append((inputs.time_s, inputs.law_W, rows))
        done += len(inputs)
        progress(done, len(log))
    if not parts:
        raise LogError(f"{program}: an input that the model needs never has a value; fill its column")
    time_s, law_W, rows = (np.concatenate(column) for column in zip(*parts, strict=True))
    title = f"open-loop prediction of {program.name}"
    with results_in(output.parent) as part:
        columns = simulated_columns(config, machine.plant, log, time_s, law_W, rows)
        write_log(part / output.name, time_s, columns)
        write_simulation_overview(part / "overview.png", config, samples, title)
    return np.asarray(rows[-1, machine.plant.rows.sensor_slice])
