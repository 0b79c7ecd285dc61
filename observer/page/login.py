"""Who may look: a cookie for those who gave name and password."""

from __future__ import annotations

import secrets
import time
from collections.abc import Callable, Mapping

from observer.gateway.users import Users

COOKIE = "observer_session"
_LASTS_S = 12 * 3600
_MOST_SESSIONS = 1000


class Login(Users):
    """Judges names, passwords and cookies; sessions are kept here alone, so a restart asks again."""

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
        self._sessions: dict[str, tuple[str, float]] = {}

    def cookie(self, name: str) -> str:
        """The header that gives a browser a session of its own."""
        value = f"{name.encode().hex()}.{secrets.token_hex(32)}"
        if len(self._sessions) >= _MOST_SESSIONS:
            self._sessions.pop(next(iter(self._sessions)))
        self._sessions[value] = name, self._clock() + _LASTS_S
        return self._header(value, _LASTS_S)

    def no_cookie(self) -> str:
        """The header that takes the session away."""
        return self._header("", 0)

    def end(self, cookie: str | None) -> None:
        """Let a cookie be worth nothing any more, whoever still has it."""
        self._sessions.pop(cookie or "", None)

    def user_of(self, cookie: str | None) -> str | None:
        """The name in a cookie's value, None where it is not ours, too old, or has been ended."""
        name, until_s = self._sessions.get(cookie or "", (None, 0.0))
        return name if self._clock() < until_s else None

    def _header(self, value: str, lasts_s: int) -> str:
        secure = "; Secure" if self._secure else ""
        return f"{COOKIE}={value}; Path=/; Max-Age={lasts_s}; HttpOnly; SameSite=Strict{secure}"
