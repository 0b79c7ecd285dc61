"""The page: its routes and their answers."""

from __future__ import annotations

import asyncio
import gzip
import json
import mimetypes
import os
import threading
from collections.abc import Awaitable, Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from importlib.resources import files
from typing import Any
from urllib.parse import parse_qs

from starlette.applications import Starlette
from starlette.concurrency import run_in_threadpool
from starlette.exceptions import HTTPException
from starlette.middleware.gzip import GZipMiddleware
from starlette.requests import ClientDisconnect, Request
from starlette.responses import (
    HTMLResponse,
    JSONResponse,
    PlainTextResponse,
    RedirectResponse,
    Response,
)
from starlette.routing import Route
from starlette.types import ASGIApp

from observer.config.outlets import host_and_port
from observer.errors import LogError
from observer.outlets.page_guard import COOKIE, Guard, Logins
from observer.outlets.page_stream import Stream
from observer.outlets.start import Start
from observer.record.bins import history

Acknowledge = Callable[[str, str], Awaitable[str | None]]
_MOST_FORM_BYTES = 4096
_MOST_FIELDS = 10
_MOST_NAME = 200
_POINTS = 600
_GIVES_WAY = 10
_LEVEL = 4  # of compression
_IN_THE_CLEAR = (
    '<p class="hint plain">This connection is not encrypted: anybody on the network path can read the '
    "password.</p>"
)


def application(
    start: Start,
    stream: Stream,
    login: Logins | None,
    acknowledge: Acknowledge,
) -> ASGIApp:
    """The page of an axis, for users of `login`; `acknowledge(id, by)` acknowledges an alarm, and
    returns why it could not.
    """
    assert start.page is not None
    pages = _Pages(start, stream, login, acknowledge)
    app = Starlette(
        routes=[
            Route("/", pages.index),
            Route("/assets/{name}", pages.asset),
            Route("/events", pages.events),
            Route("/recent.json", pages.recent),
            Route("/past.json", pages.past),
            Route("/history.json", pages.history),
            Route("/acknowledge", pages.acknowledge, methods=["POST"]),
            Route("/login", pages.login, methods=["GET", "POST"]),
            Route("/logout", pages.logout, methods=["POST"]),
        ]
    )
    return Guard(
        GZipMiddleware(app, minimum_size=1000, compresslevel=_LEVEL),
        host_and_port(start.page.listen)[0],
        login,
    )


class _Json(JSONResponse):
    """JSON in ASCII: names of files may not be encodable."""

    def render(self, content: Any) -> bytes:
        """The body."""
        return json.dumps(content, allow_nan=False, separators=(",", ":")).encode()


class _Pages:
    """The answers."""

    def __init__(
        self,
        start: Start,
        stream: Stream,
        login: Logins | None,
        acknowledge: Acknowledge,
    ) -> None:
        assert start.page is not None
        self._start, self._page, self._stream = start, start.page, stream
        self._login, self._acknowledge = login, acknowledge
        # one reader for all viewers: concurrent requests take neither more memory nor another core
        self._reader = ThreadPoolExecutor(1, "recordings", _give_way)
        self._turn, self._acknowledging = asyncio.Lock(), asyncio.Lock()
        self._packing, self._recent = asyncio.Lock(), (b"", b"")
        folder = files("observer.outlets") / "assets"
        self._assets = {entry.name: entry.read_bytes() for entry in folder.iterdir() if entry.is_file()}

    async def index(self, _: Request) -> Response:
        """The page itself."""
        return HTMLResponse(self._assets["index.html"])

    async def asset(self, request: Request) -> Response:
        """A file of the page."""
        name = request.path_params["name"]
        data = self._assets.get(name)
        if data is None or name.endswith(".html"):
            return PlainTextResponse("no such file\n", 404)
        kind = mimetypes.guess_type(name)[0] or "text/plain"
        return Response(data, media_type=kind, headers={"cache-control": "no-cache"})

    async def events(self, _: Request) -> Response:
        """Messages as server-sent events."""
        too_many = PlainTextResponse("too many viewers; close a page elsewhere\n", 503)
        return self._stream.join() or too_many

    async def recent(self, request: Request) -> Response:
        """The last hour, compressed once for all viewers."""
        async with self._packing:
            plain = self._stream.recent.document()
            if plain != self._recent[0]:
                self._recent = plain, await run_in_threadpool(gzip.compress, plain, _LEVEL)
        headers = {"vary": "accept-encoding"}
        if "gzip" not in request.headers.get("accept-encoding", ""):
            return Response(plain, media_type="application/json", headers=headers)
        headers["content-encoding"] = "gzip"
        return Response(self._recent[1], media_type="application/json", headers=headers)

    async def past(self, _: Request) -> Response:
        """The times of the first and the last published step, or the reason for their absence."""
        past = self._start.past
        if past is None:
            return _Json({"reason": "nothing is recorded; name a folder in record.directory"})
        try:
            from_s, to_s = await run_in_threadpool(past.span_s)
        except LogError as error:
            return _Json({"reason": str(error)})
        if from_s is None:
            return _Json({"reason": "Nothing has been recorded yet."})
        return _Json({"reason": None, "from_s": from_s, "to_s": to_s})

    async def history(self, request: Request) -> Response:
        """Minimum, mean and maximum of each channel in the parts of a span."""
        query, past = request.query_params, self._start.past
        try:
            from_s, to_s = float(query["from"]), float(query["to"])
            points = int(query.get("points", str(_POINTS)))
            async with self._turn:
                if await request.is_disconnected():  # the viewer has moved on
                    return Response(status_code=204)
                document = await asyncio.get_running_loop().run_in_executor(
                    self._reader, lambda: history(past, from_s, to_s, points)
                )
        except KeyError as error:
            return PlainTextResponse(f"{error} is missing; give from and to in seconds since 1970\n", 400)
        except (ValueError, LogError) as error:
            return PlainTextResponse(f"{error}\n", 400)
        return _Json(document)

    async def acknowledge(self, request: Request) -> Response:
        """Pass on to the service that somebody has acknowledged an alarm."""
        alarm = (await _form(request)).get("id", "")
        if not alarm or len(alarm) > _MOST_NAME or not alarm.isprintable():
            return PlainTextResponse("which alarm? give its id\n", 400)
        async with self._acknowledging:  # each opens a session
            problem = await self._acknowledge(alarm, request.scope["user"])
        if problem is not None:
            return PlainTextResponse(f"{problem}\n", 502)
        return _Json({"acknowledged": alarm})

    async def login(self, request: Request) -> Response:
        """The login form, and its evaluation."""
        if self._login is None:
            return RedirectResponse("/", 303)
        if request.method == "GET":
            return self._ask("", 200)
        form = await _form(request)
        address = request.client.host if request.client else ""
        # nothing is awaited between question and count: of guesses sent at once five are looked at
        if self._login.is_throttled(address):
            return self._ask("Too many wrong passwords; wait a minute.", 429)
        if not self._login.is_right(form.get("user", ""), form.get("password", ""), address):
            return self._ask(
                "That name and password do not match; try again, or ask who runs the service.", 403
            )
        return RedirectResponse("/", 303, {"set-cookie": self._login.cookie(form["user"])})

    def _ask(self, message: str, status: int) -> Response:
        clear = "" if self._page.doubt is None else _IN_THE_CLEAR
        page = self._assets["login.html"].replace(b"{message}", message.encode())
        page = page.replace(b"{clear}", clear.encode())
        # without this a browser sends no Origin with the form
        return HTMLResponse(page, status, {"referrer-policy": "same-origin"})

    async def logout(self, request: Request) -> Response:
        """End the session of this browser."""
        if self._login is None:
            return RedirectResponse("/login", 303)
        self._login.end(request.cookies.get(COOKIE))
        return RedirectResponse("/login", 303, {"set-cookie": self._login.no_cookie()})


def _give_way() -> None:
    """Lower the priority of the thread that reads recordings."""
    with suppress(AttributeError, OSError):  # a thread has a priority of its own on Linux only
        os.setpriority(os.PRIO_PROCESS, threading.get_native_id(), _GIVES_WAY)


async def _form(request: Request) -> dict[str, str]:
    """The fields of a short form; raises `HTTPException` for an invalid one.

    Starlette's own parser needs python-multipart and sets no limit of bytes for a plain form.
    """
    body = b""
    try:
        async for part in request.stream():
            body += part
            if len(body) > _MOST_FORM_BYTES:
                raise HTTPException(413, f"a form has at most {_MOST_FORM_BYTES} bytes; shorten it\n")
        fields: dict[str, Any] = parse_qs(body.decode("utf-8", "replace"), max_num_fields=_MOST_FIELDS)
    except ClientDisconnect:
        raise HTTPException(400, "the form is incomplete; send it again\n") from None
    except ValueError:
        raise HTTPException(400, f"a form has at most {_MOST_FIELDS} fields; send fewer\n") from None
    return {name: values[0] for name, values in fields.items()}
