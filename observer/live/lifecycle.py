"""A service from its start to its end, through every renewal of its parts."""

from __future__ import annotations

import asyncio
import contextlib
import time
from collections.abc import Callable
from typing import Any

import structlog

from observer.live.loop import Service, serve
from observer.live.renewal import Renewal
from observer.live.wires import take_short_turns
from observer.process.memory import leave_in_peace
from observer.process.shutdown import StopSignals

log = structlog.get_logger()


def run(
    service: Service, seconds: float | None = None, anew: Callable[[Renewal[Any]], Service] | None = None
) -> None:
    """Run a service until SIGTERM, SIGINT or for `seconds` from its first tick on; to be called from the main
    thread.

    `anew` builds its parts for a renewal, where it can have one. After a signal the process is left by force,
    with the recording written, where the parts do not end in time. The caller should then `leave`, because a
    library's threads may hang at the interpreter's exit. Raises `UserError` where another service has the
    axis already.
    """
    end_s: float | None = None

    def left_s() -> float | None:
        """How long is left; the time begins when it is asked for first, for a network may take seconds."""
        nonlocal end_s
        if seconds is None:
            return None
        end_s = time.monotonic() + seconds if end_s is None else end_s
        return max(0.0, end_s - time.monotonic())

    def flush() -> None:
        service.recorder.close(0.1)

    take_short_turns()
    with StopSignals(flush) as signals:
        while True:
            renewal = asyncio.run(_until_ended(service, left_s, signals))
            if renewal is None or anew is None:
                return
            log.warning("begun anew", reason=renewal.reason)
            service = anew(renewal)


async def _until_ended(
    service: Service, left_s: Callable[[], float | None], signals: StopSignals
) -> Renewal[Any] | None:
    """Serve until a signal, until no time is left, or until a renewal is due, which is returned."""
    loop = asyncio.get_running_loop()

    def stop() -> None:
        with contextlib.suppress(RuntimeError):  # the loop has ended by itself
            loop.call_soon_threadsafe(task.cancel)

    def when_ready() -> None:
        leave_in_peace()
        if (seconds := left_s()) is not None:
            loop.call_later(seconds, stop)

    task = asyncio.ensure_future(serve(service, when_ready=when_ready))
    if service.renewals.can_reload:
        signals.when_asked(service.renewals.reload)
    signals.when_heard(stop)
    with contextlib.suppress(asyncio.CancelledError):
        return await task
    return None
