"""Names and passwords, and a limit on wrong ones."""

from __future__ import annotations

import hashlib
import hmac
import secrets
import time
from collections import deque
from collections.abc import Callable, Mapping

_FAILURES = 5
_WITHIN_S = 60.0
_MOST_ADDRESSES = 1000


class Users:
    """Checks names and passwords."""

    def __init__(self, users: Mapping[str, str], clock: Callable[[], float] = time.monotonic) -> None:
        """Take the passwords by name."""
        self._users = {name: password.encode() for name, password in users.items()}
        self._clock = clock
        self._key = secrets.token_bytes(32)
        self._failures: dict[str, deque[float]] = {}

    def is_throttled(self, address: str) -> bool:
        """Whether too many wrong passwords came from an address within the last minute."""
        return len(self._recent(address)) >= _FAILURES

    def is_right(self, name: str, password: str, address: str) -> bool:
        """Whether name and password match; takes as long for an unknown name."""
        right = self._users.get(name, self._key)
        same = hmac.compare_digest(self._digest(right), self._digest(password.encode()))
        if not same or name not in self._users:
            if len(self._failures) >= _MOST_ADDRESSES:
                self._failures.pop(next(iter(self._failures)))
            self._failures.setdefault(address, deque(maxlen=_FAILURES)).append(self._clock())
            return False
        self._failures.pop(address, None)
        return True

    def _recent(self, address: str) -> deque[float]:
        times = self._failures.get(address, deque())
        while times and self._clock() - times[0] > _WITHIN_S:
            times.popleft()
        return times

    def _digest(self, data: bytes) -> bytes:
        return hmac.digest(self._key, data, hashlib.sha256)
