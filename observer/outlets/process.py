"""The process of the outlets: serves each of them from the bus, in an event loop of its own."""

from __future__ import annotations

import asyncio
import importlib
import shutil
import signal
import sys
import threading
import time
from collections.abc import Awaitable, Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

import structlog

from observer.bus.session import LOCAL
from observer.config.outlets import ReportState
from observer.config.outside import fault_outside
from observer.errors import UserError, extra_remedy
from observer.outlets.bus import Bus
from observer.outlets.messages import Latest
from observer.outlets.start import Start
from observer.process.memory import leave_in_peace
from observer.process.messages import configure
from observer.process.shutdown import leave

_RETRY_S = 1.0
_BUS_END_S = 0.3
log = structlog.get_logger()
_Serve = Callable[[Start, Latest, ReportState], Awaitable[None]]
_MODULES = {
    "page": ("observer.outlets.page", "page"),
    "metrics": ("observer.outlets.metrics", "plant"),
    "mqtt": ("observer.outlets.mqtt", "plant"),
    "opcua": ("observer.outlets.opcua", "plant"),
}
_ENDING = {signal.SIGTERM, signal.SIGINT, signal.SIGHUP}


def main() -> None:
    """Serve what the first line of the standard input says, until that input closes.

    A service manager signals every process of a service; the service then closes the input.
    """
    for number in _ENDING:
        signal.signal(number, signal.SIG_IGN)
    configure(as_json=False)
    if line := sys.stdin.buffer.readline():
        start = Start.model_validate_json(line)
        _serve(start, sys.stdin.buffer.read, reports=True)
        kind, _, socket = start.connect.partition("/")
        if kind == LOCAL:  # of a service that was killed
            shutil.rmtree(Path(socket).parent, ignore_errors=True)
    leave(0)


def serve_until_signal(start: Start) -> None:
    """Serve outlets until SIGTERM, SIGHUP or Ctrl-C; log their states."""
    signal.pthread_sigmask(signal.SIG_BLOCK, _ENDING)
    configure(as_json=False)
    _serve(start, lambda: signal.sigwait(_ENDING), reports=False)
    leave(0)


def _serve(start: Start, wait: Callable[[], object], *, reports: bool) -> None:
    """Serve until `wait` returns."""
    latests = {name: Latest(start.period_s) for name in start.names}

    def put(key: str, payload: bytes) -> None:
        for latest in latests.values():
            latest.put(key, payload)

    def forget() -> None:
        for latest in latests.values():
            latest.forget()

    bus = Bus(start, put, forget, reports=reports)
    outlets = [_Outlet(name, start, latest, bus) for name, latest in latests.items()]
    bus.start()
    wait()
    for outlet in outlets:
        outlet.end()
    end_s = time.monotonic() + _RETRY_S
    for outlet in outlets:
        outlet.join(max(0.0, end_s - time.monotonic()))
    bus.close(_BUS_END_S)


class _Outlet(threading.Thread):
    """An outlet in an event loop of its own, so that a busy one delays no other."""

    def __init__(self, name: str, start: Start, latest: Latest, bus: Bus) -> None:
        """Begin to serve an outlet."""
        super().__init__(name=name, daemon=True)
        self._loop = asyncio.new_event_loop()
        report_state = _reporting(name, bus)
        self._task = self._loop.create_task(_supervised(name, start, latest, report_state))
        self.start()

    def run(self) -> None:
        """Serve until `end`."""
        with suppress(asyncio.CancelledError):
            self._loop.run_until_complete(self._task)

    def end(self) -> None:
        """Begin to end; `join` waits for it."""
        self._loop.call_soon_threadsafe(self._task.cancel)


def _reporting(name: str, bus: Bus) -> ReportState:
    """Return the function that reports the state of an outlet."""
    has_reported = False

    def report_state(changes: dict[str, Any]) -> None:
        nonlocal has_reported
        bus.report(name, changes)
        if not has_reported:  # its libraries are loaded by now
            leave_in_peace()
        has_reported = True

    return report_state


async def _supervised(name: str, start: Start, latest: Latest, report_state: ReportState) -> None:
    """Serve an outlet for ever; report why it fails, and retry."""
    module, extra = _MODULES.get(name, (None, None))
    while True:
        reason = f"{name}: ended by itself"
        try:
            if module is None:
                await start.also[name].serve(start.prefix, latest, report_state)
            else:
                serve: _Serve = importlib.import_module(module).serve
                await serve(start, latest, report_state)
        except ModuleNotFoundError as error:
            remedy = "install it" if extra is None else extra_remedy(extra)
            reason = f"{name}: {error.name} is missing; {remedy}"
        except (OSError, UserError) as error:
            reason = f"{name}: {error}"
        except Exception as error:  # whatever it is, the others continue and health reports it
            log.error("an outlet failed", outlet=name, exc_info=True)
            reason = f"{name}: {fault_outside(error) or f'{type(error).__name__}: {error}'}"
        report_state({"reason": reason})
        await asyncio.sleep(_RETRY_S)
