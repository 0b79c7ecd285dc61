"""What a client of the OPC UA server may take: by asyncua's own settings, and where it has none, by these.

asyncua 2.1 keeps what comes before it looks how long a message may be, and what is answered for as long as it
is not taken; it lets whoever has no session yet ask without end.
"""

from __future__ import annotations

from asyncio import BaseTransport
from typing import Any

from asyncua.common.connection import TransportLimits
from asyncua.common.utils import Buffer
from asyncua.server import binary_server_asyncio
from asyncua.server.server import Server

_CHUNK = 65535
_MOST_BYTES = 512 * 1024
"""Of a message: a question for some ten thousand values. Chunks have 8 kB or more (part 6, 6.7.2)."""
_MOST_CONNECTIONS = 100
_ACTIVE_WITHIN_S = 10.0
_MOST_WAITING = 8  # connections of one address without a session
_MOST_ASKED = 32  # messages before a session is active; a client takes some five
_MOST_UNREAD = 4_000_000  # bytes of answers that a client has not taken when it asks for more
_PIECE = 8192  # each message is kept with the rest of what it came with


def bound(server: Server) -> None:
    """Set the bounds of a server that has not been started."""
    server.limits = TransportLimits(_CHUNK, _CHUNK, _MOST_BYTES // 8192, _MOST_BYTES)
    server.iserver.max_connections = _MOST_CONNECTIONS
    server.iserver.max_pending_activation_seconds = _ACTIVE_WITHIN_S
    binary_server_asyncio.OPCUAProtocol = _Connection  # type: ignore[misc]  # it has no setting for that


class _Connection(binary_server_asyncio.OPCUAProtocol):
    """A connection that is closed where its client takes too much."""

    _asked = 0

    def connection_made(self, transport: BaseTransport) -> None:
        """Take a connection; where an address has many without a session, the oldest of them make room."""
        peer = transport.get_extra_info("peername")
        ours = [c for c in self.clients if isinstance(c, _Connection) and c.peer_name[0] == peer[0]]
        waiting = [c for c in ours if not c._is_active]
        for connection in waiting[: max(0, len(waiting) - _MOST_WAITING + 1)]:
            connection._abort()
        super().connection_made(transport)

    def data_received(self, data: bytes) -> None:
        """Take what has come, and no more than a chunk of what is not yet a message."""
        for start in range(0, len(data), _PIECE):
            super().data_received(data[start : start + _PIECE])
            if len(self._buffer) > _CHUNK + _PIECE:
                self._abort()
            if self.transport is None or self.transport.is_closing():
                return

    async def _process_one_msg(self, header: Any, buf: Buffer) -> bool:
        if not self._is_active:
            self._asked += 1
        if self._asked > _MOST_ASKED or self._unread() > _MOST_UNREAD:
            self._abort()
            return False
        return await super()._process_one_msg(header, buf)

    @property
    def _is_active(self) -> bool:
        session = None if self.processor is None else self.processor.session
        return session is not None and session.is_activated()

    def _unread(self) -> int:
        return 0 if self.transport is None else self.transport.get_write_buffer_size()

    def _abort(self) -> None:
        if self.transport is not None:
            self.transport.abort()
