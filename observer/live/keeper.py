"""Leaves a checkpoint on the disk now and then, in a thread of its own: a slow disk holds up no tick."""

from __future__ import annotations

import math
import threading
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import structlog

from observer.estimate.checkpoint import CheckpointFit, Snapshot, UnfitError, load, pack, recent, unpack
from observer.files.folders import make_folder, write_whole
from observer.live.observers import Step, StepObserver
from observer.quality.gap import GapState

_END_S = 0.1

log = structlog.get_logger()


def stored(path: Path, fit: CheckpointFit, now_s: float, oldest_s: float) -> Snapshot | None:
    """Where the service stood when it ran last, None for a cold start; the log says which and why."""
    try:
        snapshot = recent(load(path, fit), now_s, oldest_s)
    except UnfitError as error:
        log.warning("cold start", checkpoint=str(path), reason=str(error))
        return None
    log.info("warm start", checkpoint=str(path), age_s=round(now_s - snapshot.tick_s, 3))
    return snapshot


def known_of_gap(path: Path, fit: CheckpointFit) -> GapState | None:
    """What was known of the prediction's gap when the service ran last, however long ago; None if nothing."""
    try:
        gap = load(path, fit).gap
    except UnfitError:
        return None
    return None if gap is None else replace(gap, time_s=math.nan)


def carried(
    snapshot: Snapshot | None,
    before: CheckpointFit,
    now: CheckpointFit,
    over: Callable[[], Snapshot | None] = lambda: None,
) -> Snapshot | None:
    """A snapshot for parts that are built anew, None where there is no way; the log says why.

    `over` carries it over where it is of another model.
    """
    if snapshot is None:
        return None
    try:
        if before.plant == now.plant:
            return unpack(pack(snapshot, before), now)
        if (other := over()) is None:
            raise UnfitError("another configuration of the machine, with which it has nothing in common")
        found = unpack(pack(other, replace(now, setup=before.setup)), now)
    except UnfitError as error:
        log.warning("cold start", reason=str(error))
        return None
    log.info("field and heats are carried over into another model of the screw")
    return found


class Keeper(StepObserver):
    """Writes the newest snapshot to one file, at most every `period_s`, and the last one at the end."""

    def __init__(self, path: Path, fit: CheckpointFit, period_s: float) -> None:
        self._path = path
        self._fit = fit
        self._period_s = period_s
        self._given_s = -math.inf
        self._changed = threading.Condition()
        self._newest: Snapshot | None = None
        self._closing = False
        self.reason: str | None = None
        self._thread = threading.Thread(target=self._supervised, name="checkpoint", daemon=True)
        self._thread.start()

    @property
    def alive(self) -> bool:  # type: ignore[override]
        """Whether the thread that writes is there."""
        return self._thread.is_alive()

    def follow(self, step: Step) -> None:
        """Take where the service stands after a step, if it is time again."""
        self.step(step.snapshot, step.now_s)

    def notices(self) -> tuple[str, ...]:
        """Why the last checkpoint could not be written."""
        return (f"checkpoint: {self.reason}",) if self.reason else ()

    def finish(self, snapshot: Snapshot | None) -> None:
        """Take the last snapshot."""
        self.end(snapshot)

    def finished(self) -> str | None:
        """Wait until it is on the disk."""
        return None if self.close(_END_S) else "the last checkpoint could not be written in time"

    def step(self, snapshot: Callable[[], Snapshot | None], now_s: float) -> None:
        """Take a snapshot if it is time again."""
        if now_s - self._given_s >= self._period_s:
            self._given_s = now_s
            self._give(snapshot(), closing=False)

    def end(self, snapshot: Snapshot | None) -> None:
        """Take where the service stands at its end, which is written at once."""
        self._give(snapshot, closing=True)

    def close(self, timeout_s: float) -> bool:
        """Wait until all is written after `end`; says whether it was in that time."""
        self._give(None, closing=True)
        self._thread.join(timeout_s)
        return not self._thread.is_alive()

    def _give(self, snapshot: Snapshot | None, *, closing: bool) -> None:
        with self._changed:
            self._newest = snapshot or self._newest
            self._closing |= closing
            self._changed.notify()

    def _supervised(self) -> None:
        """Write until closed; a defect in here is reported and ends the thread, which `alive` shows."""
        try:
            self._run()
        except Exception as error:  # whatever it is, health and watchdog are to know
            self.reason = f"the thread that writes has ended ({error!r}); restart the service"
            log.error("checkpoints ended", exc_info=True)

    def _run(self) -> None:
        while True:
            with self._changed:
                self._changed.wait_for(lambda: self._newest is not None or self._closing)
                newest, self._newest, closing = self._newest, None, self._closing
            if newest is not None:
                self._write(newest)
            elif closing:
                return

    def _write(self, snapshot: Snapshot) -> None:
        try:
            make_folder(self._path.parent)
            write_whole(self._path, pack(snapshot, self._fit))
            self.reason = None
        except OSError as error:
            self.reason = f"{self._path}: cannot be written ({error.strerror}); free space or repair it"
