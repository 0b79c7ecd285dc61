"""What viewers are told as it happens: each message encoded once as an event, and of each kind the newest to
a viewer who is behind.
"""

from __future__ import annotations

import asyncio
import json
import math
import time
from collections.abc import AsyncIterator, Callable, Mapping
from typing import Any

from observer.gateway.latest import Latest
from observer.gateway.pending import Pending
from observer.gateway.start import Start
from observer.page.innovations import Innovations
from observer.page.recent import Recent
from observer.publish.codec import decode_estimate

_BEAT_S = 1.0
_AGAIN = b"retry: 1000\n\n"
"""A browser that has lost the page's process tries again each second; by itself it would each third."""
_TOGETHER_S = 0.02  # what belongs to one step comes within
_LEAST_S = {"estimate": 0.09, "heat": 0.09, "readings": 0.09, "field": 0.45, "error": 0.45}
"""Between two events of a kind, in s: ten a second, and two of what is long."""
_KEPT = ("time_s", "sequence", "instance", "quality", "sources", "law_W", "sensors", "sensor_quality")
_DIGITS = 6
_MOST_VIEWERS = 60


class Stream:
    """Events for any number of viewers; `run` feeds it."""

    def __init__(
        self,
        latest: Latest,
        start: Start,
        login: bool = False,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._latest = latest
        self._clock = clock
        hello = start.model_dump(include={"machine", "axis", "period_s", "laws", "forecast_s"})
        hello["login"] = login
        self._newest: dict[str, bytes] = {"hello": event("hello", json.dumps(hello).encode()) + _AGAIN}
        self._sent_s: dict[str, float] = {}
        self._viewers: set[Pending] = set()
        self._ended = False
        self._innovations = Innovations()
        self.recent = Recent()

    @property
    def is_full(self) -> bool:
        """Whether there are as many viewers as are served."""
        return len(self._viewers) >= _MOST_VIEWERS

    async def run(self) -> None:
        """Take the service's messages as they come, for ever, and tell each second that the page lives."""
        beating = asyncio.create_task(self._beat())
        try:
            async for key, payload in self._latest.messages():
                self.take(key, payload)
        finally:
            beating.cancel()

    def take(self, key: str, payload: bytes) -> None:
        """Hand a message on, unless one of its kind went out just now."""
        now_s = self._clock()
        try:
            estimate = decode_estimate(payload) if key == "estimate" else None
            if estimate is not None:
                self._innovations.take(estimate)
            if now_s - self._sent_s.get(key, -math.inf) < _LEAST_S.get(key, 0.0):
                return
            data = payload if estimate is None else shown(estimate, self._innovations)
            self.recent.take(key, data)
        except ValueError:
            return  # not of this version; what the page knows goes stale, and says so
        self._sent_s[key] = now_s
        self._tell(key, event(key, data))

    def end(self) -> None:
        """End what every viewer is told, so that the server can end too."""
        self._ended = True
        self._tell("end", b"")

    async def viewer(self) -> AsyncIterator[bytes]:
        """The events for one viewer: what is there, then what is new."""
        awake = asyncio.Event()
        pending = Pending(awake.set)
        for key, data in self._newest.items():
            pending.put(key, data)
        self._viewers.add(pending)
        try:
            while await awake.wait():
                if self._ended:
                    return
                await asyncio.sleep(_TOGETHER_S)
                awake.clear()
                yield b"".join(data for _, data in pending.take())
        finally:
            self._viewers.discard(pending)

    async def _beat(self) -> None:
        while True:
            self._tell("beat", event("beat", json.dumps({"stale": self._latest.is_stale}).encode()))
            await asyncio.sleep(_BEAT_S)

    def _tell(self, key: str, data: bytes) -> None:
        self._newest[key] = data
        for viewer in self._viewers:
            viewer.put(key, data)


def event(name: str, data: bytes) -> bytes:
    """A server-sent event; JSON as the service writes it has no line breaks."""
    return b"event: " + name.encode() + b"\ndata: " + data + b"\n\n"


def shown(estimate: Mapping[str, Any], innovations: Innovations) -> bytes:
    """What the page shows of an estimate, with the last innovation of each sensor, as JSON."""
    kept = {key: _plain(estimate[key]) for key in _KEPT if key in estimate}
    return json.dumps({**kept, "innovations": innovations.document(estimate["time_s"])}).encode()


def _plain(value: Any) -> Any:
    if not hasattr(value, "tolist"):
        return value
    return [round(x, _DIGITS) if math.isfinite(x) else None for x in value.tolist()]
