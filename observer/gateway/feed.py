"""The service's side of the gateway: starts its process, passes it every message, never waits for it.

A process that ends is restarted and gets the retained messages; its problems are reasons in health only.
"""

from __future__ import annotations

import contextlib
import json
import subprocess
import sys
import threading
import time
from collections import deque
from collections.abc import Mapping
from typing import IO, Any

import structlog

from observer.exchange import RETAINED, Command, Outcome, plain_name
from observer.gateway.messages import Pending
from observer.gateway.start import Start
from observer.process.pipes import framed

_RETRY_S = 1.0
_START = "start"

log = structlog.get_logger()


class Feed:
    """Passes every message to the gateway's process, of each key only the newest if it is slow."""

    def __init__(self, start: Start, config_json: bytes) -> None:
        """Take what the process is to serve, and the document `config`."""
        self._start = start
        self._known = {"config": config_json}
        self._awake = threading.Event()
        self._pending = Pending(self._awake.set)
        self._commands: deque[Command] = deque()
        self._reasons: dict[str, str] = {}
        self._unsent: dict[str, dict[str, float]] = {}
        self._child: subprocess.Popen[bytes] | None = None
        self._closing = threading.Event()
        self._thread = threading.Thread(target=self._run, name="gateway", daemon=True)

    def start(self) -> None:
        """Begin to start the process; returns at once."""
        self._thread.start()

    @property
    def reason(self) -> str | None:
        """A problem of an outlet in one sentence; None without."""
        return next(iter(self._reasons.values()), None)

    @property
    def unsent(self) -> Mapping[str, Mapping[str, float]]:
        """The backlog of each outlet: the number of `steps` to send late, and the `duration_s` they span."""
        return dict(self._unsent)

    def put(self, key: str, payload: bytes) -> None:
        """Pass a message on; never blocks."""
        if key in RETAINED:
            self._known[key] = payload
        self._pending.put(key, payload)

    def commands(self) -> list[Command]:
        """The commands received since the last call."""
        return [self._commands.popleft() for _ in range(len(self._commands))]

    def close(self, timeout_s: float) -> bool:
        """End the process; returns False if it had to be killed after that time."""
        self._closing.set()
        self._awake.set()
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
            # in a session of its own: Ctrl-C is for the service, which then ends it
            with subprocess.Popen(
                (sys.executable, "-m", "observer.gateway"),
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                bufsize=0,
                start_new_session=True,
            ) as child:
                self._child = child
                threading.Thread(target=self._listen, args=(child,), name="gateway-said", daemon=True).start()
                with contextlib.suppress(OSError):  # it has ended
                    self._serve(child)
                with contextlib.suppress(OSError):
                    assert child.stdin is not None
                    child.stdin.close()
            if not self._closing.is_set():
                self._reasons["gateway"] = (
                    "gateway: the process of page and plant ended and is restarted; see the log lines before"
                )
                self._closing.wait(_RETRY_S)

    def _serve(self, child: subprocess.Popen[bytes]) -> None:
        """Write what comes until closing; raises `OSError` once the process has ended."""
        assert child.stdin is not None
        _write(child, _START, self._start.model_dump_json().encode())
        for key, payload in list(self._known.items()):
            _write(child, key, payload)
        while not self._closing.is_set() and child.poll() is None:
            self._awake.wait(_RETRY_S)
            self._awake.clear()
            for key, payload in self._pending.take():
                _write(child, key, payload)

    def _listen(self, child: subprocess.Popen[bytes]) -> None:
        """Read the process's output, a line of JSON at a time, until it ends."""
        assert child.stdout is not None
        while line := _line_of(child.stdout):
            try:
                self._take(json.loads(line))
            except (ValueError, KeyError, TypeError) as error:
                log.warning("unexpected output of the gateway", line=line[:200], reason=str(error))

    def _take(self, report: dict[str, Any]) -> None:
        if "acknowledge" in report:
            by, alarm = plain_name(f"{report['by']}@page"), report["acknowledge"]
            self._commands.append(Command("acknowledge", by, time.monotonic(), _answered, None, alarm))
        elif "unsent" in report:
            self._unsent[report["outlet"]] = report["unsent"]
        elif "outlet" in report:
            self._reasons.pop("gateway", None)
            name, reason = report["outlet"], report["reason"]
            if reason is None:
                self._reasons.pop(name, None)
                log.info("outlet", name=name, address=report.get("address"))
                if doubt := report.get("doubt"):
                    log.warning("outlet", name=name, doubt=doubt)
            else:
                self._reasons[name] = reason


def _answered(outcome: Outcome) -> None:
    """Ignore the outcome: the next `alarms` document shows it."""


def _line_of(stdout: IO[bytes]) -> bytes:
    """The next line; nothing once the process has closed it, or somebody here has."""
    try:
        return stdout.readline()
    except (ValueError, OSError):
        return b""


def _write(child: subprocess.Popen[bytes], key: str, payload: bytes) -> None:
    data = memoryview(framed(key, payload))
    assert child.stdin is not None
    while data:
        data = data[child.stdin.write(data) :]
