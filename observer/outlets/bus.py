"""The bus as outlets use it: an ordinary client of Zenoh that hears every key of an axis.

Documents that are published on change only are queried when the service appears, also after its restart,
and again while its configuration has not been heard. Another start of the service may publish less than the
one before, so its first message drops all earlier ones.
"""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable
from typing import Any

import structlog
import zenoh

from observer.bus.codec import instance_of
from observer.bus.exchange import KEYS, RETAINED
from observer.bus.session import RETRY_MS, client_config, close_within, short
from observer.outlets.start import STATES, OutletState, Start

_REPORT_S = 1.0
_QUERY_S = 10.0
_ASKED = tuple(key for key in RETAINED if KEYS[key].query_answer is not None)

log = structlog.get_logger()


class Bus:
    """Passes each message of an axis to `put`, from threads of Zenoh, and publishes the outlets' states.

    `forget` is called when the service has started again, before its first message.
    """

    def __init__(
        self,
        start: Start,
        put: Callable[[str, bytes], None],
        forget: Callable[[], None],
        *,
        reports: bool,
    ) -> None:
        """Take where to connect; with `reports` the states of the outlets are published, else logged.

        Raises:
            ConfigError: If a file of the login cannot be used.
        """
        self._start, self._put, self._forget, self._reports = start, put, forget, reports
        self._config = client_config((start.connect,), start.client)
        self._states: dict[str, OutletState] = {}
        self._session: zenoh.Session | None = None
        self._heard: set[str] = set()
        self._instance: str | None = None
        self._asked_s = -math.inf
        self._order, self._reporting = threading.Lock(), threading.Lock()
        self._closing = threading.Event()
        self._thread = threading.Thread(target=self._run, name="bus", daemon=True)

    def start(self) -> None:
        """Begin to connect; returns at once."""
        self._thread.start()

    def report(self, name: str, changes: dict[str, Any]) -> None:
        """Report what has changed in the state of an outlet; from any thread."""
        with self._reporting:
            before = self._states.get(name)
            state = OutletState(**({} if before is None else before.model_dump()) | changes)
            self._states[name] = state
        if self._reports:
            self._publish()
            return
        state.log_change(name, before)
        if state.reason is not None and (before is None or before.reason != state.reason):
            log.warning("outlet", name=name, reason=state.reason)

    def close(self, timeout_s: float) -> None:
        """End the session."""
        self._closing.set()
        if self._session is not None:
            close_within(self._session, timeout_s)

    def _run(self) -> None:
        has_said = False
        while self._session is None and not self._closing.is_set():
            try:
                self._session = zenoh.open(self._config)
            except zenoh.ZError as error:
                if not has_said:
                    log.warning("no bus yet", connect=self._start.connect, reason=short(error))
                has_said = True
                self._closing.wait(RETRY_MS / 1000)
        if (session := self._session) is None:
            return
        prefix = self._start.prefix
        # kept: a declaration lasts as long as its object
        declared = [
            session.declare_subscriber(f"{prefix}/*", self._hear, allowed_origin=zenoh.Locality.REMOTE),
            session.liveliness().declare_subscriber(f"{prefix}/alive", self._look, history=True),
        ]
        while declared and not self._closing.wait(_REPORT_S):
            if self._reports:
                self._publish()
            if "config" not in self._heard and time.monotonic() - self._asked_s >= _QUERY_S:
                self._ask()

    def _publish(self) -> None:
        """Publish the states, which are published again each second: one may get lost, and silence tells
        the service that the process hangs.
        """
        with self._reporting:
            if (session := self._session) is not None:
                session.put(f"{self._start.prefix}/outlets", STATES.dump_json(self._states))

    def _hear(self, sample: zenoh.Sample, *, is_answer: bool = False) -> None:
        key = str(sample.key_expr).rpartition("/")[2]
        if key not in KEYS:
            return
        payload = sample.payload.to_bytes()
        instance = instance_of(payload)
        with self._order:
            if instance not in {None, self._instance}:
                if self._instance is not None:
                    self._forget()
                    self._heard.clear()
                    self._asked_s = -math.inf
                self._instance = instance
            if is_answer and key in self._heard:  # it is older than what has been published meanwhile
                return
            self._heard.add(key)
            self._put(key, payload)

    def _look(self, token: zenoh.Sample) -> None:
        """Where the service appears, ask for its documents."""
        with self._order:
            self._heard.clear()
        if token.kind == zenoh.SampleKind.PUT:
            self._ask()

    def _ask(self) -> None:
        self._asked_s = time.monotonic()
        if (session := self._session) is not None:
            for key in _ASKED:
                session.get(f"{self._start.prefix}/{key}", self._take_answer, timeout=_QUERY_S)

    def _take_answer(self, reply: zenoh.Reply) -> None:
        if reply.ok is not None:
            self._hear(reply.ok, is_answer=True)
