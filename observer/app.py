"""The composition root: the one place that puts parts together, one function per command."""

from __future__ import annotations

import json
import math
import tempfile
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from observer.config import Output
from observer.errors import ConfigError, LogError, UserError
from observer.estimators import build_estimator
from observer.estimators.protocol import Estimator
from observer.estimators.selftest import SelfTest
from observer.files.logs import Log, read_log, suffix_of
from observer.files.results import results_in
from observer.frames import EstimateBlock, FloatArray, FrameBlock, Inputs
from observer.history.options import MethodOptions
from observer.installation import Installation, load
from observer.model.build import build_plant
from observer.model.drive import Drive
from observer.model.plant import Plant
from observer.publish.taken import refuse_taken
from observer.service.align import AlignPlan, doubts, frames_of_log
from observer.service.pipeline import Pipeline

if TYPE_CHECKING:  # the daemon's parts and the search's; the other commands start without them
    from observer.discovery.discover import Discovery
    from observer.service.checkpoint import Fit, Standing
    from observer.service.clock import ServiceClock
    from observer.service.loop import Service
    from observer.service.renew import Renewals
    from observer.service.warm import Compiler

Progress = Callable[[int, int], None]


@dataclass(frozen=True, slots=True)
class Machine:
    """A configuration with the plant, the drive and the expectations of its channels that follow from it."""

    config: Installation
    plant: Plant
    drive: Drive
    plan: AlignPlan

    @classmethod
    def of(cls, config: Installation) -> Machine:
        """Build the parts of a configuration."""
        plant = build_plant(config)
        return cls(config, plant, Drive(config, plant), AlignPlan.of(config))

    def self_test(self) -> SelfTest:
        """What holds the estimates against the model and the laws."""
        return SelfTest(self.config, self.plant)

    def pipeline(self, estimator: Estimator) -> Pipeline[Any]:
        """Frames in, estimates out, of the quality that they earn."""
        return Pipeline(self.drive, estimator, self.self_test())

    def estimator(self) -> Estimator:
        """Design the estimator. Raises `UserError` where no gain to be trusted exists."""
        return build_estimator(self.plant, self.config.estimator)


def serve(config: Installation, seconds: float | None = None, path: Path | None = None) -> None:
    """Run the daemon until it is stopped; the caller leaves the process afterwards.

    With `path`, SIGHUP has the configuration read again from there.
    """
    from observer.publish.session import listening
    from observer.service.checkpoint import shifted
    from observer.service.clock import ServiceClock
    from observer.service.keeper import carried, stored
    from observer.service.lives import run
    from observer.service.renew import Renewal, Renewals

    refuse_taken(listening(config.publish), "publish.listen")
    ready, clock = _Ready.of(config), ServiceClock()
    renewals: Renewals[_Ready] = Renewals(None if path is None else lambda: _reread(path, ready.config))

    def anew(renewal: Renewal[_Ready]) -> Service:
        nonlocal ready, clock
        before, ready, standing = ready, renewal.prepared or ready, renewal.standing
        if renewal.new_time and standing is not None:
            standing = shifted(standing, clock.offset_s())
        clock = ServiceClock() if renewal.new_time else clock
        carry = carried(standing, before.fit, ready.fit)
        return _service(ready, clock, renewals, carry, alone=False)

    file = ready.checkpoint
    start = stored(file, ready.fit, clock.now(), config.checkpoint.oldest_s) if file is not None else None
    run(_service(ready, clock, renewals, start, alone=True), seconds, anew)


@dataclass(frozen=True, slots=True)
class _Ready:
    """A configuration for the daemon that has been checked, with what takes long to build."""

    config: Installation
    machine: Machine
    estimator: Estimator
    fit: Fit

    @classmethod
    def of(cls, config: Installation) -> _Ready:
        """Check and build. Raises `UserError`."""
        from observer.service.checkpoint import Fit

        _every_channel_has_a_driver(config)
        if config.record.directory is not None:
            _can_be_made(config.record.directory)
        machine = Machine.of(config)
        estimator = machine.estimator()
        return cls(config, machine, estimator, Fit.of(config, machine.drive, estimator))

    @property
    def checkpoint(self) -> Path | None:
        """The file of the checkpoint, if there is to be one."""
        place, name = self.config.checkpoint.place(self.config.record), self.config.machine
        return None if place is None else place / f"{name.name}-{name.axis}.checkpoint"

    def compiler(self) -> Compiler:
        """What has its kernels compiled."""
        from observer.service.notify import service_manager
        from observer.service.warm import Compiler

        line = self.config.model_dump_json(by_alias=True, exclude_unset=True)
        return Compiler("observer.compile_kernels", line, service_manager())


def _reread(path: Path, now: Installation) -> _Ready:
    """Read, check and build a configuration beside the one that runs. Raises `UserError`."""
    from drivers import open_driver
    from observer.publish.session import listening
    from observer.service.align import Aligner

    config = load(path)
    refuse_taken(set(listening(config.publish)) - set(listening(now.publish)), "publish.listen")
    for key, settings in config.drivers.items():
        open_driver(key, settings)
    ready = _Ready.of(config)
    frame = Aligner(ready.machine.plan).tick(0.0)
    ready.compiler().warm(lambda: ready.machine.pipeline(ready.estimator).warm_up(frame))
    return ready


def _service(
    ready: _Ready,
    clock: ServiceClock,
    renewals: Renewals[_Ready],
    start: Standing | None,
    *,
    alone: bool,
) -> Service:
    """Put the parts of the daemon together; `start` is where the estimator goes on from, None if cold.

    `alone` asks for nobody else to have the axis.
    """
    import secrets

    from drivers import open_driver
    from observer.publish.codec import config_json
    from observer.publish.zenoh import ZenohPublisher
    from observer.service.checkpoint import pack
    from observer.service.compensate import Compensator
    from observer.service.keeper import Keeper
    from observer.service.loop import Service
    from observer.service.notify import service_manager
    from observer.service.record import Recorder
    from observer.service.retention import Retention

    config, machine, estimator = ready.config, ready.machine, ready.estimator
    name, record, instance = config.machine, config.record, secrets.token_hex(4)
    held = None if start is None else start.compensation
    compensator = (
        Compensator(config, estimator.layout.position_m, instance, held)
        if config.compensation.enabled
        else None
    )
    file = ready.checkpoint
    return Service(
        drivers=tuple(open_driver(key, settings) for key, settings in config.drivers.items()),
        plan=machine.plan,
        drive=machine.drive,
        estimator=estimator,
        publisher=ZenohPublisher(
            name.name,
            name.axis,
            config.publish,
            config_json(config, instance),
            estimator.layout,
            instance,
            compensates=compensator is not None,
        ),
        recorder=Recorder(
            record.directory,
            f"{name.name}-{name.axis}",
            config.channels,
            int(record.rotate_MB * 1e6),
            record.sync_s,
            Retention.of(record),
            None if start is None else pack(start, ready.fit),
        )
        if record.directory
        else None,
        clock=clock,
        notify=service_manager(),
        compensator=compensator,
        self_test=machine.self_test(),
        instance=instance,
        start=start,
        keeper=None if file is None else Keeper(file, ready.fit, config.checkpoint.period_s),
        renewals=renewals,
        compiler=ready.compiler(),
        alone=alone,
    )


def wires(config: Installation) -> dict[str, Any]:
    """Return what every device delivers in a few seconds. Raises `UserError` for a file it cannot use."""
    from drivers import open_driver
    from observer.service.one_look import look
    from observer.service.plausibility import Limits

    limits, column = Limits.of(config), {name: j for j, name in enumerate(config.channels)}

    def doubt(channel: str, value: float) -> str | None:
        return limits.doubt(column[channel], value) if channel in column else None

    return look([open_driver(key, settings) for key, settings in config.drivers.items()], doubt)


def _every_channel_has_a_driver(config: Installation) -> None:
    """Raise `ConfigError` where the model reads a channel that no driver delivers; a player delivers all."""
    offered: set[str] = set()
    for settings in config.drivers.values():
        if settings.kind == "player":
            return
        offered |= {settings.position_channel} if settings.kind == "canopen" else set(settings.channels)
    missing = [c for c in config.channels if c not in offered]
    if missing:
        raise ConfigError(
            f"drivers: no driver delivers {', '.join(missing)}; add the channel to a [drivers.…] table, or "
            "remove what reads it"
        )


def _can_be_made(recordings: Path) -> None:
    """Raise `ConfigError` where no recording can be written; a disk that fills up later is another matter."""
    from observer.files.folders import make_folder

    try:
        make_folder(recordings)
        tempfile.TemporaryFile(dir=recordings).close()
    except OSError as error:
        raise ConfigError(
            f"record.directory: {recordings} cannot be written ({error.strerror}); name another directory"
        ) from None


def replay(
    log_path: Path,
    config: Installation,
    output: Path,
    suffix: str,
    *,
    accept_truncated: bool = False,
    accept_damaged: bool = False,
    progress: Progress,
) -> dict[str, Any]:
    """Run a log through the live path; write estimates, `summary.json` and `overview.png` into `output`.

    Returns the summary. Raises `LogError` or `ConfigError`.
    """
    from observer.report.collect import Collector
    from observer.report.overview import write_overview
    from observer.service.checkpoint import Fit
    from observer.service.replay import estimates_of, start_of, write_results

    log = _recorded(log_path, config, accept_truncated=accept_truncated, accept_damaged=accept_damaged)
    machine = Machine.of(config)
    estimator = machine.estimator()
    start, told = start_of(log, Fit.of(config, machine.drive, estimator))
    collector = Collector(config)
    tee = _Tee(machine.drive)
    reasons: dict[str, int] = {}

    def blocks() -> Iterator[EstimateBlock]:
        self_test = machine.self_test()
        for block in estimates_of(
            log, machine.plan, tee, estimator, self_test, progress, reasons.__setitem__, start
        ):
            collector.add(tee.inputs, block)
            yield block

    more: dict[str, Any] = _verdicts(config, log) | _open_loop(machine, frames_of_log(log, machine.plan))
    more |= {
        "doubts": doubts(log, frames_of_log(log, machine.plan), config),
        "reasons": reasons,
        "start": told,
    }
    with results_in(output) as part:
        summary = write_results(part, suffix, estimator.layout, blocks(), log, config.digest, more)
        write_overview(part / "overview.png", config, collector.samples(), f"replay of {log_path.name}")
    return summary


def _recorded(path: Path, config: Installation, *, accept_truncated: bool, accept_damaged: bool) -> Log:
    """Read a log, or a recording of a CAN bus."""
    from observer.service.can_log import is_can_recording, read_can_log

    if is_can_recording(path):
        return read_can_log(path, config)
    return read_log(path, config.channels, accept_truncated=accept_truncated, accept_damaged=accept_damaged)


def identify(
    log_path: Path,
    config: Installation,
    output: Path,
    options: MethodOptions,
    *,
    accept_truncated: bool = False,
    accept_damaged: bool = False,
    progress: Callable[[str], None],
) -> dict[str, Any]:
    """Estimate the heats over a whole log at once; write `heat.csv`, `summary.json` and `heat.png`.

    Returns the summary. Raises `LogError`, `ConfigError` or `UserError`.
    """
    from observer.history.identify import heat_history
    from observer.report.heat_history import HistorySamples, write_heat_history
    from observer.service.identify import inputs_of, write_history

    options.check()
    progress("reading the log")
    log = _recorded(log_path, config, accept_truncated=accept_truncated, accept_damaged=accept_damaged)
    # no field is reported, so the inputs of a long log need not carry its rows
    ends_only = Output(positions_m=(0.0, config.screw.length_m))
    machine = Machine.of(config.model_copy(update={"output": ends_only}))
    blocks = inputs_of(log, machine.plan, machine.drive)
    progress(options.method)
    try:
        history = heat_history(machine.plant, config.estimator, blocks, options)
    except UserError as error:
        raise LogError(f"{log_path}: {error}") from None
    more = {"config": config.digest, "method": options.method} | _verdicts(config, log)
    more["doubts"] = doubts(log, frames_of_log(log, machine.plan), config)
    with results_in(output) as part:
        summary = write_history(part, machine.plant.layout, history, log, more)
        samples = HistorySamples.of(machine.plant.estimated, history, blocks)
        write_heat_history(
            part / "heat.png", config, samples, f"heats in {log_path.name}", f"by {options.method}"
        )
    return summary


class _Tee:
    """A drive that remembers the inputs it gave last."""

    def __init__(self, drive: Drive) -> None:
        self._drive = drive
        self.inputs: Inputs

    def initial(self) -> Any:
        """Give the state before the first frame."""
        return self._drive.initial()

    def run(self, state: Any, frames: FrameBlock) -> tuple[Any, Inputs]:
        """K steps."""
        state, self.inputs = self._drive.run(state, frames)
        return state, self.inputs


def _open_loop(machine: Machine, blocks: Iterator[FrameBlock]) -> dict[str, Any]:
    """Return how far the prediction by the heat laws alone is from each sensor, K rms."""
    squares = np.zeros(machine.plant.rows.sensors)
    count = np.zeros(machine.plant.rows.sensors)
    for inputs, rows in _predicted(machine, blocks):
        gap = np.where(inputs.usable, inputs.y_degC - rows[:, machine.plant.rows.sensor_slice], np.nan)
        squares += np.nansum(gap**2, axis=0)
        count += np.isfinite(gap).sum(axis=0)
    rms = {
        name: math.sqrt(s / n) if n else None
        for name, s, n in zip(machine.plant.layout.sensors, squares, count, strict=True)
    }
    return {"open_loop_rms_K": rms}


def _predicted(
    machine: Machine, blocks: Iterator[FrameBlock], start_degC: float | None = None
) -> Iterator[tuple[Inputs, FloatArray]]:
    """Simulate frames open loop, from the first frame at which every known input is known."""
    from observer.model.simulate import simulate, start, start_from_sensors

    plant = machine.plant
    drive_state, state = machine.drive.initial(), None
    for frames in blocks:
        drive_state, inputs = machine.drive.run(drive_state, frames)
        if state is None:
            first = np.flatnonzero(np.isfinite(inputs.z_end).all(axis=1))
            if not len(first):
                continue
            k = int(first[0])
            inputs = inputs.part(k)
            y = np.where(inputs.usable[0], inputs.y_degC[0], np.nan)
            if start_degC is None and np.isfinite(y).any():
                state = start_from_sensors(plant, y, plant.noise_R_K2, inputs.law_W[0], inputs.z_end[0])
            else:
                level = inputs.z_end[0, 0] if start_degC is None else start_degC
                state = start(plant, level, inputs.law_W[0])
        state, rows = simulate(plant, state, inputs)
        yield inputs, rows


def _verdicts(config: Installation, log: Log) -> dict[str, Any]:
    """Return, per moving source, whether the log tells the nut's path."""
    from observer.model.rod.moving import judge_path

    found = {}
    for source in config.source:
        if source.position_channel is not None:
            low, high = source.stroke_m or (0.0, config.screw.length_m)
            column = log.values[:, log.channels.index(source.position_channel)]
            found[source.name] = judge_path(column, high - low)
    return {"nut_path": found}


def simulate(
    program: Path, config: Installation, output: Path, start_degC: float | None, progress: Progress
) -> FloatArray:
    """Predict a run from the heat laws alone and write it as a log, with `overview.png` beside it.

    The program is a log of the input channels; where it also holds the sensors' channels, their first values
    give the initial field. Returns the last predicted sensor temperatures in °C.
    """
    from observer.files.writer import write_log
    from observer.report.collect import SimulationCollector
    from observer.report.overview import write_simulation_overview

    suffix_of(output)
    machine = Machine.of(config)
    log = _program(program, config)
    collector = SimulationCollector(config)
    parts: list[tuple[FloatArray, FloatArray, FloatArray]] = []
    done = 0
    for inputs, rows in _predicted(machine, frames_of_log(log, machine.plan), start_degC):
        collector.add(inputs, rows, machine.plant.rows)
        parts.append((inputs.time_s, inputs.law_W, rows))
        done += len(inputs)
        progress(done, len(log))
    if not parts:
        raise LogError(f"{program}: an input that the model needs never has a value; fill its column")
    time_s, law_W, rows = (np.concatenate(column) for column in zip(*parts, strict=True))
    title = f"open-loop prediction of {program.name}"
    with results_in(output.parent) as part:
        write_log(part / output.name, time_s, _simulated_columns(machine, log, time_s, law_W, rows))
        write_simulation_overview(part / "overview.png", config, collector.samples(), title)
    return np.asarray(rows[-1, machine.plant.rows.sensor_slice])


def _program(path: Path, config: Installation) -> Log:
    """Read a program; sensors that it does not hold count as missing."""
    sensors = {s.channel for s in config.sensor}
    log = read_log(path)
    needed = [c for c in config.channels if c not in sensors or c in log.channels]
    log = read_log(path, needed)
    values = {c: log.values[:, i] for i, c in enumerate(log.channels)}
    nothing = np.full(len(log), np.nan)
    return replace(
        log,
        channels=config.channels,
        values=np.column_stack([values.get(c, nothing) for c in config.channels]),
    )


def _simulated_columns(
    machine: Machine, log: Log, time_s: FloatArray, law_W: FloatArray, rows: FloatArray
) -> dict[str, FloatArray]:
    """The columns of a simulated log: sensors, inputs, heats, field, thermal error."""
    config, meaning, layout = machine.config, machine.plant.rows, machine.plant.layout
    sensors = {s.channel for s in config.sensor}
    columns = {s.channel: rows[:, i] for i, s in enumerate(config.sensor)}
    at = np.searchsorted(log.time_s, time_s)
    columns |= {c: log.values[at, i] for i, c in enumerate(log.channels) if c not in sensors}
    columns |= {f"heat_{name}_W": law_W[:, j] for j, name in enumerate(machine.plant.source_names)}
    places = [f"{1000 * x_m:.10g}" for x_m in layout.position_m]
    columns |= {f"field_{mm}_degC": rows[:, meaning.sensors + i] for i, mm in enumerate(places)}
    if layout.has_error:
        error_um = meaning.error_um(rows)
        columns |= {f"error_{mm}_um": error_um[:, i] for i, mm in enumerate(places)}
    return columns


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
    runs, odd = _runs(log_paths, config)
    with results_in(output) as part:
        found = fit(config, runs, lambda n, rms_K: progress(f"fit {n}: {rms_K:.4f} K rms"))
        progress("process noise by maximum likelihood")
        noise = fit_noise(found.config, runs)
        result = calibration_result(found, noise) | {"doubts": odd}
        text = write_back(config_path.read_text(encoding="utf-8"), found.values | noise)
        (part / "config.toml").write_text(text, encoding="utf-8")
        document = json.dumps(result, indent=2, allow_nan=False) + "\n"
        (part / "calibration.json").write_text(document, encoding="utf-8")
    return result


def _runs(log_paths: Sequence[Path], config: Installation) -> tuple[list[list[FrameBlock]], list[str]]:
    """The frames of each log, and what is doubtful about the logs' channels."""
    plan = AlignPlan.of(config)
    runs, odd = [], []
    for path in log_paths:
        log = read_log(path, config.channels)
        runs.append(list(frames_of_log(log, plan)))
        odd += [f"{path.name}: {sentence}" for sentence in doubts(log, runs[-1], config)]
    return runs, odd


def discover(
    config_path: Path,
    log_paths: Sequence[Path],
    output: Path,
    progress: Callable[[str, float], None],
    *,
    report: bool = True,
) -> tuple[Discovery, dict[str, Any]]:
    """Find the effect that the model lacks; write `result.json`, `report.html` and, if named, `config.toml`.

    Returns what was found, and the content of `result.json`.
    """
    from observer.discovery.discover import discover as find
    from observer.discovery.result import discovery_result
    from observer.installation.write_back import with_effects, write_back
    from observer.report.discovery import write_discovery_report

    config = load(config_path)
    progress("reading logs", 0.0)
    runs, odd = _runs(log_paths, config)
    with results_in(output) as part:
        found = find(config, runs, progress)
        result = discovery_result(found) | {"doubts": odd}
        if found.verdict.kind == "named":
            values = {key: entry["value"] for key, entry in result["calibrated"].items()}
            text = write_back(config_path.read_text(encoding="utf-8"), values)
            text = with_effects(text, found.verdict.fit.config.effect[len(config.effect) :])
            (part / "config.toml").write_text(text, encoding="utf-8")
        document = json.dumps(result, indent=2, allow_nan=False) + "\n"
        (part / "result.json").write_text(document, encoding="utf-8")
        if report:
            progress("writing the report", 0.97)
            write_discovery_report(part / "report.html", found, result, [path.name for path in log_paths])
    return found, result


def place(config: Installation, count: int, spacing_m: float | None) -> list[dict[str, Any]]:
    """Rank sensor sites: the best sets of 1 … `count` positions and how well they see."""
    from observer.estimators.design.placement import rank_sensor_sites

    length_m = config.screw.length_m
    points = 41 if spacing_m is None else max(2, round(length_m / spacing_m) + 1)
    positions_m = np.linspace(0.0, length_m, points)
    candidates = config.model_copy(
        update={
            "effect": tuple(e for e in config.effect if e.targets != "sensor"),
            "sensor": tuple(
                config.sensor[0].model_copy(
                    update={"name": f"c{i}", "channel": f"c{i}", "position_m": x, "on": None}
                )
                for i, x in enumerate(positions_m.tolist())
            ),
        }
    )
    plant = build_plant(candidates)
    sets = rank_sensor_sites(plant, plant.rows.C[plant.rows.sensor_slice], count)
    return [
        {
            "sensors": len(found.sites),
            "positions_m": sorted(round(float(positions_m[i]), 6) for i in found.sites),
            "score_K": found.score_K,
            "condition": found.condition,
        }
        for found in sets
    ]
