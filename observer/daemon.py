"""The daemon's composition root: puts its parts together, at the start and at each renewal."""

from __future__ import annotations

import asyncio
import contextlib
import secrets
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import structlog

from observer.archive.client import Archivist
from observer.control.compensation import CompensationState, plan_of, valid_s
from observer.control.compensator import Compensator
from observer.control.steering import NoControl, Steering
from observer.errors import ConfigError
from observer.estimate.checkpoint import CheckpointFit, Snapshot, pack, shifted
from observer.estimate.pipeline import MachineModel
from observer.files.folders import refuse_unwritable
from observer.gateway.feed import Feed
from observer.gateway.start import Start
from observer.installation import Installation, load
from observer.installation.adopt import record_of
from observer.live.forecasting import Forecaster, is_wanted
from observer.live.loop import Service
from observer.live.loop import serve as serve_parts
from observer.live.observers import AlarmObserver, CompensationObserver, Keeper, StepObserver, carried, stored
from observer.live.probing import ProbingAdvisor, is_advised
from observer.live.renewal import Renewal, Renewals, carried_over
from observer.live.wires import take_short_turns
from observer.live.zero_signal import ZeroSignal
from observer.process.clock import ServiceClock
from observer.process.memory import leave_in_peace
from observer.process.notify import service_manager
from observer.process.shutdown import StopSignals
from observer.publish.codec import config_json
from observer.publish.session import refuse_taken
from observer.publish.zenoh import ServiceIdentity, ZenohPublisher
from observer.quality.alarms import AlarmDesk
from observer.quality.gap import GapState
from observer.record.recorder import Companions, NoRecorder, Recorder
from observer.record.retention import Retention, refuse_shared

log = structlog.get_logger()


def serve(config: Installation, seconds: float | None = None, path: Path | None = None) -> None:
    """Run the daemon until it is stopped; the caller leaves the process afterwards.

    With `path`, SIGHUP reloads the configuration from there.
    """
    refuse_taken(config.publish.listens, "publish.listen")
    ready, clock = _Ready.of(config), ServiceClock()
    if (folder := config.record.directory) is not None:
        refuse_shared(folder, f"{config.machine.name}-{config.machine.axis}")
    desk = _alarm_desk(ready)
    renewals: Renewals[_Ready] = Renewals()
    if path is not None:
        renewals = Renewals(lambda: _reread(path, ready.config), record_of(path))

    def anew(renewal: Renewal[_Ready]) -> Service:
        nonlocal ready, clock, desk
        before, ready, snapshot = ready, renewal.prepared or ready, renewal.snapshot
        moved_s = clock.offset_s() if renewal.new_time else 0.0
        if renewal.new_time and snapshot is not None:
            snapshot = shifted(snapshot, moved_s)
        clock = ServiceClock() if renewal.new_time else clock
        desk = _alarm_desk(ready, None if desk is None else desk.kept(moved_s))
        compensation = None if snapshot is None else snapshot.compensation
        snapshot = carried(
            snapshot, before.fit, ready.fit,
            lambda: carried_over(renewal.snapshot, renewal.last, before.machine, ready.machine),
        )  # fmt: skip
        return _service(ready, clock, desk, renewals, _Start(snapshot, None, compensation, alone=False))

    start = _Start()
    if (file := config.checkpoint_file) is not None:
        start = _Start(*stored(file, ready.fit, clock.now(), config.checkpoint.oldest_s))
    run(_service(ready, clock, desk, renewals, start), seconds, anew)


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


def _reread(path: Path, now: Installation) -> _Ready:
    """Read, check and build a configuration beside the one that runs. Raises `UserError`."""
    config = load(path)
    refuse_taken(set(config.publish.listens) - set(now.publish.listens), "publish.listen")
    config.open_drivers()
    return _Ready.of(config)


@dataclass(frozen=True, slots=True)
class _Start:
    """The state from which a service continues: a snapshot, None for a cold start, which then has the state
    of the prediction's gap and of the compensation. `alone` requires that no other service has the axis.
    """

    snapshot: Snapshot | None = None
    gap: GapState | None = None
    compensation: CompensationState | None = None
    alone: bool = True


def _service(
    ready: _Ready, clock: ServiceClock, desk: AlarmDesk | None, renewals: Renewals[_Ready], start: _Start
) -> Service:
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
    if config.compensation.enabled:
        compensation = start.compensation
        if snapshot is not None and snapshot.compensation is not None:
            compensation = snapshot.compensation
        compensator = Compensator(config, machine.plant.layout.position_m, instance, compensation)
        observers.append(
            CompensationObserver(
                compensator,
                publish["compensation"],
                lambda: publisher.status.rival,
                _control(config),
                ZeroSignal.of(config),
            )
        )
    if config.checkpoint_file is not None:
        observers.append(Keeper(config.checkpoint_file, ready.fit, config.checkpoint.period_s))
    if desk is not None:
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
        renewals=renewals,
        alone=start.alone,
        sensors={sensor.channel: sensor.name for sensor in config.sensor},
        options=f"--machine {config.machine.name} --axis {config.machine.axis}",
        nut_channel=next((s.position_channel for s in config.source if s.position_channel), None),
    )


def _alarm_desk(ready: _Ready, kept: dict[str, Any] | None = None) -> AlarmDesk | None:
    """The desk of alarms, None where they are off; `kept` is the state of the one before."""
    config = ready.config
    if not config.alarms.enabled:
        return None
    return AlarmDesk(config, ready.machine.layout, config.alarms, config.alarms_file, kept)


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
    """Zenoh, with a gateway beside it where the configuration asks for one."""
    config, name, forecasts = ready.config, ready.config.machine, is_wanted(ready.machine)
    folder = config.record.directory
    in_force, start = config_json(config, instance), Start.of(config, forecasts=forecasts)
    offered = {
        "compensation": config.compensation.enabled,
        "forecast": forecasts,
        "probing": is_advised(config),
    }
    return ZenohPublisher(
        ServiceIdentity(name.name, name.axis, instance),
        config.publish,
        in_force,
        ready.machine.shown.layout(ready.machine.estimator().layout),
        offers=[key for key, runs in offered.items() if runs],
        outlet=None if start is None else Feed(start, in_force.encode()),
        past=None if folder is None else Archivist(in_force.encode(), folder),
    )


def _control(config: Installation) -> Steering | NoControl:
    """The writer of the compensation to the control, where one is configured."""
    if (at := config.compensation.control) is None:
        return NoControl()
    from drivers.control_modbus import ModbusControlLink  # noqa: PLC0415  (the bus library is imported only when it is used)

    link = ModbusControlLink(at.host, at.port, at.unit_id, at.first_register, at.timeout_s)
    return Steering(link, valid_s(plan_of(config)), at.follow_s)


def run(
    service: Service, seconds: float | None = None, anew: Callable[[Renewal[Any]], Service] | None = None
) -> None:
    """Run a service until SIGTERM, SIGINT or for `seconds` from its first tick on; to be called from the main
    thread.

    `anew` builds its parts for a renewal, where it can have one. After a signal the process is left by force,
    with the recording written, where the parts do not end in time. The caller should then `leave`, because a
    library's threads may hang at the interpreter's exit. Raises `UserError` where another service has the
    axis already.
    """
    end_s: float | None = None

    def left_s() -> float | None:
        """The time left; it starts at the first call, since a network may take seconds."""
        nonlocal end_s
        if seconds is None:
            return None
        end_s = time.monotonic() + seconds if end_s is None else end_s
        return max(0.0, end_s - time.monotonic())

    def flush() -> None:
        service.recorder.close(0.1)

    take_short_turns()
    with StopSignals(flush) as signals:
        while True:
            renewal = asyncio.run(_until_ended(service, left_s, signals))
            if renewal is None or anew is None:
                return
            log.warning("begun anew", reason=renewal.reason)
            service = anew(renewal)


async def _until_ended(
    service: Service, left_s: Callable[[], float | None], signals: StopSignals
) -> Renewal[Any] | None:
    """Serve until a signal, until no time is left, or until a renewal is due, which is returned."""
    loop = asyncio.get_running_loop()

    def stop() -> None:
        with contextlib.suppress(RuntimeError):  # the loop has ended by itself
            loop.call_soon_threadsafe(task.cancel)

    def when_ready() -> None:
        leave_in_peace()
        if (seconds := left_s()) is not None:
            loop.call_later(seconds, stop)

    task = asyncio.ensure_future(serve_parts(service, when_ready=when_ready))
    if service.renewals.can_reload:
        signals.when_asked(service.renewals.reload)
    signals.when_heard(stop)
    with contextlib.suppress(asyncio.CancelledError):
        return await task
    return None
