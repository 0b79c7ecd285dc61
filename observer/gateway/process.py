"""The gateway's process: reads the service's messages from its standard input and serves every outlet that is
asked for, until that input closes.
"""

from __future__ import annotations

import asyncio
import importlib
import json
import sys
import threading
from collections.abc import Awaitable, Callable
from typing import Any

import structlog

from observer.errors import UserError
from observer.gateway.messages import Latest
from observer.gateway.start import OUTLETS, Say, Start
from observer.process.memory import leave_in_peace
from observer.process.messages import configure
from observer.process.pipes import messages
from observer.process.shutdown import leave

_RETRY_S = 1.0
log = structlog.get_logger()
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
    asyncio.run(_serve(start, incoming))
    leave(0)


async def _serve(start: Start, incoming: Any) -> None:
    loop, ended = asyncio.get_running_loop(), asyncio.Event()
    latest = Latest(start.period_s)

    def read() -> None:
        for key, payload in incoming:
            loop.call_soon_threadsafe(latest.put, key, payload)
        loop.call_soon_threadsafe(ended.set)

    threading.Thread(target=read, name="service", daemon=True).start()
    tasks = [
        asyncio.create_task(_supervised(name, start, latest))
        for name in OUTLETS
        if getattr(start, name) is not None
    ]
    await ended.wait()
    for task in tasks:
        task.cancel()
    await asyncio.wait(tasks, timeout=_RETRY_S)


async def _supervised(name: str, start: Start, latest: Latest) -> None:
    """Serve an outlet for ever; report why it fails, and retry."""
    said = False

    def say(more: dict[str, Any]) -> None:
        nonlocal said
        _say(name, more)
        if not said:  # its libraries are loaded by now
            leave_in_peace()
        said = True

    while True:
        reason = f"{name}: ended by itself"
        try:
            module, extra = _MODULES[name]
            serve: Callable[[Start, Latest, Say], Awaitable[None]] = importlib.import_module(module).serve
            await serve(start, latest, say)
        except ModuleNotFoundError as error:
            reason = f'{name}: {error.name} is missing; install it: pip install "ballscrew-observer[{extra}]"'
        except (OSError, UserError) as error:
            reason = f"{name}: {error}"
        except Exception as error:  # whatever it is, the others continue and health reports it
            log.error("an outlet failed", outlet=name, exc_info=True)
            reason = f"{name}: {type(error).__name__}: {error}"
        say({"reason": reason})
        await asyncio.sleep(_RETRY_S)


def _say(name: str, more: dict[str, Any]) -> None:
    """Report the state of an outlet to the service: a `reason`, None with its `address` once it serves; or
    what is `unsent`.
    """
    sys.stdout.write(json.dumps({"outlet": name, **more}) + "\n")
    sys.stdout.flush()
