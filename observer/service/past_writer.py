"""Writes each step once it is published, in a thread of its own: a slow or full disk holds up nothing."""

from __future__ import annotations

import math
import re
import subprocess
import sys
import threading
import time
from collections import deque
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import structlog
from numpy.typing import NDArray

from observer.estimate.checkpoint import Snapshot
from observer.record.retention import STEPS_SUFFIX, recordings
from observer.record.step_columns import StepSource
from observer.record.step_files import StepAppender, hour_end_s
from observer.service.observers import Step, StepObserver

_RETRY_S = 1.0
_SETTLE_S = 20.0
"""A start is busy: only then the files of an earlier service are looked after."""
_SYNC_S = 5.0  # as often as the readings by default
_MOST_ROWS = 20_000

log = structlog.get_logger()


class PastWriter(StepObserver):
    """Appends every step to the file of its hour, and has closed hours packed.

    Steps wait in memory while the disk refuses them; beyond 20,000 the oldest are dropped. The next start
    makes them again from the readings. `follow` never blocks; a thread of its own writes, and a process of
    low priority packs.
    """

    def __init__(self, folder: Path, name: str, source: StepSource) -> None:
        self._source, self._files = source, StepAppender(folder, name, source)
        self._tend = (sys.executable, "-m", "observer.service.past_process", "tend", str(folder), name)
        self._folder, self._has_earlier = folder, False
        with suppress(OSError):  # there is no folder yet
            self._has_earlier = bool(recordings(folder, name, rf"(\.csv|{re.escape(STEPS_SUFFIX)})"))
        self._steps: deque[Step] = deque(maxlen=_MOST_ROWS)
        self._hour_s, self._tend_s = math.inf, time.monotonic() + _SETTLE_S
        self._reason: str | None = None
        self._tending: subprocess.Popen[bytes] | None = None
        self._closing, self._awake = threading.Event(), threading.Event()
        self._thread = threading.Thread(target=self._run, name="past", daemon=True)

    def begin(self) -> None:
        """Start the thread that writes; files that an earlier service left are tended 20 s later."""
        self._thread.start()

    def follow(self, step: Step) -> None:
        """Queue a step to be written; called by the loop after it is published."""
        self._steps.append(step)
        self._awake.set()

    def notices(self) -> tuple[str, ...]:
        """Return the reason why steps are not written at present, as at most one sentence with its remedy."""
        if not self._thread.is_alive() and not self._closing.is_set():
            return ("published steps: the thread that writes them has ended; restart the service",)
        return () if self._reason is None else (self._reason,)

    def finish(self, snapshot: Snapshot | None) -> None:
        """Tell the thread to write what waits and to end; returns at once.

        Args:
            snapshot: Not used here.
        """
        del snapshot
        self._closing.set()
        self._awake.set()

    def finished(self, timeout_s: float) -> str | None:
        """Wait until everything is written, and kill a packing that still runs.

        Returns:
            None, or a sentence if the thread does not end within `timeout_s`.
        """
        if self._thread.ident is not None:
            self._thread.join(timeout_s)
        if self._tending is not None and self._tending.poll() is None:
            self._tending.kill()
            self._tending.wait(timeout_s)
        if not self._thread.is_alive():
            return None
        return "the last published steps were not written in time; check the disk"

    def _run(self) -> None:
        rows: NDArray[Any] = np.zeros(0, self._source.dtype)
        synced_s = time.monotonic()
        while True:
            if self._reason is None:
                self._awake.wait()
            else:
                self._closing.wait(_RETRY_S)
            self._awake.clear()
            is_last = self._closing.is_set()
            steps = [self._steps.popleft() for _ in range(len(self._steps))]
            rows = np.concatenate([rows, *(self._row(step) for step in steps)])[-_MOST_ROWS:]
            try:
                while len(rows):
                    rows = rows[self._files.append(rows) :]
                if is_last or time.monotonic() - synced_s >= _SYNC_S:
                    self._files.sync()
                    synced_s = time.monotonic()
                self._reason = None
            except OSError as error:
                self._reason = (
                    f"{self._folder}: published steps cannot be written ({error.strerror}); "
                    "free space or repair it"
                )
            if steps:
                self._look_at_hour(float(steps[-1].frame.time_s[0]))
            if is_last:
                self._files.close()
                return

    def _row(self, step: Step) -> NDArray[Any]:
        return self._source.rows(step.frame, step.estimate, step.sequence)

    def _look_at_hour(self, time_s: float) -> None:
        """Have files tended when a new hour has begun, and some time after the start."""
        if time_s >= self._hour_s or (self._has_earlier and time.monotonic() >= self._tend_s):
            self._has_earlier = False
            self._start_tending()
        self._hour_s = hour_end_s(time_s)

    def _start_tending(self) -> None:
        if self._tending is not None:
            if self._tending.poll() is None:
                return
            if self._tending.returncode:
                log.warning("published steps could not be packed", exit_code=self._tending.returncode)
        devnull = subprocess.DEVNULL
        try:
            self._tending = subprocess.Popen(
                self._tend, stdin=devnull, stdout=devnull, stderr=devnull, start_new_session=True
            )
        except OSError as error:
            log.warning("published steps could not be packed", reason=error.strerror)
