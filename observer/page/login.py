"""Who may look: a signed cookie for those who gave name and password."""

from __future__ import annotations

import hashlib
import hmac
import time
from collections.abc import Callable, Mapping

from observer.gateway.users import Users

COOKIE = "observer_session"
_LASTS_S = 12 * 3600


class Login(Users):
    """Judges names, passwords and cookies; its key is new at each start, so a restart asks again."""

    def __init__(
        self,
        users: Mapping[str, str],
        *,
        secure: bool,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        """Take who may look, and whether cookies go over TLS only."""
        super().__init__(users, clock)
        self._secure = secure

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

    def _sign(self, value: str) -> str:
        return hmac.new(self._key, value.encode(), hashlib.sha256).hexdigest()

    def _header(self, value: str, lasts_s: int) -> str:
        secure = "; Secure" if self._secure else ""
        return f"{COOKIE}={value}; Path=/; Max-Age={lasts_s}; HttpOnly; SameSite=Strict{secure}"
