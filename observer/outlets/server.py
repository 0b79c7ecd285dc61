"""The HTTP server of page and metrics: where it listens, its connections, and why it cannot serve.

uvicorn closes a connection that is idle after an answer, but not one whose request never ends. At its limit
it refuses every newcomer. `Connection` bounds the time to a whole request and makes room.
"""

from __future__ import annotations

import asyncio
import contextlib
import errno
import socket
import ssl
from collections.abc import AsyncIterator, Iterator
from pathlib import Path
from typing import Any

import uvicorn
from uvicorn.protocols.http.h11_impl import H11Protocol

from observer.config.outlets import host_and_port
from observer.errors import ConfigError

_END_S = 0.8
_BACKLOG = 1024
_MOST_CONNECTIONS = 200
_WITHIN_S = 10.0
_MOST_WAITING = 100


@contextlib.asynccontextmanager
async def served(
    app: Any, table: str, listen: str, certificate: Path | None = None, key: Path | None = None
) -> AsyncIterator[asyncio.Task[None]]:
    """Serve an ASGI application while the context lasts; yields the task that ends if the server does.

    Raises `OSError` or `ConfigError` with one sentence that names a key of `table` if it cannot.
    """
    config = uvicorn.Config(
        app,
        http=Connection,
        log_config=None,
        access_log=False,
        lifespan="off",
        ws="none",
        server_header=False,
        limit_concurrency=_MOST_CONNECTIONS,
        ssl_certfile=None if certificate is None else str(certificate),
        ssl_keyfile=None if key is None else str(key),
    )
    try:
        if certificate is not None:
            # without a passphrase callback OpenSSL would read one from the standard input
            ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER).load_cert_chain(certificate, key, lambda: "")
        config.load()
    except (OSError, ssl.SSLError) as error:
        raise ConfigError(
            f"{certificate}: cannot be used as a certificate ({error}); name PEM files that belong "
            f"together in {table}.certificate and {table}.key, the key without a passphrase"
        ) from None
    with _bound(listen, table) as bound:
        server = _Server(config)
        serving = asyncio.create_task(server.serve([bound]))
        try:
            yield serving
        finally:
            server.should_exit = True
            await asyncio.wait([serving], timeout=_END_S)
            server.force_exit = True
            serving.cancel()


class _Server(uvicorn.Server):
    """A server that leaves the signals to the process it runs in."""

    @contextlib.contextmanager
    def capture_signals(self) -> Iterator[None]:
        yield


@contextlib.contextmanager
def _bound(listen: str, table: str) -> Iterator[socket.socket]:
    """A socket that listens at an address; raises `OSError` with the remedy if that fails."""
    host, port = host_and_port(listen)
    try:
        addresses = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)
        family, kind, protocol, _, address = addresses[0]
        with socket.socket(family, kind, protocol) as bound:
            bound.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            bound.bind(address)
            bound.listen(_BACKLOG)  # clients that connect before the server has started wait
            yield bound
    except OSError as error:
        if error.errno == errno.EADDRINUSE:
            raise OSError(f"another program listens on {listen}; stop it or change {table}.listen") from None
        if error.errno in {errno.EADDRNOTAVAIL, errno.EACCES} or isinstance(error, socket.gaierror):
            raise OSError(f"cannot listen on {listen} ({error.strerror}); change {table}.listen") from None
        raise


class Connection(H11Protocol):
    """A connection that is closed if its request does not arrive in time or others need its place."""

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
        has_request = self.cycle is not None and not self.cycle.response_complete and not self.cycle.more_body
        return not has_request and not self.transport.is_closing()

    def _begin_to_wait(self) -> None:
        if self._late is not None:
            self._late.cancel()
        self._since_s = self.loop.time()
        self._late = self.loop.call_later(_WITHIN_S, self._end_if_waiting)

    def _end_if_waiting(self) -> None:
        if self.is_waiting:
            self.transport.abort()
