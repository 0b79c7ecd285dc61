"""The service's side of its outlets: starts their process, a client of the bus, and never waits for it.

A process that ends or hangs is restarted; its problems are reasons in health only.
"""

from __future__ import annotations

import contextlib
import os
import subprocess
import sys
import threading
import time
from collections.abc import Mapping

import structlog
from pydantic import ValidationError

from observer.outlets.start import STATES, OutletState, Start

_RETRY_S = 1.0
_LOOK_S = 0.1
_START_LOOKS, _SILENT_LOOKS = 600, 100
"""Looks without a report before the process counts as frozen: 60 s for the first report, then 10 s."""
_ONE_HEAP = {"MALLOC_ARENA_MAX": "1"}
"""Else glibc gives each thread of Zenoh and of the outlets its own heap, together 15 MB."""

log = structlog.get_logger()


class OutletsProcess:
    """Keeps the process of the outlets running, and takes the states that it publishes."""

    def __init__(self, start: Start) -> None:
        """Take what the process is to serve."""
        self._start = start
        self._states: dict[str, OutletState] = {}
        self._ended: str | None = None
        self._child: subprocess.Popen[bytes] | None = None
        self._looks_left = 0
        self._closing = threading.Event()
        self._thread = threading.Thread(target=self._run, name="outlets", daemon=True)

    def start(self, endpoint: str) -> None:
        """Begin to start the process, a client of that endpoint; returns at once."""
        self._start = self._start.model_copy(update={"connect": endpoint})
        self._thread.start()

    @property
    def reason(self) -> str | None:
        """A problem of an outlet in one sentence; None without."""
        return self._ended or next((s.reason for s in self._states.values() if s.reason), None)

    @property
    def unsent(self) -> Mapping[str, Mapping[str, float]]:
        """The backlog of each outlet: the number of `steps` to send late, and the `duration_s` they span."""
        return {name: state.unsent for name, state in self._states.items() if state.unsent is not None}

    def take(self, report: bytes) -> None:
        """Take the states that the process has published."""
        try:
            states = STATES.validate_json(report)
        except ValidationError as error:
            log.warning("unexpected report of the outlets", reason=str(error))
            return
        before, self._states, self._ended = self._states, states, None
        self._looks_left = _SILENT_LOOKS
        for name, state in states.items():
            state.log_change(name, before.get(name))

    def close(self, timeout_s: float) -> bool:
        """End the process; returns False if it had to be killed after that time."""
        self._closing.set()
        if self._thread.ident is None:
            return True
        end_s = time.monotonic() + timeout_s
        self._thread.join(timeout_s / 2)
        child = self._child
        if child is None:
            return True
        try:
            child.wait(max(0.0, end_s - time.monotonic()))
        except subprocess.TimeoutExpired:
            child.kill()
            return False
        return True

    def _run(self) -> None:
        while not self._closing.is_set():
            try:
                reason = self._run_once()
            except OSError as error:
                reason = f"cannot be started ({error}); make room for one more process"
            if not self._closing.is_set():
                self._states = {}
                self._ended = f"outlets: the process of page and plant {reason}"
                self._closing.wait(_RETRY_S)

    def _run_once(self) -> str:
        """Start the process, and wait for its end or that of the service; kill it if it freezes.

        Returns what happened to it.
        """
        # in a session of its own: Ctrl-C is for the service, which then ends it
        with subprocess.Popen(
            (sys.executable, "-m", "observer.outlets"),
            stdin=subprocess.PIPE,
            stdout=subprocess.DEVNULL,
            bufsize=0,
            env=os.environ | _ONE_HEAP,
            start_new_session=True,
        ) as child:
            self._child = child
            assert child.stdin is not None
            with contextlib.suppress(OSError):  # it has ended
                child.stdin.write(self._start.model_dump_json().encode() + b"\n")
            self._looks_left = _START_LOOKS  # looks, not seconds: a service that was frozen itself waits on
            while child.poll() is None and not self._closing.wait(_LOOK_S):
                self._looks_left -= 1
                if self._looks_left < 0:
                    child.kill()
                    return "froze and is restarted; report it if it does so again"
        return "ended and is restarted; see the log lines before"
