"""Queries the archive's process, which starts on demand and ends after a minute without queries."""

from __future__ import annotations

import json
import subprocess
import sys
import threading
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import structlog

from observer.exchange import PastReply
from observer.process.pipes import framed, messages

FOUND, REFUSED, UNFINISHED = "found", "refused", "unfinished"
"""What answers begin with."""
_IDLE_S = 60.0
_PATIENCE_S = 30.0
_MOST_WAITING = 4
_END_S = 1.0

log = structlog.get_logger()


class Archivist:
    """Queries the past of an axis; from any thread, one query at a time."""

    def __init__(self, config_json: bytes, recordings: Path) -> None:
        """Take the document `config` and the folder of the recordings."""
        document = json.loads(config_json) | {"recordings": str(recordings)}
        self._start = framed("start", json.dumps(document).encode())
        self._lock, self._waiting = threading.Lock(), threading.BoundedSemaphore(_MOST_WAITING)
        self._child: subprocess.Popen[bytes] | None = None
        self._idle: threading.Timer | None = None
        self._is_closed = False

    def ask(self, what: str, question: Mapping[str, Any]) -> PastReply:
        """Ask, and wait for the answer."""
        if not self._waiting.acquire(blocking=False):
            return PastReply(b"", "too many requests at once; ask again in a second", unfinished=True)
        try:
            with self._lock:
                return self._ask(framed(what, json.dumps(question).encode()))
        finally:
            self._waiting.release()

    def close(self) -> None:
        """End the process."""
        self._is_closed = True
        if (child := self._child) is not None:
            child.kill()
        if self._idle is not None:
            self._idle.cancel()
        if self._lock.acquire(timeout=_END_S):  # a query that waits gets its refusal first
            try:
                if self._child is not None:
                    self._end(self._child)
            finally:
                self._lock.release()

    def _ask(self, question: bytes) -> PastReply:
        if self._is_closed:
            return PastReply(b"", "the service ends", unfinished=True)
        if self._idle is not None:
            self._idle.cancel()
        child = self._child
        if child is not None and child.poll() is not None:
            self._report_end(child)
            child = None
        if child is None:
            self._child = child = subprocess.Popen(
                (sys.executable, "-m", "observer.archive"),
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                start_new_session=True,
            )
            question = self._start + question
        assert child.stdin is not None
        assert child.stdout is not None
        is_late = threading.Event()

        def give_up() -> None:
            is_late.set()
            child.kill()

        late = threading.Timer(_PATIENCE_S, give_up)
        late.start()
        try:
            child.stdin.write(question)
            child.stdin.flush()
            found = next(messages(child.stdout.read), None)
        except OSError:
            found = None
        finally:
            late.cancel()
        if found is None:
            if is_late.is_set():
                self._end(child)
                return PastReply(b"", "the recordings could not be read in time; ask again, or for less")
            self._report_end(child)
            reason = (
                "the process that reads the recordings ended and is started again; ask again, or for less"
            )
            return PastReply(b"", reason)
        self._idle = threading.Timer(_IDLE_S, self._end_idle, (child,))
        self._idle.daemon = True
        self._idle.start()
        kind, payload = found
        return PastReply(payload) if kind == FOUND else PastReply(b"", payload.decode(), kind == UNFINISHED)

    def _report_end(self, child: subprocess.Popen[bytes]) -> None:
        """Release a process that ended by itself; the next query starts another one."""
        self._end(child)
        if not self._is_closed:
            log.warning("the process that reads the recordings ended", exit_code=child.returncode)

    def _end_idle(self, child: subprocess.Popen[bytes]) -> None:
        with self._lock:
            if self._idle is threading.current_thread():
                self._end(child)

    def _end(self, child: subprocess.Popen[bytes]) -> None:
        child.kill()
        child.wait()
        self._child = None
        for pipe in (child.stdin, child.stdout):
            if pipe is not None:
                pipe.close()
