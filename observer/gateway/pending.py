"""Messages that wait for somebody slower: of every key the newest only, so that the wait is bounded."""

from __future__ import annotations

import threading
from collections.abc import Callable

Message = tuple[str, bytes]


class Pending:
    """Takes messages from any thread; `wake` is called after each and must wait for nothing."""

    def __init__(self, wake: Callable[[], object]) -> None:
        self._wake = wake
        self._lock = threading.Lock()
        self._newest: dict[str, bytes] = {}

    def put(self, key: str, payload: bytes) -> None:
        """Take a message; one of the same key that still waits is left out."""
        with self._lock:
            self._newest.pop(key, None)
            self._newest[key] = payload
        self._wake()

    def take(self) -> list[Message]:
        """Give what waits, in the order of its coming."""
        with self._lock:
            waiting, self._newest = list(self._newest.items()), {}
        return waiting
