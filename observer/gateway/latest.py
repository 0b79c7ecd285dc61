"""The newest message of every key, and who wants to hear of new ones."""

from __future__ import annotations

import asyncio
import json
import time
from collections.abc import AsyncIterator, Callable
from typing import Any

from observer.gateway.pending import Message, Pending
from observer.publish.codec import decode_estimate

_STALE_PERIODS = 2.0
_SLACK_S = 0.3  # between two processes on a busy computer


class Latest:
    """What the service said last, by key: bytes as on Zenoh. For one event loop."""

    def __init__(self, period_s: float, clock: Callable[[], float] = time.monotonic) -> None:
        self._stale_s = _STALE_PERIODS * period_s + _SLACK_S
        self._clock = clock
        self._payloads: dict[str, bytes] = {}
        self._listeners: set[Pending] = set()
        self._heard_s = clock()

    def put(self, key: str, payload: bytes) -> None:
        """Take a message and hand it to all who listen; who is behind gets the newest of each key only."""
        if key == "estimate":
            self._heard_s = self._clock()
        self._payloads[key] = payload
        for listener in self._listeners:
            listener.put(key, payload)

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

    def keys(self) -> tuple[str, ...]:
        """The keys that have come."""
        return tuple(self._payloads)

    async def messages(self) -> AsyncIterator[Message]:
        """Give what is there, then what is new as it comes."""
        awake = asyncio.Event()
        pending = Pending(awake.set)
        for message in self._payloads.items():
            pending.put(*message)
        self._listeners.add(pending)
        try:
            while await awake.wait():
                awake.clear()
                for message in pending.take():
                    yield message
        finally:
            self._listeners.discard(pending)
