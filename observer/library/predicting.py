"""Predictions: a run by the heat laws alone, and the time after the end of a log."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from observer.align.aligner import doubts, frames_of_log, read_in, refuse_empty, refuse_implausible
from observer.config.estimator import AHEAD_H
from observer.errors import LogError, UserError
from observer.estimate.checkpoint import CheckpointFit
from observer.estimate.open_loop import OpenLoop
from observer.estimate.pipeline import MachineModel
from observer.estimate.replay import Progress, estimates_of, program_of, simulated_columns, start_of
from observer.files.documents import write_json
from observer.files.folders import results_in
from observer.files.logs import TIME, Log
from observer.files.writer import arrow_table
from observer.forecast.ahead import runner
from observer.forecast.document import Forecast, document, sentences
from observer.forecast.document import forecast as look_ahead
from observer.forecast.friction import FrictionBank, is_of_use
from observer.forecast.program import learnt, repeating
from observer.frames import EstimateBlock, EstimateQuality, FloatArray, NutPath
from observer.installation import Installation
from observer.library.packages import in_words
from observer.library.signals import SignalTable
from observer.quality.conditions import of_finding
from observer.report.collect import Decimator, simulated
from observer.report.panels import Panel
from observer.service.forecasting import Learner, forecast_columns, program_bins

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True, eq=False, repr=False)
class SimulatedRun(SignalTable):
    """A run predicted by the heat laws alone; it can be given wherever a log is asked for.

    Its signals are the channels, `heat_<source>_W`, `field_<mm>_degC` and `error_<mm>_um`. Sensors' channels
    have no noise.

    Attributes:
        doubts: Sentences about the program.
    """

    doubts: tuple[str, ...]
    _config: Installation
    _samples: Decimator

    def _draw(self, figure: Figure) -> list[Panel]:
        from observer.report.pictures import draw_simulation

        return draw_simulation(figure, self._config, self._samples, self._title)

    @property
    def last_degC(self) -> FloatArray:
        """The last reading of each sensor, (s,), °C; of a displacement in its channel's unit."""
        return np.array([self[sensor.channel][-1] for sensor in self._config.sensor])

    @in_words
    def write(self, folder: str | Path, name: str = "simulated.csv") -> None:
        """Write the log and `overview.png` into a folder.

        Args:
            folder: Is created if it is missing; files of the same names are replaced.
            name: Name of the log; its suffix chooses CSV, compressed CSV or Parquet.

        Raises:
            UserError: The folder cannot be written; then it is as it was before.
        """
        with results_in(Path(folder)) as part:
            self._write_table(part / name)
            self._write_picture(part / "overview.png")


def simulated_run(
    program: Log, config: Installation, start_degC: float | None, progress: Progress
) -> SimulatedRun:
    """Predict a run from the heat laws alone, from the first row on at which all inputs are known.

    Args:
        program: The log of the inputs.
        config: The machine.
        start_degC: Uniform initial temperature; None for the program's sensors, else the ambient.
        progress: Receives the number of rows done and their total.

    Raises:
        LogError: An input has no value in any row, or is beyond its limits throughout.
    """
    machine, log = MachineModel.of(config), program_of(program, config)
    refuse_empty(log, config, sensors=False)
    refuse_implausible(log, config, laws=True)
    samples = Decimator()
    parts: list[tuple[FloatArray, FloatArray, FloatArray]] = []
    rows_done = 0
    loop = OpenLoop(machine.plant, machine.drive, start_degC, config)
    for frames in frames_of_log(log, machine.plan):
        if (predicted := loop.run(frames)) is None:
            continue
        inputs, rows = predicted
        samples.add(simulated(inputs, rows, machine.plant.rows))
        parts.append((inputs.time_s, inputs.law_W, rows))
        rows_done += len(inputs)
        progress(rows_done, len(log))
    if not parts:
        input_names = ", ".join(c for c in config.channels if c not in config.sensor_channels)
        raise LogError(f"{log.path}: in no row are all inputs known ({input_names}); fill their columns")
    time_s, law_W, rows = (np.concatenate(column) for column in zip(*parts, strict=True))
    columns = {TIME: time_s, **simulated_columns(config, machine.plant, log, time_s, law_W, rows)}
    words = tuple(words.text for words in log.words)
    title = f"open-loop prediction of {log.path.name}"
    return SimulatedRun(arrow_table(columns), title, words, config, samples)


@dataclass(frozen=True, eq=False, repr=False)
class ForecastRun(SignalTable):
    """The forecast after a log: temperatures and thermal error with their sigma, and when they settle.

    Attributes:
        sentences: The forecast in words.
        doubts: Sentences about the log and its end.
        document: The content of `forecast.json`.
    """

    sentences: tuple[str, ...]
    doubts: tuple[str, ...]
    document: Mapping[str, Any]
    _forecast: Forecast
    _position_m: FloatArray
    _within_um: float

    def _draw(self, figure: Figure) -> list[Panel]:
        from observer.report.pictures import draw_forecast

        return draw_forecast(figure, self._title, self._position_m, self._forecast, self._within_um)

    @in_words
    def write(self, folder: str | Path) -> None:
        """Write `forecast.csv`, `forecast.json` and `forecast.png` into a folder.

        Args:
            folder: Is created if it is missing; files of the same names are replaced.

        Raises:
            UserError: The folder cannot be written; then it is as it was before.
        """
        with results_in(Path(folder)) as part:
            self._write_table(part / "forecast.csv")
            write_json(part / "forecast.json", self.document)
            self._write_picture(part / "forecast.png")


def forecast_run(
    log: Log, config: Installation, program: Log | None, hours: float | None, progress: Progress
) -> ForecastRun:
    """Replay a log and forecast from its end.

    Args:
        log: The log up to now.
        config: The machine.
        program: A log of the input channels that is repeated; None learns it from the log's end.
        hours: Hours ahead; None for as many as configured.
        progress: Receives the number of rows replayed and their total.

    Raises:
        UserError: `hours` is out of range.
        LogError: The log is implausible or shorter than a step, its end shows no program, or its last
            estimate is not finite.
    """
    settings, machine = config.forecast, MachineModel.of(config, learns=True)
    if hours is not None and not AHEAD_H[0] <= hours <= AHEAD_H[1]:
        raise UserError(f"forecast: hours = {hours!r}: give {AHEAD_H[0]:g} to {AHEAD_H[1]:g} hours ahead")
    refuse_implausible(log, config)
    pipeline, learner, layout = machine.pipeline(), Learner(machine), machine.plant.layout
    start, _ = start_of(log, CheckpointFit.of(machine))
    bank = FrictionBank(config)
    last: EstimateBlock | None = None
    paths, read = list[Mapping[str, NutPath]](), set[str]()
    for frames, block in estimates_of(log, machine.plan, pipeline, progress, start):
        paths.append(frames.path)
        read |= read_in(frames)
        learner.take(pipeline.inputs, block)
        bank.take(pipeline.inputs, block)
        last = block
    if last is None:
        raise LogError(f"{log.path}: holds readings but no tick of the estimator; record for longer")
    try:
        past_bins = learner.bins
        if program is None:
            next_program = learnt(past_bins)
        else:
            next_program = repeating(program_bins(program_of(program, config), machine), past_bins)
        state, hours = pipeline.snapshot()[1], hours or settings.hours
        if is_of_use(config, next_program):
            begins = bank.begins(next_program)
        else:
            begins = [(1.0, runner(machine.plant, config.estimator, state, next_program))]
        forecast = look_ahead(config, begins, next_program, hours, settings.within_um)
    except ValueError as error:
        raise LogError(f"{log.path}: no forecast from its end: {error}") from None
    content = document(
        forecast, machine.plant, EstimateQuality(int(last.quality[-1])), "", settings.within_um
    )
    lines = sentences(forecast, machine.plant, settings.within_um)
    if content["reason"] is not None:
        lines.append(f"Doubtful: {content['reason']}.")
    log_doubts = *doubts(log, paths, config, read), *(of_finding(f).sentence for f in pipeline.findings)
    table = arrow_table({TIME: forecast.now_s + forecast.ahead.time_s, **forecast_columns(layout, forecast)})
    title = f"{config.machine.name}, axis {config.machine.axis}: forecast from the end of {log.path.name}"
    return ForecastRun(
        table, title, tuple(lines), log_doubts, content, forecast, layout.position_m, settings.within_um
    )
