"""Publishes estimates on Zenoh: nothing here waits for a network, and unsent messages are counted.

The session opens in a thread of its own, which retries for ever, so a missing router delays nothing.
Publishers drop rather than wait (`CongestionControl.DROP`): a slow subscriber must not stall the estimator.
"""

from __future__ import annotations

import atexit
import contextlib
import math
import os
import shutil
import tempfile
import threading
import time
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple, Protocol

import structlog
import zenoh

from observer.bus.answers import Responder
from observer.bus.codec import EstimateEncoder, to_json
from observer.bus.exchange import KEYS, KINDS, Command, PastAccess, PublishStatus
from observer.bus.session import (
    LEASE_MS,
    LOCAL,
    MOST_BYTES,
    RETRY_MS,
    close,
    close_within,
    ear_config,
    service_config,
    session_config,
    short,
)
from observer.config.publishing import Publish
from observer.frames import EstimateBlock, FrameBlock, Layout

_LOOK_S = 0.05
_LONGEST_SOCKET_BYTES = 107  # of a path, by Linux
_LINKED_S = 1.5  # by then a peer is linked to its router, or there is none
_GONE_S = LEASE_MS / 1000 + 1.0  # by then the token of a dead service is gone

log = structlog.get_logger()


def key_prefix(machine: str, axis: str) -> str:
    """Return the key expression below which everything about one axis is published."""
    return f"ballscrew/{machine}/{axis}"


@dataclass(frozen=True, slots=True)
class _Link:
    """An open session and its declarations."""

    session: zenoh.Session
    publishers: dict[str, zenoh.Publisher]
    queryables: dict[str, Any]
    duplicates: DuplicateServiceDetector | None
    declarations: tuple[Any, ...]

    def close(self) -> None:
        """End the sessions, however long it takes."""
        if self.duplicates is not None:
            self.duplicates.close()
        close(self.session)


class Outlets(Protocol):
    """The process of page and plant, a client beside the service; no method waits for it but `close`."""

    @property
    def reason(self) -> str | None:
        """A problem in one sentence; None without."""

    @property
    def unsent(self) -> Mapping[str, Mapping[str, float]]:
        """The size of the messages to be sent late, by outlet: `steps` and `duration_s`; empty if none are
        missing.
        """

    def start(self, endpoint: str) -> None:
        """Begin to start the process, a client of that endpoint; returns at once."""

    def take(self, report: bytes) -> None:
        """Take the states that the process publishes of its outlets; from any thread."""

    def close(self, timeout_s: float) -> bool:
        """End, waiting at most `timeout_s`; return whether it ended in that time."""


class ServiceIdentity(NamedTuple):
    """The axis of a service, and the instance that every message carries.

    Attributes:
        machine: The machine's name.
        axis: The axis' name.
        instance: Eight hexadecimal digits, new at each start.
    """

    machine: str
    axis: str
    instance: str


class ZenohPublisher:
    """Publishes estimates and health of one axis; answers for configuration, health and last estimates.

    A message without a connection is dropped and counted. Zenoh opens lost links again. The thread that opens
    the session also answers queries, and retries for ever.
    """

    def __init__(
        self,
        identity: ServiceIdentity,
        settings: Publish,
        config_json: str,
        layout: Layout,
        *,
        offers: Collection[str] = (),
        outlets: Outlets | None = None,
        past: PastAccess | None = None,
    ) -> None:
        """Prepare to publish; nothing is opened before `start`.

        Args:
            identity: Axis and instance.
            settings: The table `[publish]`.
            config_json: The answer to the key `config`.
            layout: Names and places of the outputs.
            offers: Those of `compensation`, `forecast` and `probing` that run; other keys that need them are
                left out.
            outlets: The process of page and plant. It gets a session of its own, on a socket that this
                user's processes alone can reach; None without.
            past: Answers for past times; None where nothing is recorded.

        Raises:
            ConfigError: If a file of keys or passwords cannot be used.
        """
        instance = identity.instance
        self._prefix = key_prefix(identity.machine, identity.axis)
        self._settings = settings
        self._config, self._ear = service_config(settings), ear_config(settings)
        self._instance = instance
        self._encoder = EstimateEncoder(layout, instance)
        self._last_step: dict[str, Any] = {
            "sequence": None,
            "sensors_used": 0,
            "sensors": len(layout.sensors),
        }
        of_layout = {"expansion": layout.has_error, "learned": bool(layout.learned)}
        met = {None, *offers, *(need for need, is_met in of_layout.items() if is_met)}
        self._keys = {name: key for name, key in KEYS.items() if key.needs in met}
        self._answers = Responder(self._prefix, config_json.encode(), settings.history, instance, past)
        self._slots: dict[str, int] = {}
        self._link: _Link | None = None
        self._local: _Link | None = None
        self._folder: str | None = None
        self._no_socket: str | None = None
        self._connected = self._was_connected = self._settled = False
        self._published = self._dropped = self._reconnects = 0
        self._reason: str | None = "Zenoh: the session is not open yet"
        self._taken: str | None = None
        self._outlets, self._past = outlets, past
        self._closing = threading.Event()
        self._threads = [
            threading.Thread(target=run, name=f"zenoh-{name}", daemon=True)
            for name, run in (("open", self._run), ("answer", self._answer))
        ]

    @property
    def status(self) -> PublishStatus:
        """The state of publishing: counts, and the most severe problem in one sentence, None without."""
        link = self._link
        duplicate = link.duplicates.reason if link is not None and link.duplicates is not None else None
        outlets_reason = self._outlets.reason if self._outlets else None
        alive = self._closing.is_set() or all(t.is_alive() or t.ident is None for t in self._threads)
        dead = None if alive else "Zenoh: the thread that answers has died; restart the service"
        return PublishStatus(
            self._connected,
            self._published,
            self._dropped,
            self._reconnects,
            dead or self._taken or duplicate or self._reason or self._no_socket or outlets_reason,
            self._settled or not alive,
            self._taken,
            duplicate,
            alive,
            self._outlets.unsent if self._outlets else {},
        )

    def start(self) -> None:
        """Begin to open the session; returns at once.

        A process that leaves it open closes it on exit: Python ends threads wherever they
        are, and one ended within Zenoh aborts the process (SIGABRT).
        """
        atexit.register(self.close)
        for thread in self._threads:
            thread.start()

    def commands(self) -> list[Command]:
        """Return the commands that came since the last call."""
        return self._answers.commands()

    def publish(self, block: EstimateBlock, sequence: int) -> None:
        """Publish a block of one estimate, and the documents made of it that are due.

        Only the loop's thread may call it. It never waits.

        Args:
            block: One estimate.
            sequence: Its number.
        """
        self._last_step = {"sequence": sequence, **self._encoder.counts(block, 0)}
        estimate = self._encoder.cbor(block, 0, sequence)
        self._answers.estimates.append(estimate)
        self._put("estimate", estimate)
        os.sched_yield()  # so that it is sent before the rest is encoded, where cores are few
        for name, document in self._encoder.documents.items():
            if name in self._keys and self._is_due(name, float(block.time_s[0])):
                self._put(name, document(block, 0, sequence))

    def _is_due(self, name: str, time_s: float) -> bool:
        """Whether a key that has a rate may be published again."""
        rate_Hz = self._keys[name].rate_Hz
        if rate_Hz is None:
            return True
        slot = math.floor(
            time_s * (getattr(self._settings, rate_Hz) if isinstance(rate_Hz, str) else rate_Hz)
        )
        before, self._slots[name] = self._slots.get(name), slot
        return slot != before

    def readings(self, frame: FrameBlock, sequence: int) -> None:
        """Publish the readings behind the estimate of this number.

        Args:
            frame: A frame of one step.
            sequence: The estimate's number.
        """
        self._put("readings", self._encoder.readings(frame, 0, sequence))

    def document(self, key: str, document: Mapping[str, Any]) -> None:
        """Publish a document, which also answers queries for it; from any thread.

        It gets the number of the last step and that step's counts of sensors, where it has none of its own.

        Args:
            key: The key below the axis, one of those that this service offers.
            document: Plain data without NaN.

        Raises:
            ValueError: If the document holds NaN or an infinity.
        """
        self._put(key, to_json(self._last_step | dict(document)))

    def close(self, timeout_s: float = 1.0) -> bool:
        """End the outlets, and the sessions.

        Args:
            timeout_s: The longest wait, in s; half of it for the outlets.

        Returns:
            Whether the sessions were closed in that time; otherwise a daemon thread goes on closing.
        """
        atexit.unregister(self.close)
        self._closing.set()
        end_s = time.monotonic() + timeout_s
        if self._past is not None:
            self._past.close()
        if self._outlets is not None:
            self._outlets.close(timeout_s / 2)
        links, self._link, self._local = (self._link, self._local), None, None
        closed = [link is None or close_within(link, max(end_s - time.monotonic(), 0.0)) for link in links]
        if self._folder is not None:
            shutil.rmtree(self._folder, ignore_errors=True)
        for thread in self._threads:
            if thread.ident is not None:
                thread.join(max(end_s - time.monotonic(), 0.0))
        return all(closed)

    def _put(self, key: str, payload: bytes) -> None:
        if key != "estimate" and KEYS[key].query_answer is not None:
            self._answers.documents[key] = payload
        link, local = self._link, self._local
        if local is not None:
            with contextlib.suppress(zenoh.ZError):  # it is being closed
                local.publishers[key].put(payload)
        if link is None:
            self._dropped += 1
            return
        try:
            link.publishers[key].put(payload)
            self._published += self._connected
            self._dropped += not self._connected
        except zenoh.ZError as error:
            self._dropped += 1
            self._reason = f"Zenoh: a message was refused ({short(error)}); restart the service"

    def _run(self) -> None:
        """Open the session, however long it takes, then watch the connection."""
        while not self._closing.is_set() and self._link is None:
            try:
                self._open()
            except zenoh.ZError as error:
                self._reason = f"Zenoh: no session ({short(error)}); check publish.connect and publish.listen"
            self._settled = True
            if self._link is None:
                self._closing.wait(RETRY_MS / 1000)
        if self._closing.is_set() and (late := self._link) is not None:
            late.close()  # it opened after `close` had looked
        while (link := self._link) is not None and not self._closing.wait(_LOOK_S):
            with self._disturbed_if_it_fails():
                self._look(link)
                if link.duplicates is not None:
                    link.duplicates.watch()

    def _answer(self) -> None:
        """Answer queries from everywhere, and start the outlets as soon as that is possible."""
        tried_s = -math.inf
        while not self._closing.wait(_LOOK_S):
            if (
                self._outlets is not None
                and self._local is None
                and time.monotonic() - tried_s >= RETRY_MS / 1000
            ):
                self._open_local(self._outlets)
                tried_s = time.monotonic()
            for link in (self._link, self._local):
                if link is not None:
                    with self._disturbed_if_it_fails():
                        self._answers.answer(link.queryables)

    @contextlib.contextmanager
    def _disturbed_if_it_fails(self) -> Iterator[None]:
        """Report an error of a session, which is being closed if it is not a defect; it is tried again."""
        try:
            yield
        except zenoh.ZError as error:
            self._reason = f"Zenoh: the session is disturbed ({short(error)}); restart the service"

    def _open_local(self, outlets: Outlets) -> None:
        """Try once to open the session of the outlets, and start them."""
        try:
            self._folder = self._folder or tempfile.mkdtemp(prefix="observer-")
            socket = f"{self._folder}/bus"
            if len(os.fsencode(socket)) > _LONGEST_SOCKET_BYTES:
                self._no_socket = f"outlets: no socket can be {socket}; set TMPDIR to a shorter path"
                return
            endpoint = f"{LOCAL}/{socket}"
            session = zenoh.open(session_config("peer", (), (endpoint,), MOST_BYTES))
        except (OSError, zenoh.ZError) as error:
            self._no_socket = f"outlets: no socket for them ({short(error)}); make room for temporary files"
            return
        report = session.declare_subscriber(
            f"{self._prefix}/outlets", lambda sample: outlets.take(sample.payload.to_bytes())
        )
        self._local, self._no_socket = self._declare(session, None, report, kinds=("acknowledge",)), None
        outlets.start(endpoint)

    def _open(self) -> None:
        session = zenoh.open(self._config)
        duplicates = DuplicateServiceDetector(session, self._ear, self._prefix, self._instance)
        if self._has_axis_alone(session, duplicates):
            self._link = self._declare(session, duplicates)
        else:
            duplicates.close()
            close(session)

    def _has_axis_alone(self, session: zenoh.Session, duplicates: DuplicateServiceDetector) -> bool:
        """Wait until no other service has this axis; returns False if this one is closed before."""
        end_s = time.monotonic() + _LINKED_S
        while self._settings.connect and not session.info.transports() and time.monotonic() < end_s:
            self._closing.wait(_LOOK_S)
        end_s = time.monotonic() + _GONE_S
        while not self._closing.is_set():
            if not duplicates.token_is_there():
                self._taken = None
                return True
            if time.monotonic() >= end_s:
                self._taken = (
                    f"another service runs as {self._prefix}; end it, or give this one another machine.name "
                    "or machine.axis"
                )
                self._settled = True
            self._closing.wait(RETRY_MS / 1000)
        return False

    def _look(self, link: _Link) -> None:
        """Note whether anybody is connected; a session that only listens needs nobody."""
        connected = not self._settings.connect or bool(link.session.info.transports())
        self._reconnects += connected and self._was_connected and not self._connected
        self._was_connected |= connected
        self._connected = connected
        endpoints = ", ".join(self._settings.connect)
        self._reason = None if connected else f"Zenoh: nobody answers at {endpoints}; start the router"

    def _declare(
        self,
        session: zenoh.Session,
        duplicates: DuplicateServiceDetector | None,
        *declarations: Any,
        kinds: Sequence[str] = KINDS,
    ) -> _Link:
        """Declare on a session what is published and answered there; `declarations` stay as long as it."""
        publishers = {
            name: session.declare_publisher(
                f"{self._prefix}/{name}",
                encoding=key.encoding,
                congestion_control=zenoh.CongestionControl.DROP,
                express=name == "estimate",
            )
            for name, key in self._keys.items()
            if key.sent is not None
        }
        queryables = self._answers.declare(session, self._keys, kinds)
        tokens = [
            session.liveliness().declare_token(f"{self._prefix}/{key}")
            for key in ("alive", f"alive/{self._instance}")
        ]
        return _Link(session, publishers, queryables, duplicates, (*tokens, *declarations))


_QUERY_S = 1.0
_RETRY_S = 2.0
_POLL_S = 0.02


class DuplicateServiceDetector:
    """Finds other services of the same axis by their liveliness tokens.

    Each service has two: `alive`, and `alive/<instance>`, by which services that run at once are told apart.
    A router does not pass a peer what its other peers declare. Where `ear` is given, a session of that
    configuration, a client of the same router, listens in its place as soon as it can be opened.

    Args:
        session: The service's session.
        ear: The configuration of the session that listens; None listens on `session`.
        prefix: The key expression of the axis.
        instance: The instance of this service, whose own token does not count.
    """

    def __init__(self, session: zenoh.Session, ear: zenoh.Config | None, prefix: str, instance: str) -> None:
        self._session = session
        self._ear = ear
        self._own: zenoh.Session | None = None
        self._opened_s = -math.inf
        self._prefix = prefix
        self._instance = instance
        self._subscriber: Any = None
        self._others: set[str] = set()

    def token_is_there(self) -> bool:
        """Whether somebody holds the axis' liveliness token; it waits up to one second for answers.

        Raises:
            zenoh.ZError: If the session is closed.
        """
        session = self._listener()
        if session is None:
            return False
        key = f"{self._prefix}/alive"
        replies = session.liveliness().get(key, zenoh.handlers.FifoChannel(1), timeout=_QUERY_S)
        end_s = time.monotonic() + _QUERY_S
        while time.monotonic() < end_s:
            try:
                reply = replies.try_recv()
            except zenoh.ZError:
                return False  # everybody has answered
            if reply is not None and reply.ok is not None:
                return True
            time.sleep(_POLL_S)
        return False

    def watch(self) -> None:
        """Begin to watch the tokens of other services, once their listener is open; does not wait.

        Raises:
            zenoh.ZError: If the session is closed.
        """
        if self._subscriber is None and (session := self._listener()) is not None:
            self._subscriber = session.liveliness().declare_subscriber(
                f"{self._prefix}/alive/*", self._note, history=True
            )

    def _note(self, token: zenoh.Sample) -> None:
        instance = str(token.key_expr).rpartition("/")[2]
        if token.kind == zenoh.SampleKind.DELETE:
            self._others.discard(instance)
        elif instance != self._instance:
            self._others.add(instance)

    def _listener(self) -> zenoh.Session | None:
        """The session that receives from the others; None if it cannot be opened yet."""
        if self._ear is None or self._own is not None:
            return self._own or self._session
        if time.monotonic() - self._opened_s >= _RETRY_S:
            try:
                self._own = zenoh.open(self._ear)
            except zenoh.ZError:
                self._opened_s = time.monotonic()
        return self._own

    def close(self) -> None:
        """End the session that only listens.

        The session given by the service stays open.
        """
        if self._own is not None:
            close(self._own)

    @property
    def reason(self) -> str | None:
        """A sentence on another service that runs at once; None without one."""
        instance = next(iter(self._others.copy()), None)
        if instance is None:
            return None
        return f"another service runs as {self._prefix} (instance {instance}); end one of the two"
