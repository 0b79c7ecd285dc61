"""Other axes on this page: their own pages on this computer are followed and queried for viewers here.

Each axis is a service of its own with a page of its own. This server reads the events of the others once, for
all of its viewers, so a browser needs to reach, and trust, one address only.
"""

from __future__ import annotations

import asyncio
import json
import threading
from collections.abc import Callable, Sequence
from http.client import HTTPConnection, HTTPException
from typing import Any
from urllib.parse import quote, urlencode

from observer.page.viewers import Viewers, event

_AGAIN_S = 1.0
_PATIENCE_S = 5.0
"""A page sends a heartbeat each second; one that is silent for so long is gone."""
_MOST_BYTES = 32 << 20
_LINE_BYTES = 4 << 20
_SEVERITIES = {"invalid": 0, "major": 1, "minor": 2}


def worst_alarm(alarms: list[dict[str, Any]]) -> dict[str, Any] | None:
    """The alarm to look at first: one that nobody has acknowledged, of the highest severity."""
    return min(
        alarms,
        key=lambda a: (a["state"] == "acknowledged", _SEVERITIES.get(a["severity"], 0)),
        default=None,
    )


def summary(documents: dict[str, Any]) -> dict[str, Any]:
    """Machine, axis, state in a word, and the worst alarm's reason of the newest documents of an axis."""
    hello, health = documents.get("hello", {}), documents.get("health", {})
    alarm = worst_alarm(documents.get("alarms", {}).get("alarms", []))
    stale = documents.get("beat", {}).get("stale", True)
    return {
        "machine": hello.get("machine"),
        "axis": hello.get("axis"),
        "state": "stale" if stale else health.get("state", "starting"),
        "alarm": None if alarm is None else alarm["reason"],
        "quiet": alarm is not None and alarm["state"] == "acknowledged",
    }


class Neighbour(Viewers):
    """Another axis, by the address of its page; `follow` begins to read its events."""

    def __init__(self, address: str, login: bool) -> None:
        """Take `host:port`, and whether viewers here have logged in."""
        super().__init__()
        self.address = address
        self._login = login
        self._documents: dict[str, Any] = {}
        self._said = summary({})
        self._reason: str | None = f"nothing has come from {address} yet"
        self._closing = threading.Event()

    def follow(self, loop: asyncio.AbstractEventLoop) -> None:
        """Read its events in a thread of its own until `close`."""
        threading.Thread(target=self._follow, args=(loop,), name="axis", daemon=True).start()

    def end(self) -> None:
        """Stop reading, and end the events of viewers."""
        self._closing.set()
        super().end()

    def summary(self) -> dict[str, Any]:
        """Its summary among other axes; `reason` says why nothing comes."""
        gone = {"state": "stale", "reason": self._reason} if self._reason else {"reason": None}
        return {**self._said, "address": self.address, **gone}

    def ask(self, path: str, query: str, form: dict[str, str] | None) -> tuple[int, str, bytes]:
        """Ask its page: status, media type and content. Raises `OSError` or `HTTPException`."""
        connection = HTTPConnection(self.address, timeout=_PATIENCE_S)
        try:
            target = f"/{quote(path)}?{query}" if query else f"/{quote(path)}"
            if form is None:
                connection.request("GET", target)
            else:
                own = {
                    "origin": f"http://{self.address}",
                    "content-type": "application/x-www-form-urlencoded",
                }
                connection.request("POST", target, urlencode(form), own)
            answer = connection.getresponse()
            kind = answer.headers.get_content_type()
            return answer.status, kind, answer.read(_MOST_BYTES)
        finally:
            connection.close()

    def _follow(self, loop: asyncio.AbstractEventLoop) -> None:
        while not self._closing.is_set():
            try:
                self._read(loop)
            except (OSError, HTTPException, ValueError) as error:
                self._reason = f"nothing comes from {self.address} ({error})"
            self._closing.wait(_AGAIN_S)

    def _read(self, loop: asyncio.AbstractEventLoop) -> None:
        connection = HTTPConnection(self.address, timeout=_PATIENCE_S)
        try:
            connection.request("GET", "/events")
            answer = connection.getresponse()
            if answer.status != 200:
                raise HTTPException(answer.read(200).decode("utf-8", "replace").strip())
            key = ""
            while not self._closing.is_set() and (line := answer.readline(_LINE_BYTES)):
                if line.startswith(b"event: "):
                    key = line[7:].strip().decode("utf-8", "replace")
                elif line.startswith(b"data: ") and key != "axes":
                    loop.call_soon_threadsafe(self._take, key, line[6:].strip())
            raise HTTPException("it has ended")
        finally:
            connection.close()

    def _take(self, key: str, data: bytes) -> None:
        self._reason = None
        if key in {"hello", "health", "alarms", "beat"}:
            try:
                documents = {**self._documents, key: json.loads(data)}
                self._said = summary(documents)
            except (ValueError, KeyError, TypeError, AttributeError):
                return  # of another version; what is shown of it goes stale
            self._documents = documents
        if key == "hello":
            data = json.dumps({**self._documents.get("hello", {}), "login": self._login}).encode()
        self.send(key, event(key, data))


def summaries(documents: dict[str, Any], axes: Sequence[Neighbour]) -> list[dict[str, Any]]:
    """The summaries of this axis, by its documents, and of the others."""
    return [summary(documents), *(axis.summary() for axis in axes)]


async def announce(axes: Sequence[Neighbour], own: Viewers, documents: Callable[[], dict[str, Any]]) -> None:
    """Send the summaries of all axes to every viewer on each change; `documents()` returns this axis's."""
    sent = b""
    while True:
        rows = summaries(documents(), axes)
        if (now := event("axes", json.dumps(rows).encode())) != sent:
            sent = now
            for viewers in (own, *axes):
                viewers.send("axes", now)
        await asyncio.sleep(_AGAIN_S)
