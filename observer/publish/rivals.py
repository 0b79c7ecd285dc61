"""One writer to a key: whether another program has the axis already, or publishes on its keys."""

from __future__ import annotations

import math
import re
import time
from typing import Any

import zenoh

from observer.publish.session import close

_RING = 16
_MEMORY_S = 10.0  # so long after its last message another program counts as there
_QUERY_S = 1.0
_RETRY_S = 2.0
_POLL_S = 0.02
_INSTANCE = re.compile(rb'instance(?:":"|h)([0-9a-f]{8})')
"""An instance within JSON, or as a text of eight within CBOR; no forged message is parsed for it."""


class Rivals:
    """Looks for others on the keys directly under a prefix, where only one service may be.

    A router does not pass a peer what its other peers publish. Where `ear` is given, a session of that
    configuration, a client of the same router, listens in its place as soon as it can be opened.
    """

    def __init__(self, session: zenoh.Session, ear: zenoh.Config | None, prefix: str, instance: str) -> None:
        self._session = session
        self._ear = ear
        self._own: zenoh.Session | None = None
        self._opened_s = -math.inf
        self._prefix = prefix
        self._instance = instance.encode()
        self._messages: Any = None
        self._heard: tuple[str, float] | None = None

    def token_is_there(self) -> bool:
        """Whether somebody holds the axis' liveliness token, by the answers of one second."""
        session = self._listener()
        if session is None:
            return False
        key = f"{self._prefix}/alive"
        replies = session.liveliness().get(key, zenoh.handlers.FifoChannel(1), timeout=_QUERY_S)
        end_s = time.monotonic() + _QUERY_S
        while time.monotonic() < end_s:
            try:
                reply = replies.try_recv()
            except zenoh.ZError:
                return False  # everybody has answered
            if reply is not None and reply.ok is not None:
                return True
            time.sleep(_POLL_S)
        return False

    def look(self) -> None:
        """Take in what has come since the last look."""
        if self._messages is None:
            if (session := self._listener()) is None:
                return
            self._messages = session.declare_subscriber(
                f"{self._prefix}/*", zenoh.handlers.RingChannel(_RING), allowed_origin=zenoh.Locality.REMOTE
            )
        for _ in range(_RING):
            sample = self._messages.try_recv()
            if sample is None:
                return
            found = _INSTANCE.search(sample.payload.to_bytes())
            if found is None or found[1] != self._instance:
                name = f"instance {found[1].decode()}" if found else "of no known instance"
                sentence = f"another program publishes on {sample.key_expr} ({name}); end one of the two"
                self._heard = sentence, time.monotonic()

    def _listener(self) -> zenoh.Session | None:
        """The session that receives from the others; None if it cannot be opened yet."""
        if self._ear is None or self._own is not None:
            return self._own or self._session
        if time.monotonic() - self._opened_s >= _RETRY_S:
            try:
                self._own = zenoh.open(self._ear)
            except zenoh.ZError:
                self._opened_s = time.monotonic()
        return self._own

    def close(self) -> None:
        """End the session that only listens."""
        if self._own is not None:
            close(self._own)

    @property
    def reason(self) -> str | None:
        """What another program publishes, in a sentence; None if nothing was received lately."""
        if self._heard is None or time.monotonic() - self._heard[1] > _MEMORY_S:
            return None
        return self._heard[0]
