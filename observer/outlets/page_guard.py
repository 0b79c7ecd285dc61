"""Checks before every answer: the requested host, the origin of the request, and the user.

Starlette's middleware does not suffice. Its sessions live in the cookie, so logging out could not end a
stolen one. Its trusted hosts cannot allow every address of this computer and refuse foreign names.
"""

from __future__ import annotations

import ipaddress
import secrets
import socket
import time
from collections.abc import Callable, Mapping
from urllib.parse import urlsplit

from starlette.datastructures import Headers, MutableHeaders
from starlette.requests import HTTPConnection
from starlette.responses import PlainTextResponse, RedirectResponse
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from observer.outlets.users import Users

POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data:; connect-src 'self'; "
    "base-uri 'none'; form-action 'self'; frame-ancestors 'none'"
)
_HEADERS = {
    "x-content-type-options": "nosniff",
    "referrer-policy": "no-referrer",
    "cross-origin-opener-policy": "same-origin",
    "cross-origin-resource-policy": "same-origin",
    "permissions-policy": "camera=(), microphone=(), geolocation=()",
}
_OPEN = ("/login", "/assets/page.css", "/assets/favicon.svg")


class Guard:
    """Passes requests to this host, from its own pages, by users who may look."""

    def __init__(self, app: ASGIApp, host: str, login: Logins | None) -> None:
        """Take the host listened on, and the logins, None without login."""
        self._app = app
        self._hosts = {
            host,
            "localhost",
            socket.gethostname().lower(),
            f"{socket.gethostname().lower()}.local",
        }
        self._login = login

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer or refuse a request."""
        if scope["type"] != "http":
            return

        async def sealed(message: Message) -> None:
            if message["type"] == "http.response.start":
                headers = MutableHeaders(scope=message)
                headers.setdefault("content-security-policy", POLICY)
                headers.setdefault("cache-control", "no-store")
                for name, value in _HEADERS.items():
                    headers.setdefault(name, value)
            await send(message)

        await (self._refusal(scope) or self._app)(scope, receive, sealed)

    def _refusal(self, scope: Scope) -> ASGIApp | None:
        headers, path = Headers(scope=scope), scope["path"]
        host_header = headers.get("host", "")
        if not self._is_ours(host_header):
            return PlainTextResponse("this page is not served under that name; use the address\n", 421)
        if scope["method"] not in {"GET", "HEAD"} and _place(headers.get("origin", "")) != host_header:
            return PlainTextResponse(
                "only the page itself may ask for that; open the page and use its buttons\n", 403
            )
        if self._login is None:
            scope["user"] = "page"
            return None
        scope["user"] = user = self._login.user_of(HTTPConnection(scope).cookies.get(COOKIE))
        if user is not None or path in _OPEN:
            return None
        if path == "/":
            return RedirectResponse("/login", 303)
        return PlainTextResponse("log in first\n", 401)

    def _is_ours(self, host_header: str) -> bool:
        """Whether a Host header is an address or one of our names (against DNS rebinding)."""
        try:
            host = urlsplit(f"//{host_header}").hostname or ""
        except ValueError:
            return False
        if host in self._hosts:
            return True
        try:
            ipaddress.ip_address(host)
        except ValueError:
            return False
        return True


def _place(origin: str) -> str:
    """Return host and port of an origin, an empty text for an invalid one."""
    try:
        return urlsplit(origin).netloc
    except ValueError:
        return ""


COOKIE = "observer_session"
_LASTS_S = 12 * 3600
_MOST_SESSIONS = 1000


class Logins(Users):
    """Judges names, passwords and cookies; sessions are kept here alone, so a restart asks again."""

    def __init__(
        self,
        users: Mapping[str, str],
        *,
        secure: bool,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        """Take the users, and whether cookies go over TLS only."""
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
        """Invalidate a cookie, including copies of it."""
        self._sessions.pop(cookie or "", None)

    def user_of(self, cookie: str | None) -> str | None:
        """The name in a cookie's value, None where it is not ours, too old, or has been ended."""
        name, until_s = self._sessions.get(cookie or "", (None, 0.0))
        return name if self._clock() < until_s else None

    def _header(self, value: str, lasts_s: int) -> str:
        secure = "; Secure" if self._secure else ""
        return f"{COOKIE}={value}; Path=/; Max-Age={lasts_s}; HttpOnly; SameSite=Strict{secure}"
