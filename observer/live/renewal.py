"""Renewal of a service's parts: after a reloaded configuration, or a reset clock."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Generic, TypeVar

import numpy as np
import structlog

from observer.errors import UserError
from observer.estimate.checkpoint import Snapshot
from observer.estimate.pipeline import MachineModel
from observer.estimators.carry import carry_from, carry_into
from observer.estimators.protocol import CarriesOver
from observer.live.observers import Step
from observer.model.drive import DriveState
from observer.process.clock import stepped

SETTLED_S = 3.0
"""The new time of a reset clock is accepted once its offset has been stable for so long …"""
_SAME_S = 0.1
"""… to within this."""
LOOK_S = 2.0
"""Interval of looking for an adopted configuration."""
NOTICE_S = 600.0
"""A rejected configuration stays a reason in health for so long."""

Prepared = TypeVar("Prepared")
log = structlog.get_logger()


@dataclass(frozen=True, slots=True)
class Renewal(Generic[Prepared]):
    """Why the parts are rebuilt, with what, and their last state.

    `prepared` is what a configuration that was read again comes to, None for the one in force; `new_time`
    says that the service's time begins anew as well. `last` is the step before.
    """

    reason: str
    prepared: Prepared | None = None
    new_time: bool = False
    snapshot: Snapshot | None = None
    last: Step | None = None


class Renewals(Generic[Prepared]):
    """Watches for both; outlives the parts. `reload` may be called from any thread."""

    def __init__(
        self, reread: Callable[[], Prepared] | None = None, adoption_record: Path | None = None
    ) -> None:
        """Take the function that reloads and checks the configuration; it raises `UserError` for an invalid
        one. It is also called when the record of an adoption changes.
        """
        self._reread, self._record = reread, adoption_record
        self._recorded_ns = self._record_ns()
        self._asked = threading.Event()
        self._ready: Prepared | None = None
        self._refused: tuple[float, str] | None = None
        self._since_s: float | None = None
        self._offset_s = 0.0
        if reread is not None:
            threading.Thread(target=self._watch, args=(reread,), name="reload", daemon=True).start()

    @property
    def can_reload(self) -> bool:
        """Whether there is a configuration to reload."""
        return self._reread is not None

    def reload(self) -> None:
        """Reload the configuration, beside the running service; if asked meanwhile, once more."""
        self._asked.set()

    def _watch(self, reread: Callable[[], Prepared]) -> None:
        """Read the configuration when that is asked for, or when one was adopted or undone."""
        while True:
            asked = self._asked.wait(LOOK_S)
            recorded_ns, before_ns = self._record_ns(), self._recorded_ns
            self._recorded_ns = recorded_ns
            if asked or recorded_ns != before_ns:
                self._asked.clear()
                self._read(reread)

    def _record_ns(self) -> int | None:
        """When the record of the last adoption was written, None without one."""
        try:
            return None if self._record is None else self._record.stat().st_mtime_ns
        except OSError:
            return None

    def _read(self, reread: Callable[[], Prepared]) -> None:
        log.info("reading the configuration again")
        try:
            self._ready = reread()
            self._refused = None
        except UserError as error:
            self._refuse(str(error))
        except Exception as error:  # the service continues with what it has, whatever this is
            log.error("reading the configuration failed", exc_info=True)
            self._refuse(repr(error))

    def _refuse(self, why: str) -> None:
        self._refused = (time.monotonic(), why)
        log.error("configuration rejected; the one in force stays", reason=why)

    def due(self, now_s: float, offset_s: float) -> Renewal[Prepared] | None:
        """The renewal that is due at a time of the service, None if none is."""
        ready, self._ready = self._ready, None
        if ready is not None:
            return Renewal("the configuration was read again", ready)
        why = stepped(offset_s)
        if why is None:
            self._since_s = None
        elif self._since_s is None or abs(offset_s - self._offset_s) > _SAME_S:
            self._since_s, self._offset_s = now_s, offset_s
        elif now_s - self._since_s >= SETTLED_S:
            self._since_s = None
            return Renewal(why, new_time=True)
        return None

    def notices(self) -> tuple[str, ...]:
        """Reasons for health."""
        if self._refused is None or time.monotonic() - self._refused[0] > NOTICE_S:
            return ()
        return (f"the new configuration was rejected, the old one is in force: {self._refused[1]}",)


def carried_over(
    snapshot: Snapshot | None, last: Step | None, before: MachineModel, now: MachineModel
) -> Snapshot | None:
    """A snapshot for another model of the same screw: its field and heats with their σ.

    What had been learnt of the old model starts again, and so do the watch over its gap and everything
    counted from a start. None where nothing was known yet, where the two models have nothing in common, or
    where one of the estimators has states of its own.
    """
    estimator = now.estimator()
    if not (isinstance(before.estimator(), CarriesOver) and isinstance(estimator, CarriesOver)):
        return None
    if snapshot is None or last is None or not set(now.config.channels) <= set(last.frame.channels):
        return None
    known = carry_from(before.plant, snapshot.estimator, last.inputs, last.estimate)
    if known is None:
        return None
    drive_state, inputs = now.drive.run(now.drive.initial(), last.frame)
    state = carry_into(now.plant, estimator, known, inputs)
    if state is None or not (np.isfinite(state.x_hat).all() and np.isfinite(state.P).all()):
        return None
    return replace(snapshot, drive=_with_paths(drive_state, snapshot.drive), estimator=state, gap=None)


def _with_paths(drive: DriveState, before: DriveState) -> DriveState:
    """The memory of nuts' paths, where the nuts and the number of states are the same."""
    if [len(nut.B) for nut in drive.nuts] != [len(nut.B) for nut in before.nuts]:
        return drive
    return replace(drive, nuts=before.nuts, turns=before.turns)
