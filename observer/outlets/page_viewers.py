"""Server-sent events for any number of viewers: each is encoded once for all, and a slow viewer gets the
newest of each kind. A plain `StreamingResponse` does: sse-starlette's events and pings are per viewer.
"""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Callable

from starlette.responses import StreamingResponse
from starlette.types import Receive, Scope, Send

from observer.outlets.messages import Pending

_TOGETHER_S = 0.02  # the messages of one step arrive within this
_MOST_VIEWERS = 60


def event(name: str, data: bytes) -> bytes:
    """A server-sent event; JSON as the service writes it has no line breaks."""
    return b"event: " + name.encode() + b"\ndata: " + data + b"\n\n"


class Viewers:
    """The viewers of an axis; a viewer who joins late gets the newest event of each kind."""

    def __init__(self) -> None:
        self._newest: dict[str, bytes] = {}
        self._viewers: set[Pending] = set()
        self._ended = False

    def join(self) -> EventResponse | None:
        """The answer for one more viewer, whose place is taken at once; None where all are taken."""
        if len(self._viewers) >= _MOST_VIEWERS:
            return None
        awake = asyncio.Event()
        pending = Pending(awake.set)
        for key, data in self._newest.items():
            pending.put(key, data)
        self._viewers.add(pending)
        return EventResponse(self._events(pending, awake), lambda: self._viewers.discard(pending))

    def send(self, key: str, data: bytes) -> None:
        """Send an event, as bytes of its stream, to all viewers."""
        self._newest[key] = data
        for viewer in self._viewers:
            viewer.put(key, data)

    def forget(self, key: str) -> None:
        """Send `null` as the event of a kind; viewers who join later get nothing of it."""
        self.send(key, event(key, b"null"))
        del self._newest[key]

    def end(self) -> None:
        """End every viewer's events, so that the server can end too."""
        self._ended = True
        self.send("end", b"")

    async def _events(self, pending: Pending, awake: asyncio.Event) -> AsyncIterator[bytes]:
        """The newest event of each kind, then new ones."""
        while await awake.wait():
            if self._ended:
                return
            await asyncio.sleep(_TOGETHER_S)
            awake.clear()
            yield b"".join(data for _, data in pending.take())


class EventResponse(StreamingResponse):
    """The events for one viewer; `leave` is called at the end, even if no event was sent."""

    def __init__(self, events: AsyncIterator[bytes], leave: Callable[[], None]) -> None:
        super().__init__(events, media_type="text/event-stream")
        self._leave = leave

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Send the events."""
        try:
            await super().__call__(scope, receive, send)
        finally:
            self._leave()
