"""The messages of the bus on their way to outlets: of each key the newest."""

from __future__ import annotations

import asyncio
import json
import threading
import time
from collections.abc import AsyncIterator, Callable
from typing import Any

from observer.bus.codec import decode_estimate

Message = tuple[str, bytes]


class Pending:
    """Messages waiting for a slower reader: of each key the newest only, so that the wait is bounded.

    `put` may be called from any thread; `wake` is called when messages begin to wait, and must not block.
    """

    def __init__(self, wake: Callable[[], object]) -> None:
        self._wake = wake
        self._lock = threading.Lock()
        self._newest: dict[str, bytes] = {}

    def put(self, key: str, payload: bytes) -> None:
        """Add a message; it replaces one of the same key that still waits."""
        with self._lock:
            is_first = not self._newest
            self._newest.pop(key, None)
            self._newest[key] = payload
        if is_first:
            self._wake()

    def take(self) -> list[Message]:
        """Remove and return what waits, in order of arrival."""
        with self._lock:
            waiting, self._newest = list(self._newest.items()), {}
        return waiting


_STALE_PERIODS = 2.0
_DELAY_S = 0.3  # between two processes on a busy computer


class Latest:
    """The newest message of every key, bytes as on Zenoh, and its listeners.

    `put` may be called from any thread, the rest from one event loop.
    """

    def __init__(self, period_s: float, clock: Callable[[], float] = time.monotonic) -> None:
        self._stale_s = _STALE_PERIODS * period_s + _DELAY_S
        self._clock = clock
        self._lock = threading.Lock()
        self._payloads: dict[str, bytes] = {}
        self._listeners: set[Pending] = set()
        self._heard_s = clock()

    def put(self, key: str, payload: bytes) -> None:
        """Store a message and pass it to all listeners; a slow one gets only the newest of each key."""
        if key == "estimate":
            self._heard_s = self._clock()
        with self._lock:
            self._payloads[key] = payload
            for listener in self._listeners:
                listener.put(key, payload)

    def forget(self) -> None:
        """Drop all messages; listeners get an empty payload for each key that had one."""
        with self._lock:
            for listener in self._listeners:
                for key in self._payloads:
                    listener.put(key, b"")
            self._payloads.clear()

    @property
    def is_stale(self) -> bool:
        """Whether no estimate has come for two periods: the service is silent, frozen or gone."""
        return self._clock() - self._heard_s > self._stale_s

    def payload(self, key: str) -> bytes | None:
        """The newest payload of a key, None before the first."""
        return self._payloads.get(key)

    def document(self, key: str) -> dict[str, Any]:
        """The newest document of a key, decoded; empty before the first."""
        payload = self._payloads.get(key)
        if payload is None:
            return {}
        decoded: dict[str, Any] = decode_estimate(payload) if key == "estimate" else json.loads(payload)
        return decoded

    async def messages(self) -> AsyncIterator[Message]:
        """Yield the stored messages, then new ones as they arrive; an empty payload where one is dropped."""
        awake, loop = asyncio.Event(), asyncio.get_running_loop()
        pending = Pending(lambda: loop.call_soon_threadsafe(awake.set))
        with self._lock:
            for message in self._payloads.items():
                pending.put(*message)
            self._listeners.add(pending)
        try:
            while await awake.wait():
                awake.clear()
                for message in pending.take():
                    yield message
        finally:
            with self._lock:
                self._listeners.discard(pending)
