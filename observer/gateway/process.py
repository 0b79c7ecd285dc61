"""The gateway's process: reads the service's messages from its standard input and serves every outlet that is
asked for, until that input closes.
"""

from __future__ import annotations

import asyncio
import importlib
import sys
import threading
import time
from collections.abc import Awaitable, Callable
from contextlib import suppress
from typing import Any

import structlog

from observer.errors import UserError
from observer.gateway.messages import Latest
from observer.gateway.start import OUTLETS, ReportState, Start, tell_service
from observer.process.memory import leave_in_peace
from observer.process.messages import configure
from observer.process.pipes import messages
from observer.process.shutdown import leave

_RETRY_S = 1.0
log = structlog.get_logger()
_Serve = Callable[[Start, Latest, ReportState], Awaitable[None]]
_MODULES = {
    "page": ("observer.page.outlet", "page"),
    "metrics": ("observer.gateway.metrics", "plant"),
    "mqtt": ("observer.gateway.mqtt", "plant"),
    "opcua": ("observer.gateway.opcua", "plant"),
}


def main() -> None:
    """Serve until the standard input closes."""
    configure(as_json=False)
    incoming = messages(sys.stdin.buffer.read)
    first = next(incoming, None)
    if first is None:
        leave(0)
    start = Start.model_validate_json(first[1])
    outlets = [_Outlet(name, start) for name in OUTLETS if getattr(start, name) is not None]
    for key, payload in incoming:
        for outlet in outlets:
            outlet.put(key, payload)
    for outlet in outlets:
        outlet.end()
    end_s = time.monotonic() + _RETRY_S
    for outlet in outlets:
        outlet.join(max(0.0, end_s - time.monotonic()))
    leave(0)


class _Outlet(threading.Thread):
    """An outlet in an event loop of its own, so that a busy one delays no other."""

    def __init__(self, name: str, start: Start) -> None:
        """Begin to serve an outlet."""
        super().__init__(name=name, daemon=True)
        self._loop = asyncio.new_event_loop()
        self._latest = Latest(start.period_s)
        self._task = self._loop.create_task(_supervised(name, start, self._latest))
        self.start()

    def run(self) -> None:
        """Serve until `end`."""
        with suppress(asyncio.CancelledError):
            self._loop.run_until_complete(self._task)

    def put(self, key: str, payload: bytes) -> None:
        """Pass a message of the service on."""
        self._loop.call_soon_threadsafe(self._latest.put, key, payload)

    def end(self) -> None:
        """Begin to end; `join` waits for it."""
        self._loop.call_soon_threadsafe(self._task.cancel)


async def _supervised(name: str, start: Start, latest: Latest) -> None:
    """Serve an outlet for ever; report why it fails, and retry."""
    has_reported = False

    def report_state(document: dict[str, Any]) -> None:
        nonlocal has_reported
        tell_service({"outlet": name, **document})
        if not has_reported:  # its libraries are loaded by now
            leave_in_peace()
        has_reported = True

    while True:
        reason = f"{name}: ended by itself"
        try:
            module, extra = _MODULES[name]
            serve: _Serve = importlib.import_module(module).serve
            await serve(start, latest, report_state)
        except ModuleNotFoundError as error:
            reason = f'{name}: {error.name} is missing; install it: pip install "ballscrew-observer[{extra}]"'
        except (OSError, UserError) as error:
            reason = f"{name}: {error}"
        except Exception as error:  # whatever it is, the others continue and health reports it
            log.error("an outlet failed", outlet=name, exc_info=True)
            reason = f"{name}: {type(error).__name__}: {error}"
        report_state({"reason": reason})
        await asyncio.sleep(_RETRY_S)
