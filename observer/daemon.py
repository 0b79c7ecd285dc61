"""The daemon's composition root: its parts put together, at the start and again where it is renewed."""

from __future__ import annotations

import secrets
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from observer.control.compensation import LATE_PERIODS, Compensator
from observer.control.steering import Steering
from observer.errors import ConfigError
from observer.estimate.checkpoint import CheckpointFit, Snapshot, pack, shifted
from observer.estimate.machine import Machine
from observer.estimators.protocol import Estimator
from observer.files.folders import refuse_unwritable
from observer.gateway.feed import Feed
from observer.gateway.start import Start
from observer.installation import Installation, load
from observer.live.forecasting import Forecaster, is_wanted
from observer.live.keeper import Keeper, carried, known_of_gap, stored
from observer.live.lifecycle import run
from observer.live.loop import Service, no_alarms
from observer.live.observers import AlarmObserver, StepObserver
from observer.live.renewal import Renewal, Renewals, carried_over
from observer.live.trial import AdoptionTrial
from observer.process.clock import ServiceClock
from observer.process.notify import service_manager
from observer.publish.codec import config_json
from observer.publish.session import refuse_taken
from observer.publish.zenoh import ZenohPublisher
from observer.quality.alarms import AlarmDesk
from observer.quality.gap import GapState
from observer.record.recorder import Recorder
from observer.record.retention import Retention, refuse_shared

_TRIAL_END_S = 0.2


def serve(config: Installation, seconds: float | None = None, path: Path | None = None) -> None:
    """Run the daemon until it is stopped; the caller leaves the process afterwards.

    With `path`, SIGHUP has the configuration read again from there.
    """
    refuse_taken(config.publish.listens, "publish.listen")
    ready, clock = _Ready.of(config), ServiceClock()
    if (folder := config.record.directory) is not None:
        refuse_shared(folder, f"{config.machine.name}-{config.machine.axis}")
    renewals: Renewals[_Ready] = Renewals(None if path is None else lambda: _reread(path, ready.config))
    trial = None if path is None else AdoptionTrial(path, renewals.reload)

    def anew(renewal: Renewal[_Ready]) -> Service:
        nonlocal ready, clock
        before, ready, snapshot = ready, renewal.prepared or ready, renewal.snapshot
        if renewal.new_time and snapshot is not None:
            snapshot = shifted(snapshot, clock.offset_s())
        clock = ServiceClock() if renewal.new_time else clock
        carry = carried(snapshot, before.fit, ready.fit, lambda: _over(renewal, before, ready))
        if trial is not None:
            trial.in_force(ready.config)
        return _service(ready, clock, renewals, trial, carry, alone=False, path=path)

    file = ready.config.checkpoint_file
    start = stored(file, ready.fit, clock.now(), config.checkpoint.oldest_s) if file is not None else None
    known = known_of_gap(file, ready.fit) if file is not None and start is None else None
    service = _service(ready, clock, renewals, trial, start, alone=True, known=known, path=path)
    if trial is None:
        run(service, seconds, anew)
        return
    trial.start(config)
    try:
        run(service, seconds, anew)
    finally:
        trial.close(_TRIAL_END_S)


def _over(renewal: Renewal[_Ready], before: _Ready, now: _Ready) -> Snapshot | None:
    """Where the service stands, for another model."""
    return carried_over(renewal.snapshot, renewal.last, before.machine, now.machine, now.estimator)


@dataclass(frozen=True, slots=True)
class _Ready:
    """A configuration for the daemon that has been checked, with what takes long to build."""

    config: Installation
    machine: Machine
    estimator: Estimator
    fit: CheckpointFit

    @classmethod
    def of(cls, config: Installation) -> _Ready:
        """Check and build. Raises `UserError`."""
        if problems := config.undelivered():
            raise ConfigError(problems[0])
        if config.record.directory is not None:
            refuse_unwritable(config.record.directory, "record.directory")
        machine = Machine.of(config, learns=True)
        estimator = machine.estimator()
        return cls(
            config, machine, estimator, CheckpointFit.of(config, machine.drive, estimator, machine.gap())
        )


def _reread(path: Path, now: Installation) -> _Ready:
    """Read, check and build a configuration beside the one that runs. Raises `UserError`."""
    config = load(path)
    refuse_taken(set(config.publish.listens) - set(now.publish.listens), "publish.listen")
    for key, settings in config.drivers.items():
        settings.open(key)
    return _Ready.of(config)


def _service(
    ready: _Ready,
    clock: ServiceClock,
    renewals: Renewals[_Ready],
    trial: AdoptionTrial | None,
    start: Snapshot | None,
    *,
    alone: bool,
    known: GapState | None = None,
    path: Path | None = None,
) -> Service:
    """Put the parts of the daemon together; `start` is where the estimator goes on from, None if cold.

    `alone` asks for nobody else to have the axis; `known` is what a cold start knows of the prediction's gap.
    """
    config, machine, estimator = ready.config, ready.machine, ready.estimator
    name, record, instance = config.machine, config.record, secrets.token_hex(4)
    held = None if start is None else start.compensation
    compensator = (
        Compensator(config, estimator.layout.position_m, instance, held)
        if config.compensation.enabled
        else None
    )
    file = ready.config.checkpoint_file
    gap = machine.gap()
    if gap is not None and known is not None:
        gap.restore(known)
    forecasts = is_wanted(machine)
    compensates = compensator is not None
    publisher = _publisher(ready, instance, path, compensates=compensates, forecasts=forecasts)
    observers: list[StepObserver] = []
    if file is not None:
        observers.append(Keeper(file, ready.fit, config.checkpoint.period_s))
    if trial is not None:
        observers.append(trial)
    desk = None
    if config.alarms.enabled:
        desk = AlarmDesk(config, machine.plant.layout, config.alarms, config.alarms_file)
        air = machine.plant.known.ambient
        observers.append(AlarmObserver(desk, partial(publisher.document, "alarms"), air, instance))
    if forecasts:
        observers.append(Forecaster(machine, instance, partial(publisher.document, "forecast")))
    return Service(
        drivers=tuple(settings.open(key) for key, settings in config.drivers.items()),
        plan=machine.plan,
        drive=machine.drive,
        estimator=estimator,
        publisher=publisher,
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
        renewals=renewals,
        alone=alone,
        gap=gap,
        control=_steering(config),
        sensors={sensor.channel: sensor.name for sensor in config.sensor},
        observers=tuple(observers),
        acknowledge=no_alarms if desk is None else desk.acknowledge,
    )


def _publisher(
    ready: _Ready, instance: str, path: Path | None, *, compensates: bool, forecasts: bool
) -> ZenohPublisher:
    """Zenoh, with a gateway beside it where the configuration asks for one."""
    config, name = ready.config, ready.config.machine
    in_force, start = config_json(config, instance), Start.of(config, path, forecasts=forecasts)
    return ZenohPublisher(
        name.name,
        name.axis,
        config.publish,
        in_force,
        ready.estimator.layout,
        instance,
        compensates=compensates,
        forecasts=forecasts,
        outlet=None if start is None else Feed(start, in_force.encode()),
    )


def _steering(config: Installation) -> Steering | None:
    """What writes the compensation to the control; None where no control is named."""
    settings = config.compensation
    if (at := settings.control) is None or not settings.enabled:
        return None
    from drivers.control_modbus import ModbusControlLink  # noqa: PLC0415  (the bus library only when it is used)

    control = ModbusControlLink(at.host, at.port, at.unit_id, at.first_register, at.timeout_s)
    return Steering(control, LATE_PERIODS * config.estimator.period_s)
