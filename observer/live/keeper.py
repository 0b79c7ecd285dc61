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


def stored(
    path: Path, fit: CheckpointFit, now_s: float, oldest_s: float
) -> tuple[Snapshot | None, GapState | None]:
    """Where the service stood when it ran last, None for a cold start; the log says which and why.

    Beside it what was known of the prediction's gap then, however long ago; None if nothing.
    """
    gap: GapState | None = None
    try:
        snapshot = load(path, fit)
        gap = None if snapshot.gap is None else replace(snapshot.gap, time_s=math.nan)
        recent(snapshot, now_s, oldest_s)
    except UnfitError as error:
        log.warning("cold start", checkpoint=str(path), reason=str(error))
        return None, gap
    log.info("warm start", checkpoint=str(path), age_s=round(now_s - snapshot.tick_s, 3))
    return snapshot, snapshot.gap


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
    """Writes the newest snapshot to one file, at most every `period_s`, and the last one at the end.

    Each is written in a thread of its own; a period in which the one before is not written yet is left out.
    """

    def __init__(self, path: Path, fit: CheckpointFit, period_s: float) -> None:
        self._path, self._fit, self._period_s = path, fit, period_s
        self._given_s = -math.inf
        self._writing = threading.Thread()
        self._reason: str | None = None

    def follow(self, step: Step) -> None:
        """Write where the service stands after a step, if it is time again."""
        if step.now_s - self._given_s >= self._period_s and not self._writing.is_alive():
            self._given_s = step.now_s
            self.finish(step.snapshot())

    def notices(self) -> tuple[str, ...]:
        """Why the last checkpoint could not be written."""
        return (f"checkpoint: {self._reason}",) if self._reason else ()

    def finish(self, snapshot: Snapshot | None) -> None:
        """Begin to write a snapshot."""
        if snapshot is not None:
            args = (snapshot, self._writing)
            self._writing = threading.Thread(target=self._write, args=args, name="checkpoint", daemon=True)
            self._writing.start()

    def finished(self) -> str | None:
        """Wait until the last snapshot is on the disk."""
        if self._writing.is_alive():
            self._writing.join(_END_S)
        return "the last checkpoint could not be written in time" if self._writing.is_alive() else None

    def _write(self, snapshot: Snapshot, before: threading.Thread) -> None:
        if before.is_alive():
            before.join()
        try:
            make_folder(self._path.parent)
            write_whole(self._path, pack(snapshot, self._fit))
            self._reason = None
        except OSError as error:
            self._reason = f"{self._path}: cannot be written ({error.strerror}); free space or repair it"
        except Exception as error:  # a defect: the service goes on, and health says that it cannot be resumed
            self._reason = f"{self._path}: cannot be written ({error!r}); report this"
            log.error("checkpoint failed", exc_info=True)
