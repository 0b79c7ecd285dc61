"""Connections of browsers, and how long one may be without a whole request.

uvicorn closes a connection that is idle after an answer, and none whose request never ends; at its limit it
refuses whoever comes, be it the only one who asks.
"""

from __future__ import annotations

import asyncio

from uvicorn.protocols.http.h11_impl import H11Protocol

_WITHIN_S = 10.0
_MOST_WAITING = 100


class Connection(H11Protocol):
    """A connection that is closed where its request does not come in time, or others wait for its place."""

    _since_s = 0.0
    _late: asyncio.TimerHandle | None = None

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """Take a connection; where many are without a whole request, the oldest of them makes room."""
        waiting = [c for c in self.connections if isinstance(c, Connection) and c.is_waiting]
        if len(waiting) >= _MOST_WAITING:
            min(waiting, key=lambda connection: connection._since_s).transport.abort()
        super().connection_made(transport)
        self._begin_to_wait()

    def connection_lost(self, exc: Exception | None) -> None:
        """Forget the connection."""
        super().connection_lost(exc)
        if self._late is not None:
            self._late.cancel()

    def on_response_complete(self) -> None:
        """Wait for the next request."""
        self._begin_to_wait()
        super().on_response_complete()

    @property
    def is_waiting(self) -> bool:
        """Whether it is open and has no whole request that is not answered."""
        asked = self.cycle is not None and not self.cycle.response_complete and not self.cycle.more_body
        return not asked and not self.transport.is_closing()

    def _begin_to_wait(self) -> None:
        if self._late is not None:
            self._late.cancel()
        self._since_s = self.loop.time()
        self._late = self.loop.call_later(_WITHIN_S, self._end_if_waiting)

    def _end_if_waiting(self) -> None:
        if self.is_waiting:
            self.transport.abort()
