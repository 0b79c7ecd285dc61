"""An asynchronous client of a running service over Zenoh.

Zenoh calls back in threads of its own. Each message is handed to the event loop, so that the state of a
stream changes in the loop's thread only.
"""

from __future__ import annotations

import asyncio
import re
import time
from collections.abc import AsyncIterator, Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any, Generic, TypeVar

import zenoh

from observer.bus.ask import Address, ask, command
from observer.bus.codec import decode_estimate
from observer.bus.exchange import KINDS
from observer.bus.session import client_config, close_within
from observer.errors import UserError
from observer.library.messages import (
    ServiceAlarms,
    ServiceField,
    ServiceHealth,
    ServiceHeat,
    ServiceThermalError,
    documents_of,
    message_from,
)

Message = TypeVar("Message", ServiceHeat, ServiceField, ServiceThermalError, ServiceHealth, ServiceAlarms)
_NAMES = re.compile(r"[A-Za-z0-9_.,-]{1,250}")
_STEP_S, _REPORT_S = 3.0, 15.0
"""A message older than this is stale, unless three of its usual intervals are longer."""


class ServiceStream(Generic[Message]):
    """The messages of one kind: `async for message in stream`, beginning with the last one if there is
    any.

    A slow reader gets the newest and is never behind. If nothing is heard for a while, the last message comes
    once more with the quality `stale`, and so it stays in `last`. A while is 3 s for estimates and 15 s for
    health and alarms, or three of the usual intervals if these are longer.

    Several readers may iterate over one stream: each gets every message that it is fast enough for. Use it in
    the thread of the event loop only. Iteration never ends; leave it with `break`.
    """

    def __init__(self, kind: type[Message], silent_s: float) -> None:
        self._kind: type[Message] = kind
        self._silent_s = silent_s
        self._message: Message | None = None
        self._count, self._arrived_s, self._gap_s = 0, 0.0, 0.0
        self._new_message = asyncio.Event()

    @property
    def last(self) -> Message | None:
        """The last message, None before the first.

        Its quality is `stale` if nothing has been heard for a while, so an old value never looks fresh.
        """
        if self._message is None or time.monotonic() < self._stale_s:
            return self._message
        if isinstance(self._message, ServiceHealth):
            reasons = ("nothing heard from the service",)
            return replace(self._message, quality="stale", state="stale", reasons=reasons)
        return replace(self._message, quality="stale")

    @property
    def _stale_s(self) -> float:
        return self._arrived_s + max(self._silent_s, 3.0 * self._gap_s)

    def _take(self, data: bytes | Mapping[str, Any]) -> None:
        """Take a message; runs in the thread of the event loop. An invalid message is ignored."""
        message = message_from(self._kind, data)
        if message is None:
            return
        now_s = time.monotonic()
        self._gap_s = now_s - self._arrived_s if self._count else 0.0
        self._message, self._arrived_s = message, now_s
        self._count += 1
        old_event, self._new_message = self._new_message, asyncio.Event()
        old_event.set()

    async def __aiter__(self) -> AsyncIterator[Message]:
        count_read, was_stale = 0, False
        while True:
            new_message, last = self._new_message, self.last
            is_stale = last is not None and last is not self._message
            if last is not None and (self._count != count_read or (is_stale and not was_stale)):
                count_read, was_stale = self._count, is_stale
                yield last
                continue
            wait_s = None if self._message is None or is_stale else self._stale_s - time.monotonic()
            try:
                await asyncio.wait_for(
                    new_message.wait(), None if wait_s is None else max(wait_s, 0.0) + 0.01
                )
            except TimeoutError:
                continue


class ServiceClient:
    """A running service: `async with observer.connect(…) as service`.

    `machine` and `axis` identify it, `command` gives it commands. `heat`, `field`, `error`, `health` and
    `alarms` are streams. Each has the service's last message in `last` when the client is connected.

    Attributes:
        machine: Name of the machine; `*` until the service has answered.
        axis: Name of the axis; `*` until the service has answered.
        heat: Stream of `ServiceHeat`, a message each step.
        field: Stream of `ServiceField`, at most `publish.field_rate_Hz`.
        error: Stream of `ServiceThermalError`, at most `publish.field_rate_Hz`.
        health: Stream of `ServiceHealth`, on change and every 5 s.
        alarms: Stream of `ServiceAlarms`, on change and every 5 s.
    """

    machine: str
    axis: str

    def __init__(self, endpoint: str, machine: str, axis: str, timeout_s: float) -> None:
        self._endpoint, self._timeout_s = endpoint, timeout_s
        self.machine, self.axis = machine, axis

    async def __aenter__(self) -> ServiceClient:
        self.heat = ServiceStream(ServiceHeat, _STEP_S)
        self.field = ServiceStream(ServiceField, _STEP_S)
        self.error = ServiceStream(ServiceThermalError, _STEP_S)
        self.health = ServiceStream(ServiceHealth, _REPORT_S)
        self.alarms = ServiceStream(ServiceAlarms, _REPORT_S)
        health = await self._ask("health", self._timeout_s)
        self._session = await asyncio.to_thread(self._open)
        try:
            self._subscribe(asyncio.get_running_loop())
            self.health._take(health)
            for name, document in (await asyncio.to_thread(self._estimate)).items():
                self._join(getattr(self, name), document)
            if (alarms := await asyncio.to_thread(self._answer, "alarms")) is not None:
                self._join(self.alarms, alarms)
        except BaseException:
            await self.__aexit__(None, None, None)
            raise
        return self

    async def __aexit__(self, *_error: object) -> None:
        await asyncio.to_thread(close_within, self._session, 1.0)

    async def command(self, kind: str, *, without: Sequence[str] = (), alarm: str | None = None) -> str:
        """Give the service a command and return its outcome in words.

        The service compares the hash of its configuration first, so a command never reaches another
        configuration than the one that was read.

        Args:
            kind: `arm`, `disarm`, `zero`, `reset` or `acknowledge`.
            without: Names of sensors that arming may do without although they are excluded or missing.
            alarm: The id of the alarm to acknowledge; None for all.

        Raises:
            UserError: The command or a name is unknown, the service does not answer within the timeout, or it
                refuses, with its reason.
        """
        if kind not in KINDS:
            raise UserError(f"there is no command {kind!r}; give one of {', '.join(KINDS)}")
        parameters = {"without": ",".join(without)} if without else {}
        parameters |= {"id": alarm} if alarm is not None else {}
        if strange := [text for text in parameters.values() if not _NAMES.fullmatch(text)]:
            raise UserError(f"{strange[0]!r} is not a name; names consist of letters, digits and _.-")
        reply = await asyncio.to_thread(command, kind, self._address, self._timeout_s, parameters=parameters)
        if reply.document is None:
            raise UserError(reply.problem)
        text = str(reply.document.get("text", ""))
        if reply.document.get("done") is not True:
            raise UserError(text)
        return text

    @property
    def _address(self) -> Address:
        return Address(self._endpoint, self.machine, self.axis)

    async def _ask(self, key: str, timeout_s: float) -> dict[str, Any]:
        """Return the document under a key, and adopt the machine and axis of the reply. Raises
        `UserError`.
        """
        reply = await asyncio.to_thread(ask, self._address, key, timeout_s)
        if reply.document is None:
            raise UserError(reply.problem)
        self.machine, self.axis = reply.source
        return reply.document

    def _open(self) -> zenoh.Session:
        try:
            return zenoh.open(client_config((self._endpoint,), None))
        except zenoh.ZError:
            raise UserError(f"the service at {self._endpoint} answered and is gone; connect again") from None

    def _subscribe(self, loop: asyncio.AbstractEventLoop) -> None:
        def into(take: Callable[[bytes], None]) -> Callable[[zenoh.Sample], None]:
            def hand_over(sample: zenoh.Sample) -> None:
                if not loop.is_closed():
                    loop.call_soon_threadsafe(take, sample.payload.to_bytes())

            return hand_over

        for name in ("heat", "field", "error", "health", "alarms"):
            stream: ServiceStream[Any] = getattr(self, name)
            self._session.declare_subscriber(f"{self._prefix}/{name}", into(stream._take))

    @property
    def _prefix(self) -> str:
        return f"ballscrew/{self.machine}/{self.axis}"

    def _answer(self, key: str) -> bytes | None:
        """Return the last message of a key, None without one."""
        for reply in self._session.get(f"{self._prefix}/{key}", timeout=self._timeout_s):
            if reply.ok is not None:
                return bytes(reply.ok.payload.to_bytes())
        return None

    def _estimate(self) -> dict[str, dict[str, Any]]:
        """Return the documents of the last estimate by stream, empty where it is missing or cannot be
        decoded.
        """
        data = self._answer("estimate")
        try:
            return {} if data is None else documents_of(decode_estimate(data))
        except ValueError:
            return {}

    @staticmethod
    def _join(stream: ServiceStream[Any], data: bytes | Mapping[str, Any]) -> None:
        """Begin the stream with this message, unless it has received a newer one."""
        if stream.last is None:
            stream._take(data)


def connect(
    endpoint: str = "tcp/127.0.0.1:7447", machine: str = "*", axis: str = "*", *, timeout_s: float = 10.0
) -> ServiceClient:
    """Return a client of a running service, to be entered: `async with observer.connect() as service`.

    Nothing is opened before it is entered.

    Args:
        endpoint: Zenoh endpoint of the service or of a router.
        machine: Name of the machine; `*` for the first that answers.
        axis: Name of the axis; `*` for the first that answers.
        timeout_s: Longest wait for each answer of the service.

    Raises:
        UserError: On entering, if no service answers within `timeout_s`; the sentence lists the axes that do.
    """
    return ServiceClient(endpoint, machine, axis, timeout_s)
