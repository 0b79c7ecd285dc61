"""A server of HTTP for scrapes, which answers a few at once whoever else is connected."""

from __future__ import annotations

import socket
import threading
from contextlib import suppress
from socketserver import ThreadingMixIn
from typing import Any
from wsgiref.simple_server import WSGIRequestHandler, WSGIServer

_MOST = 16
_WITHIN_S = 5.0


class _Handler(WSGIRequestHandler):
    """Answers one question without a word on standard error."""

    timeout = _WITHIN_S  # for each part of it

    def log_message(self, *_: Any) -> None:
        """Say nothing."""


class _Server(ThreadingMixIn, WSGIServer):
    """A thread for each of a few connections; where there are more, the oldest makes room."""

    daemon_threads = True

    def __init__(self, address: tuple[str, int], family: socket.AddressFamily) -> None:
        self.address_family = family
        self._held: list[socket.socket] = []
        self._free = threading.Semaphore(_MOST)
        super().__init__(address, _Handler)

    def process_request(self, request: Any, client_address: Any) -> None:
        """Begin to answer."""
        if not self._free.acquire(blocking=False):
            for oldest in self._held[:1]:
                with suppress(OSError):  # it has ended meanwhile
                    oldest.shutdown(socket.SHUT_RDWR)
            if not self._free.acquire(timeout=_WITHIN_S):
                self.shutdown_request(request)
                return
        self._held.append(request)
        super().process_request(request, client_address)

    def process_request_thread(self, request: Any, client_address: Any) -> None:
        """Answer, in a thread of its own."""
        try:
            super().process_request_thread(request, client_address)
        finally:
            self._held.remove(request)
            self._free.release()

    def handle_error(self, *_: Any) -> None:
        """Say nothing of a client that went away or did not ask in time."""


def serving(host: str, port: int, app: Any) -> WSGIServer:
    """A server of a WSGI application that is bound to a place; raises `OSError` where it cannot be."""
    family, _, _, _, (address, *_) = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0]
    server = _Server((str(address), port), family)
    server.set_app(app)
    return server
