"""Who may look: names and passwords from a file, and a signed cookie for those who gave them."""

from __future__ import annotations

import hashlib
import hmac
import secrets
import time
from collections import deque
from collections.abc import Callable, Mapping
from pathlib import Path

from observer.errors import ConfigError

COOKIE = "observer_session"
_LASTS_S = 12 * 3600
_FAILURES = 5
_WITHIN_S = 60.0
_MOST_ADDRESSES = 1000


def read_users(path: Path) -> dict[str, str]:
    """Names and passwords from a file of `user:password` lines; raises `ConfigError` where it is none."""
    try:
        mode = path.stat().st_mode
        lines = path.read_text(encoding="utf-8").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "not UTF-8 text"
        raise ConfigError(f"page.users_file: {path} cannot be read ({reason}); mend or rename it") from None
    if mode & 0o077:
        raise ConfigError(f"page.users_file: others on this computer can read {path}; run chmod 600 {path}")
    users = {}
    for number, line in enumerate(lines, 1):
        name, colon, password = line.strip().partition(":")
        if line.strip() and not (name and colon and password):
            raise ConfigError(f"page.users_file: line {number} of {path} is not user:password; mend it")
        if name:
            users[name] = password
    if not users:
        raise ConfigError(f"page.users_file: {path} names nobody; write a line user:password into it")
    return users


class Login:
    """Judges names, passwords and cookies; its key is new at each start, so a restart asks again."""

    def __init__(
        self,
        users: Mapping[str, str],
        *,
        secure: bool,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        """Take who may look, and whether cookies go over TLS only."""
        self._users = {name: password.encode() for name, password in users.items()}
        self._secure = secure
        self._clock = clock
        self._key = secrets.token_bytes(32)
        self._failures: dict[str, deque[float]] = {}

    def is_throttled(self, address: str) -> bool:
        """Whether too many wrong passwords came from an address within the last minute."""
        return len(self._recent(address)) >= _FAILURES

    def is_right(self, name: str, password: str, address: str) -> bool:
        """Whether that is the password of that name; takes as long for a name that nobody has."""
        right = self._users.get(name, self._key)
        same = hmac.compare_digest(self._digest(right), self._digest(password.encode()))
        if not same or name not in self._users:
            if len(self._failures) >= _MOST_ADDRESSES:
                self._failures.pop(next(iter(self._failures)))
            self._failures.setdefault(address, deque(maxlen=_FAILURES)).append(self._clock())
            return False
        self._failures.pop(address, None)
        return True

    def cookie(self, name: str) -> str:
        """The header that gives a browser its session."""
        until = int(self._clock() + _LASTS_S)
        value = f"{name.encode().hex()}.{until}"
        return self._header(f"{value}.{self._sign(value)}", _LASTS_S)

    def no_cookie(self) -> str:
        """The header that takes the session away."""
        return self._header("", 0)

    def user_of(self, cookie: str | None) -> str | None:
        """The name in a cookie's value, None where it is not ours or too old."""
        value, dot, signature = (cookie or "").rpartition(".")
        if not dot or not signature.isascii() or not hmac.compare_digest(signature, self._sign(value)):
            return None
        name, _, until = value.partition(".")
        return bytes.fromhex(name).decode() if self._clock() < int(until) else None

    def _recent(self, address: str) -> deque[float]:
        times = self._failures.get(address, deque())
        while times and self._clock() - times[0] > _WITHIN_S:
            times.popleft()
        return times

    def _digest(self, data: bytes) -> bytes:
        return hmac.digest(self._key, data, hashlib.sha256)

    def _sign(self, value: str) -> str:
        return hmac.new(self._key, value.encode(), hashlib.sha256).hexdigest()

    def _header(self, value: str, lasts_s: int) -> str:
        secure = "; Secure" if self._secure else ""
        return f"{COOKIE}={value}; Path=/; Max-Age={lasts_s}; HttpOnly; SameSite=Strict{secure}"
