"""Estimates to Zenoh: nothing here waits for a network, and what did not go out is counted.

The session opens in a thread of its own and tries for ever, so a router that is missing holds up nothing.
Publishers drop rather than wait (`CongestionControl.DROP`): a slow subscriber must not stall the estimator.
"""

from __future__ import annotations

import json
import math
import threading
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from itertools import islice
from typing import Any

import zenoh

from observer.config import Publish
from observer.frames import EstimateBlock, Layout
from observer.publish.codec import (
    ESTIMATE_ENCODING,
    ESTIMATES_ENCODING,
    JSON_ENCODING,
    EstimateEncoder,
    array_of,
)

DEFAULT_LISTEN = "tcp/127.0.0.1:7447"
_LEASE_MS = 2000
_CONNECT_MS = 1000
_RETRY_MS = 250  # Zenoh's own pauses grow to 4 s; a router that returns is to be met within a second
_LOOK_S = 0.05
_QUERIES = 64


def key_prefix(machine: str, axis: str) -> str:
    """Where everything about one axis is published."""
    return f"ballscrew/{machine}/{axis}"


def session_config(mode: str, connect: tuple[str, ...], listen: tuple[str, ...]) -> zenoh.Config:
    """A Zenoh configuration that talks to the named endpoints and to nobody else."""
    config = zenoh.Config()
    for key, value in {
        "mode": mode,
        "connect/endpoints": list(connect),
        "connect/timeout_ms": _CONNECT_MS if mode == "client" else -1,
        "connect/exit_on_failure": mode == "client",
        "connect/retry": {
            "period_init_ms": _RETRY_MS,
            "period_max_ms": _RETRY_MS,
            "period_increase_factor": 1,
        },
        "listen/endpoints": list(listen),
        "scouting/multicast/enabled": False,
        "open/return_conditions/connect_scouted": False,
        "transport/link/tx/lease": _LEASE_MS,
        "transport/shared_memory/enabled": False,
    }.items():
        config.insert_json5(key, json.dumps(value))
    return config


def listening(settings: Publish) -> tuple[str, ...]:
    """Where a session of these settings listens: on loopback, if it is told no place and nobody to go to."""
    if settings.listen or settings.connect or settings.mode == "client":
        return settings.listen
    return (DEFAULT_LISTEN,)


def close_within(session: zenoh.Session, timeout_s: float) -> bool:
    """Close a session, giving up when a frozen peer does not answer; says whether it closed."""
    thread = threading.Thread(target=_close, args=(session,), name="zenoh-close", daemon=True)
    thread.start()
    thread.join(timeout_s)
    return not thread.is_alive()


def _close(session: zenoh.Session) -> None:
    try:
        session.close()  # type: ignore[no-untyped-call]
    except zenoh.ZError:
        return  # a frozen router does not confirm; there is nobody left to tell


@dataclass(frozen=True, slots=True)
class PublishStatus:
    """How publishing stands; `reason` says in one sentence what is wrong, None if nothing is."""

    connected: bool = False
    published: int = 0
    dropped: int = 0
    reconnects: int = 0
    reason: str | None = None


@dataclass(frozen=True, slots=True)
class _Link:
    """An open session and what is declared on it."""

    session: zenoh.Session
    publishers: dict[str, zenoh.Publisher]
    queryables: dict[str, Any]
    alive: Any


class ZenohPublisher:
    """Publishes estimates and health of one axis; answers for configuration, health and last estimates."""

    def __init__(
        self,
        machine: str,
        axis: str,
        settings: Publish,
        config_json: str,
        layout: Layout,
        on_arm: Callable[[], None] | None = None,
    ) -> None:
        """Take what is published; with `on_arm` also a compensation, which a query may arm."""
        self._on_arm = on_arm
        self._compensation: bytes | None = None
        self._prefix = key_prefix(machine, axis)
        self._settings = settings
        self._config_json = config_json.encode()
        self._encoder = EstimateEncoder(layout)
        self._has_error = layout.has_error
        self._history: deque[bytes] = deque(maxlen=settings.history)
        self._health: bytes | None = None
        self._field_slot = -math.inf
        self._link: _Link | None = None
        self._connected = self._was_connected = False
        self._published = self._dropped = self._reconnects = 0
        self._reason: str | None = "Zenoh: the session is not open yet"
        self._closing = threading.Event()
        self._thread = threading.Thread(target=self._run, name="zenoh-open", daemon=True)

    @property
    def _optional(self) -> tuple[str, ...]:
        """The keys that are there only if the configuration asks for them."""
        return () if self._on_arm is None else ("compensation",)

    @property
    def status(self) -> PublishStatus:
        """How publishing stands."""
        return PublishStatus(self._connected, self._published, self._dropped, self._reconnects, self._reason)

    def start(self) -> None:
        """Begin to open the session; returns at once."""
        self._thread.start()

    def publish(self, block: EstimateBlock, sequence: int) -> None:
        """Publish a block of one estimate: `estimate` and `heat`; `field` and `error` at their rate."""
        estimate = self._encoder.cbor(block, 0, sequence)
        self._history.append(estimate)
        self._put("estimate", estimate)
        self._put("heat", self._encoder.heat(block, 0, sequence))
        slot = math.floor(block.time_s[0] * self._settings.field_rate_Hz)
        if slot != self._field_slot:
            self._field_slot = slot
            self._put("field", self._encoder.field(block, 0, sequence))
            if self._has_error:
                self._put("error", self._encoder.error(block, 0, sequence))

    def health(self, document: bytes) -> None:
        """Publish a health document, which also answers those who ask for it."""
        self._health = document
        self._put("health", document)

    def compensation(self, document: bytes) -> None:
        """Publish a compensation document, which also answers those who ask for it."""
        self._compensation = document
        self._put("compensation", document)

    def close(self, timeout_s: float = 1.0) -> bool:
        """End the session; says whether it was closed in that time."""
        self._closing.set()
        link, self._link = self._link, None
        return link is None or close_within(link.session, timeout_s)

    def _put(self, key: str, payload: bytes) -> None:
        link = self._link
        if link is None:
            self._dropped += 1
            return
        try:
            link.publishers[key].put(payload)
            self._published += self._connected
            self._dropped += not self._connected
        except zenoh.ZError as error:
            self._dropped += 1
            self._reason = f"Zenoh: a message was refused ({error})"

    def _run(self) -> None:
        """Open the session, however long it takes, then watch whether anybody is at the other end."""
        settings = self._settings
        while not self._closing.is_set() and self._link is None:
            try:
                config = session_config(settings.mode, settings.connect, listening(settings))
                session = zenoh.open(config)
                self._link = self._declare(session)
            except zenoh.ZError as error:
                self._reason = (
                    f"Zenoh: no session ({_short(error)}); check publish.connect and publish.listen"
                )
                self._closing.wait(_RETRY_MS / 1000)
        if self._closing.is_set() and (late := self._link) is not None:
            _close(late.session)  # it opened after `close` had looked
        while (link := self._link) is not None and not self._closing.wait(_LOOK_S):
            try:
                self._look(link)
                self._answer(link)
            except zenoh.ZError:
                return  # the session has closed

    def _look(self, link: _Link) -> None:
        """See whether anybody is at the other end; a session that only listens needs nobody."""
        connected = not self._settings.connect or bool(link.session.info.transports())
        self._reconnects += connected and self._was_connected and not self._connected
        self._was_connected |= connected
        self._connected = connected
        endpoints = ", ".join(self._settings.connect)
        self._reason = None if connected else f"Zenoh: nobody answers at {endpoints}; start the router"

    def _declare(self, session: zenoh.Session) -> _Link:
        publishers = {
            key: session.declare_publisher(
                f"{self._prefix}/{key}",
                encoding=ESTIMATE_ENCODING if key == "estimate" else JSON_ENCODING,
                congestion_control=zenoh.CongestionControl.DROP,
                express=key == "estimate",
            )
            for key in ("estimate", "heat", "field", "error", "health", *self._optional)
        }
        queryables = {
            key: session.declare_queryable(
                f"{self._prefix}/{key}", zenoh.handlers.RingChannel(_QUERIES), complete=True
            )
            for key in ("config", "estimate", "health", *self._optional)
        }
        alive = session.liveliness().declare_token(f"{self._prefix}/alive")
        return _Link(session, publishers, queryables, alive)

    def _answer(self, link: _Link) -> None:
        """Answer the queries that wait. They are asked for now and then, because a thread that waits inside
        the library aborts the process when the interpreter ends.
        """
        answers = {
            "config": self._reply_config,
            "estimate": self._reply_estimate,
            "health": self._reply_health,
            "compensation": self._reply_compensation,
        }
        for key in link.queryables:
            reply = answers[key]
            while (query := link.queryables[key].try_recv()) is not None:
                with query:
                    reply(query)

    def _reply_config(self, query: Any) -> None:
        query.reply(f"{self._prefix}/config", self._config_json, encoding=JSON_ENCODING)

    def _reply_health(self, query: Any) -> None:
        if self._health is None:
            query.reply_err("no health report yet")
        else:
            query.reply(f"{self._prefix}/health", self._health, encoding=JSON_ENCODING)

    def _reply_compensation(self, query: Any) -> None:
        wanted = query.parameters.get("arm")
        if wanted is not None and wanted != "yes":
            query.reply_err(f"arm={wanted}: only arm=yes is known; an estimate that is not good disarms")
            return
        if wanted is not None and self._on_arm is not None:
            self._on_arm()
        if self._compensation is None:
            query.reply_err("no compensation yet")
        else:
            query.reply(f"{self._prefix}/compensation", self._compensation, encoding=JSON_ENCODING)

    def _reply_estimate(self, query: Any) -> None:
        last = query.parameters.get("last")
        history = list(self._history)
        if last is None and history:
            query.reply(f"{self._prefix}/estimate", history[-1], encoding=ESTIMATE_ENCODING)
        elif last is not None and last.isascii() and last.isdigit() and int(last) >= 1:
            wanted = list(islice(history, max(0, len(history) - int(last)), None))
            query.reply(f"{self._prefix}/estimate", array_of(wanted), encoding=ESTIMATES_ENCODING)
        else:
            query.reply_err("no estimate yet" if last is None else f"last={last}: give a whole number from 1")


def _short(error: Exception) -> str:
    """The first sentence of an error, without the places in its own source."""
    return str(error).split(" at /", 1)[0].splitlines()[0].rstrip(".")
