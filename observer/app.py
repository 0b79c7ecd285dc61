"""The composition root: the one place that puts parts together, one function per command."""

from __future__ import annotations

import hashlib
import time
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from observer.config import Output
from observer.errors import ConfigError, LogError, UserError
from observer.estimators.protocol import Estimator
from observer.files.logs import Log, read_log, suffix_of
from observer.files.results import results_in, write_json
from observer.frames import EstimateBlock, FloatArray, FrameBlock
from observer.history.options import MethodOptions
from observer.installation import Installation, load
from observer.service.align import AlignPlan, doubts, frames_of_log, refuse_empty
from observer.service.machine import Machine
from observer.service.open_loop import open_loop_rms_K, predicted, read_program, simulated_columns

if TYPE_CHECKING:  # the other commands start without the search
    from observer.discovery.discover import Discovery
    from observer.service.misread import Misread

Progress = Callable[[int, int], None]


class Ready(NamedTuple):
    """A machine with its estimator, built once for as many logs as there are."""

    machine: Machine
    estimator: Estimator

    @classmethod
    def of(cls, config: Installation) -> Ready:
        """Build them. Raises `UserError` where no gain to be trusted exists."""
        machine = Machine.of(config, learns=True)
        return cls(machine, machine.estimator())


def replay(
    log_path: Path,
    config: Installation,
    output: Path,
    suffix: str,
    *,
    progress: Progress,
    ready: Ready | None = None,
    picture: bool = True,
    **accept: bool,
) -> dict[str, Any]:
    """Run a log through the live path; write estimates, `summary.json` and `overview.png` into `output`.

    `ready` is what was built of the same configuration before; `picture` says whether there is to be one.
    `accept` is handed to `read_log`. Returns the summary. Raises `LogError` or `ConfigError`.
    """
    from observer.report.collect import ReplaySamples
    from observer.report.overview import write_overview
    from observer.service.checkpoint import Fit
    from observer.service.replay import estimates_of, lasting, nut_paths, speeds, start_of, write_results

    log = _recorded(log_path, config, **accept)
    machine, estimator = ready or Ready.of(config)
    pipeline = machine.pipeline(estimator)
    start, told = start_of(log, Fit.of(config, machine.drive, estimator, pipeline.gap))
    samples = ReplaySamples(config, estimator.layout)
    reasons: dict[str, int] = {}

    def blocks() -> Iterator[EstimateBlock]:
        for block in estimates_of(log, machine.plan, pipeline, progress, start):
            if picture:
                samples.take(pipeline.inputs, block)
            yield block
        reasons.update(lasting(pipeline))
        more["gap"] = None if pipeline.gap is None else pipeline.gap.history

    more: dict[str, Any] = {
        "nut_path": nut_paths(config, log),
        "speed_mean_rpm": speeds(config, log),
        "open_loop_rms_K": open_loop_rms_K(machine.plant, machine.drive, frames_of_log(log, machine.plan)),
        "doubts": doubts(log, frames_of_log(log, machine.plan), config),
        "reasons": reasons,
        "start": told,
    }
    with results_in(output) as part:
        summary = write_results(part, suffix, estimator.layout, blocks(), log, config.digest, more)
        if picture:
            write_overview(part / "overview.png", config, samples, f"replay of {log_path.name}")
    return summary


def _recorded(path: Path, config: Installation, **accept: bool) -> Log:
    from observer.service.can_log import is_can_recording, read_can_log

    if is_can_recording(path):
        return read_can_log(path, config)
    return _channels_of(path, config, **accept)


def _channels_of(path: Path, config: Installation, **accept: bool) -> Log:
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
    from observer.files.writer import write_log
    from observer.forecast.document import document, sentences
    from observer.forecast.document import forecast as look_ahead
    from observer.forecast.program import given, learnt
    from observer.frames import EstimateQuality
    from observer.report.forecast import write_forecast
    from observer.service.checkpoint import Fit
    from observer.service.forecasting import Learner, forecast_columns, program_bins
    from observer.service.replay import estimates_of, start_of

    settings = config.forecast
    log, machine = _recorded(log_path, config, **accept), Machine.of(config, learns=True)
    estimator = machine.estimator()
    pipeline, learner = machine.pipeline(estimator), Learner(machine)
    start, _ = start_of(log, Fit.of(config, machine.drive, estimator, pipeline.gap))
    last: EstimateBlock | None = None
    for block in estimates_of(log, machine.plan, pipeline, progress, start):
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
    told = document(found, machine.plant, quality, "", settings.within_um)
    with results_in(output) as part:
        columns = forecast_columns(machine.plant.layout, found)
        write_log(part / "forecast.csv", found.now_s + found.ahead.time_s, columns)
        write_json(part / "forecast.json", told)
        title = f"{config.machine.name}, axis {config.machine.axis}: forecast from the end of {log_path.name}"
        write_forecast(
            part / "forecast.png", title, machine.plant.layout.position_m, found, settings.within_um
        )
    lines = sentences(found, machine.plant, settings.within_um)
    return lines if told["reason"] is None else [*lines, f"Doubtful: {told['reason']}."]


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
    from observer.fit.changes import changes_within
    from observer.history.identify import heat_history
    from observer.report.heat_history import write_heat_history
    from observer.service.identify import inputs_of, write_history
    from observer.service.replay import nut_paths, speeds

    options.check()
    progress("reading the log")
    log = _recorded(log_path, config, **accept)
    # no field is reported, so the inputs of a long log need not carry its rows
    ends_only = Output(positions_m=(0.0, config.screw.length_m))
    machine = Machine.of(config.model_copy(update={"output": ends_only}))
    frames = list(frames_of_log(log, machine.plan))
    blocks, odd = inputs_of(frames, machine.drive), doubts(log, frames, config)
    progress(options.method)
    try:
        history = heat_history(
            machine.plant, config.estimator, blocks, options, partial(changes_within, machine.config, frames)
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
    give the initial field. `warn` is told what is doubtful about it. Returns the last predicted sensor
    temperatures in °C.
    """
    from observer.files.writer import write_log
    from observer.report.collect import Decimator, simulated
    from observer.report.overview import write_simulation_overview

    suffix_of(output)
    machine = Machine.of(config)
    log = read_program(program, config)
    refuse_empty(log, config, sensors=False)
    warn([words.text for words in log.words])
    samples = Decimator()
    parts: list[tuple[FloatArray, FloatArray, FloatArray]] = []
    done = 0
    for inputs, rows in predicted(machine.plant, machine.drive, frames_of_log(log, machine.plan), start_degC):
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


def calibrate(
    log_paths: Sequence[Path], config_path: Path, output: Path, progress: Callable[[str], None]
) -> dict[str, Any]:
    """Fit the free parameters and the process noise; write `config.toml` and `calibration.json`.

    Returns the content of `calibration.json`.
    """
    from observer.discovery.result import calibration_result
    from observer.fit.calibrate import calibrate as fit
    from observer.fit.process_noise import fit_noise
    from observer.installation.write_back import write_back

    config = load(config_path)
    searched = config_path.read_bytes()
    runs, odd, _ = _runs(log_paths, config)
    with results_in(output) as part:
        found = fit(config, runs, lambda n, rms_K: progress(f"fit {n}: {rms_K:.4f} K rms"))
        progress("process noise by maximum likelihood")
        noise = fit_noise(found.config, runs)
        result = calibration_result(found, noise) | {"doubts": odd}
        result = _about(searched, [path.name for path in log_paths]) | result
        text = write_back(config_path.read_text(encoding="utf-8"), found.values | found.left | noise)
        (part / "config.toml").write_text(text, encoding="utf-8")
        write_json(part / "calibration.json", result)
    return result


def learned(config_path: Path, output: Path) -> dict[str, tuple[float, float]]:
    """Write the configuration with what its service has learnt, by its checkpoint, as `config.toml`, and what
    that is as `learned.json`.

    Returns what has been learnt, with σ. Raises `ConfigError` where nothing is learnt or left to go by.
    """
    from observer.fit.learnt import offered
    from observer.installation.write_back import with_effects, write_back
    from observer.service.checkpoint import Fit, UnfitError
    from observer.service.checkpoint import load as load_checkpoint

    config, searched = load(config_path), config_path.read_bytes()
    machine, file = Machine.of(config, learns=True), config.checkpoint_file
    if (learning := machine.plant.learning) is None or not learning.names:
        raise ConfigError(
            f"{config_path}: estimator.learn: nothing is learnt; name what the estimator is to learn"
        )
    if file is None:
        raise ConfigError(f"{config_path}: the service keeps no checkpoint; give [checkpoint] directory")
    try:
        fit = Fit.of(config, machine.drive, machine.estimator(), machine.gap())
        stood = load_checkpoint(file, fit).estimator
    except UnfitError as error:
        raise ConfigError(f"{file}: {error}; run the service by {config_path.name} for some hours") from None
    first = len(stood.x_hat) - machine.plant.learnt
    told = learning.told(stood.x_hat[first:], stood.P[first:, first:])
    offer = offered(config, told)
    with results_in(output) as part:
        text = write_back(config_path.read_text(encoding="utf-8"), offer.values | offer.left)
        (part / "config.toml").write_text(with_effects(text, offer.biases), encoding="utf-8")
        parameters = {key: {"value": value, "sigma": sigma} for key, (value, sigma) in told.items()}
        write_json(part / "learned.json", _about(searched, [file.name]) | {"parameters": parameters})
    return told


class _Runs(NamedTuple):
    """The frames of each log, what is doubtful about the logs as they are, and what was in another unit."""

    frames: list[list[FrameBlock]]
    odd: list[str]
    misread: tuple[Misread, ...] = ()


def _runs(log_paths: Sequence[Path], config: Installation, *, rightly: bool = False) -> _Runs:
    """Read logs; `rightly`, those in which a channel is in another unit in the one expected."""
    from observer.service.misread import read_rightly

    _refuse_twice(log_paths)
    plan, runs = AlignPlan.of(config), []
    odd: list[str] = []
    misread: dict[Misread, None] = {}
    for path in log_paths:
        log = _channels_of(path, config)
        frames = list(frames_of_log(log, plan))
        odd += [f"{path.name}: {sentence}" for sentence in doubts(log, frames, config)]
        log, found = read_rightly(log, config) if rightly else (log, ())
        misread |= dict.fromkeys(found)
        runs.append(list(frames_of_log(log, plan)) if found else frames)
    return _Runs(runs, odd, tuple(misread))


def _refuse_twice(log_paths: Sequence[Path]) -> None:
    """Raise `LogError` where two logs are one: it would be the proof of what was found in it."""
    seen: dict[str, Path] = {}
    for path in log_paths:
        try:
            with open(path, "rb") as file:
                content = hashlib.file_digest(file, "sha256").hexdigest()
        except OSError:
            continue  # who reads it says why it cannot be
        if (before := seen.setdefault(content, path)) is not path:
            raise LogError(f"{path}: holds the same as {before}; give each log once")


def _recent(config: Installation, last_s: float) -> tuple[_Runs, list[str]]:
    """What the service recorded lately, a run for each stretch, and what each is called."""
    from observer.service.plausibility import doubts_of_log
    from observer.service.recent import stretches

    name = f"{config.machine.name}-{config.machine.axis}"
    runs, odd, names = [], [], []
    for stretch in stretches(config.record, name, AlignPlan.of(config), last_s):
        frames = stretch.frames
        runs.append([frames])
        names.append(str(stretch))
        odd += [
            f"{names[-1]}: {sentence}"
            for sentence in doubts_of_log(config, frames.values, frames.channels, [frames.path])
        ]
    return _Runs(runs, odd), names


def _about(searched: bytes, names: Sequence[str]) -> dict[str, Any]:
    """What a result was made of: program, logs, and the text of the configuration."""
    return {
        "version": version("ballscrew-observer"),
        "logs": list(names),
        "config_sha256": hashlib.sha256(searched).hexdigest(),
    }


def adopt(folder: Path, config_path: Path, hours: float) -> str:
    """Put a found configuration in the place of the one that was searched; returns a sentence."""
    from observer.installation.adopt import adopt as put
    from observer.installation.adopt import before_of

    adoption = put(folder, config_path, hours, time.time())
    return (
        f"{config_path} is now the configuration of {folder}; the one before is in "
        f"{before_of(config_path, adoption).name}.\nA running service puts it in force within seconds, "
        f"watches the gap for {hours:g} h of running, and takes it back if that has not shrunk."
    )


def adopted(config_path: Path, *, undo: bool) -> str:
    """Say how the last adoption stands; with `undo` take it back before."""
    from observer.installation.adopt import adoption_of
    from observer.installation.adopt import undo as put_back

    found = put_back(config_path) if undo else adoption_of(config_path)
    return f"{config_path}: " + ("nothing was adopted" if found is None else found.sentence())


def discover(
    config_path: Path,
    log_paths: Sequence[Path],
    output: Path,
    progress: Callable[[str, float], None],
    *,
    recent_s: float | None = None,
    report: bool = True,
    alone: bool = False,
) -> tuple[Discovery, dict[str, Any]]:
    """Find the effect that the model lacks; write `result.json`, `report.html` and, if named, `config.toml`.

    With `recent_s` the logs are what the service has recorded in so many last seconds; `alone`, in this
    process only, for the other cores have work of their own. Returns what was
    found, and the content of `result.json`.
    """
    from observer.discovery.crew import Crew
    from observer.discovery.discover import discover as find
    from observer.discovery.result import discovery_result
    from observer.discovery.suspects import Suspect
    from observer.installation.write_back import with_effects, write_back
    from observer.report.discovery import write_discovery_report

    config = load(config_path)
    progress("reading logs", 0.0)
    searched = config_path.read_bytes()
    if recent_s is None:
        runs, names = _runs(log_paths, config, rightly=True), [path.name for path in log_paths]
    else:
        runs, names = _recent(config, recent_s)
    righted = [Suspect("units", m.channel, m.unit, m.text) for m in runs.misread]
    with results_in(output) as part:
        with Crew(alone=alone) as crew:
            found = find(config, runs.frames, progress, crew, righted)
        result = _about(searched, names) | discovery_result(found) | {"doubts": runs.odd}
        if found.verdict.kind == "named":
            values = {key: entry["value"] for key, entry in result["calibrated"].items()}
            text = write_back(config_path.read_text(encoding="utf-8"), values)
            text = with_effects(text, found.verdict.fit.config.effect[len(config.effect) :])
            (part / "config.toml").write_text(text, encoding="utf-8")
        write_json(part / "result.json", result)
        if report:
            progress("writing the report", 0.97)
            write_discovery_report(part / "report.html", found, result, names)
    return found, result


def place(config: Installation, count: int, spacing_m: float | None) -> list[dict[str, Any]]:
    """Rank sensor sites: the best sets of 1 … `count` positions and how well they see."""
    from observer.estimators.design.placement import best_places

    return [
        {
            "sensors": len(found.sites),
            "positions_m": places_m,
            "score_K": found.score_K,
            "condition": found.condition,
        }
        for places_m, found in best_places(config, count, spacing_m)
    ]


def init(output: Path, given: dict[str, str | None], ask: Callable[[str, str | None], str] | None) -> str:
    """Write a first configuration from what is given and what `ask` is told; returns what to do next."""
    from observer.installation.init.asking import agreed
    from observer.installation.init.writing import checked, write_new

    if output.exists():  # before anything is asked
        raise UserError(f"{output}: is there already and is not overwritten; name another file with --output")
    write_new(output, agreed(given, ask, checked))
    return (
        f'written: {output}. What is marked "look" in it is a usual value. Next:\n'
        f"  observer check --config {output}           what it means\n"
        f"  observer check --config {output} --wires   what each device delivers\n"
        f"  observer run --config {output}             the service"
    )


def service(config_paths: Sequence[Path], root: Path, *, dry_run: bool) -> Iterator[str]:
    """Install the service of one axis or several, without any remove it; yields what is done, in words."""
    from observer.installation import unit
    from observer.report.examine import examine

    if not config_paths:
        plan = unit.to_remove()
    else:
        program = unit.this_program()
        if root == Path("/") and not dry_run:
            unit.refuse_unseen(program)
        here = root == Path("/")
        axes = [
            unit.Axis(examine(path, runs_here=here), path, path.read_text(encoding="utf-8"))
            for path in config_paths
        ]
        plan = unit.to_install(axes, program)
    if dry_run:
        yield from plan.lines()
        return
    unit.carry_out(plan, root)
    yield from plan.lines() if root == Path("/") else (f"written below {root}; nothing was run",)
    if not config_paths:
        yield f"kept: {unit.CONFIG.parent} and {unit.STATE}"
        return
    yield f"from now on edit {', '.join(str(path) for path in plan.configurations)}"
    if root == Path("/"):
        yield f"it starts, the first time for minutes: journalctl -fu {unit.NAME}, then observer health"


def wires(config: Installation) -> dict[str, Any]:
    """Return what every device delivers in a few seconds. Raises `UserError` for a file it cannot use."""
    from observer.service.one_look import look
    from observer.service.plausibility import Limits

    limits, column = Limits.of(config), {name: j for j, name in enumerate(config.channels)}

    def doubt(channel: str, value: float) -> str | None:
        return limits.doubt(column[channel], value) if channel in column else None

    return look([settings.open(key) for key, settings in config.drivers.items()], doubt)
