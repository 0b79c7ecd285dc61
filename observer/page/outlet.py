"""The page's server: where it listens, its connections, and what is wrong if it cannot serve.

uvicorn closes a connection that is idle after an answer, but not one whose request never ends; at its limit
it refuses every newcomer. `Connection` bounds the time to a whole request and makes room.
"""

from __future__ import annotations

import asyncio
import contextlib
import errno
import json
import socket
import ssl
import sys
from collections.abc import Awaitable, Iterator

import uvicorn
from uvicorn.protocols.http.h11_impl import H11Protocol

from observer.errors import ConfigError
from observer.gateway.messages import Latest
from observer.gateway.start import Say, Start
from observer.gateway.users import read_users
from observer.page.app import application
from observer.page.guard import Logins
from observer.page.stream import Stream
from observer.tables.gateway import host_and_port

_END_S = 0.8
_MOST_CONNECTIONS = 200


class _PageServer(uvicorn.Server):
    """A server that leaves the signals to the process it runs in."""

    @contextlib.contextmanager
    def capture_signals(self) -> Iterator[None]:
        yield


async def serve(start: Start, latest: Latest, say: Say) -> None:
    """Serve the page until cancelled; raises `OSError` or `ConfigError` with one sentence if it cannot."""
    assert start.page is not None
    page = start.page
    secure = page.certificate is not None
    users = read_users(page.users_file) if page.users_file is not None else None
    login = None if users is None else Logins(users, secure=secure)
    stream = Stream(latest, start, login is not None)
    app = application(start, stream, login, acknowledge)
    config = uvicorn.Config(
        app,
        http=Connection,
        log_config=None,
        access_log=False,
        lifespan="off",
        ws="none",
        server_header=False,
        limit_concurrency=_MOST_CONNECTIONS,
        ssl_certfile=None if page.certificate is None else str(page.certificate),
        ssl_keyfile=None if page.key is None else str(page.key),
    )
    try:
        if page.certificate is not None:
            # OpenSSL would ask for a passphrase, and take what the service says for it
            ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER).load_cert_chain(page.certificate, page.key, lambda: "")
        config.load()
    except (OSError, ssl.SSLError) as error:
        raise ConfigError(
            f"{page.certificate}: cannot be used as a certificate ({error}); name PEM files that belong "
            "together in page.certificate and page.key, the key without a passphrase"
        ) from None
    with _bound(page.listen) as bound:
        server = _PageServer(config)
        serving = asyncio.create_task(server.serve([bound]))
        feeding = asyncio.create_task(stream.run())
        say({"reason": None, "address": f"http{'s' * secure}://{page.listen}/", "doubt": page.doubt})
        try:
            await _first_to_end(serving, feeding)
        finally:
            feeding.cancel()
            stream.end()
            server.should_exit = True
            await asyncio.wait([serving], timeout=_END_S)
            server.force_exit = True
            serving.cancel()


async def _first_to_end(*tasks: Awaitable[None]) -> None:
    """Wait for whichever ends first, and raise what it ended with."""
    done, _ = await asyncio.wait([asyncio.ensure_future(t) for t in tasks], return_when="FIRST_COMPLETED")
    for task in done:
        task.result()


@contextlib.contextmanager
def _bound(listen: str) -> Iterator[socket.socket]:
    """A socket that is bound there; raises `OSError` that says what to do where it cannot be."""
    host, port = host_and_port(listen)
    try:
        found = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)
        family, kind, protocol, _, address = found[0]
        with socket.socket(family, kind, protocol) as bound:
            bound.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            bound.bind(address)
            yield bound
    except OSError as error:
        if error.errno == errno.EADDRINUSE:
            raise OSError(f"another program listens on {listen}; stop it or change page.listen") from None
        if error.errno in {errno.EADDRNOTAVAIL, errno.EACCES} or isinstance(error, socket.gaierror):
            raise OSError(f"cannot listen on {listen} ({error.strerror}); change page.listen") from None
        raise


def acknowledge(alarm: str, by: str) -> None:
    """Report to the service that somebody has seen an alarm, by its `id`."""
    sys.stdout.write(json.dumps({"acknowledge": alarm, "by": by}) + "\n")
    sys.stdout.flush()


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
