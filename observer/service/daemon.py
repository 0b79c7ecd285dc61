"""The daemon's composition root: puts its parts together."""

from __future__ import annotations

import asyncio
import contextlib
import json
import secrets
import time
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import structlog

from observer.bus.codec import config_json
from observer.bus.session import refuse_taken
from observer.bus.zenoh import ServiceIdentity, ZenohPublisher
from observer.control.compensation import CompensationState, plan_of, valid_s
from observer.control.compensator import Compensator
from observer.control.steering import NoControl, Steering
from observer.errors import ConfigError
from observer.estimate.checkpoint import CheckpointFit, Snapshot, pack
from observer.estimate.pipeline import MachineModel
from observer.files.folders import refuse_unwritable
from observer.files.regular import read_toml
from observer.installation import Installation, parse
from observer.installation.adopt import record_of
from observer.outlets.beside import OutletsProcess
from observer.outlets.start import Start
from observer.process.clock import ServiceClock
from observer.process.memory import leave_in_peace
from observer.process.notify import service_manager
from observer.process.restart import Restart, execute_anew, restarted
from observer.process.shutdown import StopSignals
from observer.quality.alarms import AlarmDesk
from observer.quality.gap import GapState
from observer.record.asking import PastProcess
from observer.record.recorder import Companions, NoRecorder, Recorder
from observer.record.retention import Retention, refuse_shared
from observer.record.step_columns import StepSource
from observer.service.forecasting import Forecaster, is_wanted
from observer.service.loop import Service
from observer.service.loop import serve as serve_parts
from observer.service.observers import AlarmObserver, CompensationObserver, Keeper, StepObserver, stored
from observer.service.past_writer import PastWriter
from observer.service.probing import ProbingAdvisor, is_advised
from observer.service.restarts import Restarts
from observer.service.wires import take_short_turns
from observer.service.zero_signal import ZeroSignal

log = structlog.get_logger()


def serve_file(path: Path, seconds: float | None = None) -> None:
    """Run the daemon with a configuration file until it is stopped, as `serve`.

    The process is executed anew when SIGHUP asks to read the file again, when a configuration was adopted,
    and when the computer's clock was set. The new process gets the checked configuration.

    Args:
        path: The configuration.
        seconds: Ends the service so long after its first tick; None for no limit.

    Raises:
        UserError: The configuration cannot be used, or a port or the axis is taken.
    """
    restart = restarted()
    table = read_toml(path) if restart is None else restart.table
    config = parse(table, str(path))
    restarts = Restarts(lambda: _checked(path, config), table, record_of(path))
    if restart is not None:
        log.warning("begun anew", reason=restart.reason)
        seconds = None if restart.ends_s is None else max(0.0, restart.ends_s - time.monotonic())
        if restart.reload_pending:
            restarts.reload()
    serve(config, seconds, restarts, restart)


def serve(
    config: Installation,
    seconds: float | None = None,
    restarts: Restarts | None = None,
    restart: Restart | None = None,
) -> None:
    """Run the daemon until it is stopped; the caller leaves the process afterwards.

    Args:
        config: A checked configuration.
        seconds: Ends the service so long after its first tick; None for no limit.
        restarts: Decides when the process is executed anew; None for never.
        restart: Why this process was; None for a first start.

    Raises:
        UserError: A port is taken, a channel has no driver, or the folder for recordings cannot be written or
            is in use. Also if another service has the axis.
    """
    refuse_taken(config.publish.listens, "publish.listen")
    ready, clock = _Ready.of(config), ServiceClock()
    if (folder := config.record.directory) is not None:
        refuse_shared(folder, f"{config.machine.name}-{config.machine.axis}")
    start = _Start(restart=restart)
    if (file := config.checkpoint_file) is not None:
        state = stored(file, ready.fit, clock.now(), config.checkpoint.oldest_s, ready.machine)
        start = _Start(*state, restart)
    run(_service(ready, clock, restarts, start), seconds)


@dataclass(frozen=True, slots=True)
class _Ready:
    """A checked configuration for the daemon, with the parts that take long to build."""

    config: Installation
    machine: MachineModel
    fit: CheckpointFit

    @classmethod
    def of(cls, config: Installation) -> _Ready:
        """Check and build. Raises `UserError`."""
        if problems := config.undelivered():
            raise ConfigError(problems[0])
        if config.record.directory is not None:
            refuse_unwritable(config.record.directory, "record.directory")
        machine = MachineModel.of(config, learns=True)
        return cls(config, machine, CheckpointFit.of(machine))


def _checked(path: Path, in_force: Installation) -> dict[str, Any]:
    """The table of a configuration file with which a service can run. Raises `UserError`."""
    table = read_toml(path)
    config = parse(table, str(path))
    refuse_taken(set(config.publish.listens) - set(in_force.publish.listens), "publish.listen")
    config.open_drivers()
    _Ready.of(config)
    return table


@dataclass(frozen=True, slots=True)
class _Start:
    """The state from which a service continues.

    A cold start has no snapshot, but the state of the prediction's gap and of the compensation. `restart` has
    the reason if the process was executed anew.
    """

    snapshot: Snapshot | None = None
    gap: GapState | None = None
    compensation: CompensationState | None = None
    restart: Restart | None = None


def _service(ready: _Ready, clock: ServiceClock, restarts: Restarts | None, start: _Start) -> Service:
    """Put the parts of the daemon together."""
    config, machine, pipeline = ready.config, ready.machine, ready.machine.pipeline()
    instance, snapshot = secrets.token_hex(4), start.snapshot
    if pipeline.gap is not None and start.gap is not None:
        pipeline.gap.restore(start.gap)
    publisher = _publisher(ready, instance)
    publish = {
        key: partial(publisher.document, key) for key in ("alarms", "compensation", "forecast", "probing")
    }
    observers: list[StepObserver] = []
    if (folder := config.record.directory) is not None:
        document = json.loads(config_json(config, instance))
        source = StepSource(machine.layout, machine.plan.channels, document)
        observers.append(PastWriter(folder, f"{config.machine.name}-{config.machine.axis}", source))
    if config.compensation.enabled:
        compensation = start.compensation
        if snapshot is not None and snapshot.compensation is not None:
            compensation = snapshot.compensation
        compensator = Compensator(config, machine.plant.layout.position_m, instance, compensation)
        observers.append(
            CompensationObserver(
                compensator,
                publish["compensation"],
                lambda: publisher.status.duplicate,
                _control(config),
                ZeroSignal.of(config),
            )
        )
    if config.checkpoint_file is not None:
        observers.append(Keeper(config.checkpoint_file, ready.fit, config.checkpoint.period_s, machine))
    if config.alarms.enabled:
        desk = AlarmDesk(config, machine.layout, config.alarms, config.alarms_file)
        air = machine.plant.known.ambient
        observers.append(AlarmObserver(desk, publish["alarms"], air, instance))
    if is_wanted(machine):
        observers.append(Forecaster(machine, instance, publish["forecast"]))
    if is_advised(config):
        observers.append(ProbingAdvisor(config, machine.plant, instance, publish["probing"]))
    return Service(
        drivers=config.open_drivers(),
        plan=machine.plan,
        pipeline=pipeline,
        publisher=publisher,
        clock=clock,
        notify=service_manager(),
        recorder=_recorder(ready, snapshot, instance),
        observers=tuple(observers),
        instance=instance,
        start=snapshot,
        restarts=restarts,
        restarted=None if start.restart is None else start.restart.document(),
        alone=start.restart is None,
        sensors={sensor.channel: sensor.name for sensor in config.sensor},
        options=f"--machine {config.machine.name} --axis {config.machine.axis}",
        nut_channel=next((s.position_channel for s in config.source if s.position_channel), None),
    )


def _recorder(ready: _Ready, start: Snapshot | None, instance: str) -> Recorder | NoRecorder:
    """The recorder, from `start` on, where a folder is given."""
    name, record = ready.config.machine, ready.config.record
    if record.directory is None:
        return NoRecorder()
    return Recorder(
        record.directory,
        f"{name.name}-{name.axis}",
        ready.config.channels,
        int(record.rotate_MB * 1e6),
        record.sync_s,
        Retention.of(record),
        Companions(
            start=None if start is None else pack(start, ready.fit),
            config=config_json(ready.config, instance).encode(),
            pack=partial(pack, fit=ready.fit),
        ),
    )


def _publisher(ready: _Ready, instance: str) -> ZenohPublisher:
    """Zenoh, with the process of the outlets beside it where the configuration asks for one."""
    config, name, forecasts = ready.config, ready.config.machine, is_wanted(ready.machine)
    folder = config.record.directory
    start = Start.of(config) if config.outlets.start else None
    offered = {
        "compensation": config.compensation.enabled,
        "forecast": forecasts,
        "probing": is_advised(config),
    }
    return ZenohPublisher(
        ServiceIdentity(name.name, name.axis, instance),
        config.publish,
        config_json(config, instance),
        ready.machine.shown.layout(ready.machine.estimator().layout),
        offers=[key for key, runs in offered.items() if runs],
        outlets=None if start is None else OutletsProcess(start),
        past=None
        if folder is None
        else PastProcess(folder, f"{name.name}-{name.axis}", config.digest, config.estimator.period_s),
    )


def _control(config: Installation) -> Steering | NoControl:
    """The writer of the compensation to the control, where one is configured."""
    if (at := config.compensation.control) is None:
        return NoControl()
    from drivers.control_modbus import ModbusControlLink  # noqa: PLC0415  (the bus library is imported only when it is used)

    link = ModbusControlLink(at.host, at.port, at.unit_id, at.first_register, at.timeout_s)
    return Steering(link, valid_s(plan_of(config)), at.follow_s)


def run(service: Service, seconds: float | None = None) -> None:
    """Run a service until SIGTERM, SIGINT or for `seconds` from its first tick on.

    To be called from the main thread. After a signal the process is left by force, with the recording
    written, where the parts do not end in time. Where a restart is due, the process is executed anew. The
    caller should then `leave`, because a library's threads may hang at the interpreter's exit.

    Args:
        service: The parts, not yet started.
        seconds: None for no limit.

    Raises:
        UserError: Another service has the axis already.
    """
    take_short_turns()
    with StopSignals(lambda: service.recorder.close(0.1)) as signals:
        restart = asyncio.run(_until_ended(service, seconds, signals))
        if restart is not None and not signals.heard:
            execute_anew(restart)


async def _until_ended(service: Service, seconds: float | None, signals: StopSignals) -> Restart | None:
    """Serve until a signal, until no time is left, or until a restart is due, which is returned.

    The time counts from the first tick, since a network may take seconds.
    """
    loop, restarts, ends_s = asyncio.get_running_loop(), service.restarts, None

    def stop() -> None:
        with contextlib.suppress(RuntimeError):  # the loop has ended by itself
            loop.call_soon_threadsafe(task.cancel)

    def when_ready() -> None:
        nonlocal ends_s
        leave_in_peace()
        if seconds is not None:
            ends_s = time.monotonic() + seconds
            loop.call_later(seconds, stop)

    task = asyncio.ensure_future(serve_parts(service, when_ready=when_ready))
    if restarts is not None:
        signals.when_asked(restarts.reload)
    signals.when_heard(stop)
    with contextlib.suppress(asyncio.CancelledError):
        reason = await task
        if restarts is not None:
            return Restart(reason, time.time(), restarts.table, restarts.reload_pending, ends_s)
    return None
