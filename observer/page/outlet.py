"""The page's server: where it listens, for how long, and what is wrong if it cannot."""

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

from observer.errors import ConfigError
from observer.gateway.latest import Latest
from observer.gateway.say import Say
from observer.gateway.start import Start
from observer.gateway.users import read_users
from observer.page.app import application
from observer.page.connections import Connection
from observer.page.login import Login
from observer.page.stream import Stream
from observer.tables.gateway import host_and_port

_END_S = 0.8
_MOST_CONNECTIONS = 200


class _Server(uvicorn.Server):
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
    login = None if users is None else Login(users, secure=secure)
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
        server = _Server(config)
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
    """Tell the service that somebody has seen an alarm, by its `id`."""
    sys.stdout.write(json.dumps({"acknowledge": alarm, "by": by}) + "\n")
    sys.stdout.flush()
