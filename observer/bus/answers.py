"""Answers to queries: bounded in size and number; no query can stop them.

Queries wait in rings, which a thread of the publisher empties periodically. A defect in answering one is
logged, at most every ten seconds, and the next query is answered.
"""

from __future__ import annotations

import json
import threading
import time
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from itertools import islice
from typing import Any

import structlog
import zenoh

from observer.bus.codec import array_of, to_json
from observer.bus.exchange import (
    ESTIMATE_ENCODING,
    ESTIMATES_ENCODING,
    JSON_ENCODING,
    KINDS,
    PAGE_ENCODING,
    Command,
    Key,
    Outcome,
    PastAccess,
    PastReply,
    plain_name,
)

_RING = 16
_WAITING = 4  # commands that wait for the next step
_BYTES_1_S = 4e6
_LOG_S = 10.0
_DIGITS = 6
LONGEST_ID = 250
_OF_THE_PAST = {"estimate": PAGE_ENCODING, "readings": JSON_ENCODING}
_TOO_MUCH = "too many requests at once; ask again in a second"
_NOT_RECORDED = "nothing is recorded; name a folder in record.directory"

log = structlog.get_logger()


class Budget:
    """A limit on the bytes sent: per second, and at once.

    Args:
        per_s: Bytes a second, and the most at once after a pause.
        clock: Gives s that never run back.
    """

    def __init__(self, per_s: float, clock: Callable[[], float] = time.monotonic) -> None:
        self._per_s = self._left = per_s
        self._clock = clock
        self._at_s = clock()

    def is_spent(self) -> bool:
        """Whether nothing more may be sent now.

        It also credits the time since the last call.
        """
        now_s = self._clock()
        self._left = min(self._per_s, self._left + (now_s - self._at_s) * self._per_s)
        self._at_s = now_s
        return self._left <= 0

    def spend(self, count: int) -> None:
        """Count what was sent; one answer may exceed what was left."""
        self._left -= count


class Responder:
    """Answers queries about one axis, and takes commands from authorised clients.

    `answer` runs in the publisher's thread. The loop calls `commands` and appends estimates and documents.

    Attributes:
        estimates: The last encoded estimates, oldest first.
        documents: The newest JSON document of each key.
    """

    def __init__(
        self, prefix: str, config_json: bytes, history: int, instance: str, past: PastAccess | None = None
    ) -> None:
        """Prepare to answer; nothing is declared yet.

        Args:
            prefix: The key expression of the axis, without a slash at its end.
            config_json: The answer to `config`; it has the `hash` that every command must name.
            history: How many estimates `last` can return.
            instance: Names the start of the service, in every answer to a command.
            past: Answers for past times; None where nothing is recorded.
        """
        self._past = past
        self._found_later: deque[tuple[str, Any, PastReply]] = deque()
        self._prefix = prefix
        self._config = config_json
        self._digest = json.loads(config_json).get("hash")
        self._instance = instance
        self.estimates: deque[bytes] = deque(maxlen=history)
        self.documents: dict[str, bytes] = {}
        self._commands: deque[Command] = deque()
        self._outcomes: deque[tuple[str, Any, Outcome]] = deque()
        self._budget = Budget(_BYTES_1_S)
        self._logged_s = -_LOG_S

    def declare(
        self, session: zenoh.Session, published: Mapping[str, Key], kinds: Sequence[str] = KINDS
    ) -> dict[str, Any]:
        """Declare on a session which of the keys answer, and the commands.

        Args:
            session: An open session, for which this is called once.
            published: The keys that this service publishes.
            kinds: The commands that this session takes.

        Returns:
            The queryables by key, to be passed to `answer`. Each keeps the last 16 queries.

        Raises:
            zenoh.ZError: If the session is closed.
        """
        keys = [name for name, key in published.items() if key.query_answer is not None]
        keys += [f"command/{kind}" for kind in kinds]
        return {
            key: session.declare_queryable(
                f"{self._prefix}/{key}", zenoh.handlers.RingChannel(_RING), complete=True
            )
            for key in keys
        }

    def commands(self) -> list[Command]:
        """Return the commands that came since the last call, oldest first.

        Each must be answered by its `answer`, unless it has `refused`: then the sender has its answer.
        """
        return [self._commands.popleft() for _ in range(len(self._commands))]

    def answer(self, queryables: dict[str, Any]) -> None:
        """Answer the queries that wait, a few of each kind, without waiting for a disk.

        A defect in answering one query is logged, and the next is answered.

        Args:
            queryables: What `declare` returned.

        Raises:
            zenoh.ZError: If the session is closed.
        """
        for query, reply in self._waiting(queryables):
            try:
                reply(query)
            except Exception:  # whatever was asked, the next one gets its answer
                if time.monotonic() - self._logged_s >= _LOG_S:
                    self._logged_s = time.monotonic()
                    log.error("a query could not be answered", exc_info=True)

    def _waiting(self, queryables: dict[str, Any]) -> Iterator[tuple[Any, Callable[[Any], None]]]:
        for _ in range(len(self._outcomes)):
            kind, query, outcome = self._outcomes.popleft()
            yield query, partial(self._reply_outcome, kind, outcome)
        for _ in range(len(self._found_later)):
            key, query, reply = self._found_later.popleft()
            yield query, partial(self._reply_past, key, reply)
        for key, channel in queryables.items():
            for _ in range(_RING):
                query = channel.try_recv()
                if query is None:
                    break
                yield query, partial(self._reply, key)

    def _reply(self, key: str, query: Any) -> None:
        if key.startswith("command/"):
            self._take_command(key, query)
            return
        if key in _OF_THE_PAST and any(query.parameters.get(name) is not None for name in ("from", "to")):
            self._ask_past(key, query)
            return
        with query:
            if self._budget.is_spent():
                query.reply_err(_TOO_MUCH)
                return
            answer = self._answer_to(key, query)
            if isinstance(answer, str):
                query.reply_err(answer)
                return
            payload, encoding = answer
            self._budget.spend(len(payload))
            query.reply(f"{self._prefix}/{key}", payload, encoding=encoding)

    def _ask_past(self, key: str, query: Any) -> None:
        """Query the past in a thread: nothing here waits for a disk."""
        values = {name: query.parameters.get(name) for name in ("from", "to", "every")}
        parameters = {name: value for name, value in values.items() if value is not None}

        def ask() -> None:
            past = self._past
            reply = PastReply(b"", _NOT_RECORDED) if past is None else past.ask(key, parameters)
            self._found_later.append((key, query, reply))

        threading.Thread(target=ask, name="past", daemon=True).start()

    def _reply_past(self, key: str, page: PastReply, query: Any) -> None:
        with query:
            if page.reason is not None:
                query.reply_err(page.reason)
            elif self._budget.is_spent():
                query.reply_err(_TOO_MUCH)
            else:
                self._budget.spend(len(page.payload))
                query.reply(f"{self._prefix}/{key}", page.payload, encoding=_OF_THE_PAST[key])

    def _answer_to(self, key: str, query: Any) -> tuple[bytes, str] | str:
        """An answer with its encoding, or the reason for its absence."""
        if key == "config":
            return self._config, JSON_ENCODING
        if key == "estimate":
            return self._last(query.parameters.get("last"))
        if key == "compensation" and query.parameters.get("arm") is not None:
            return f"ask {self._prefix}/command/arm with config=HASH; compensation itself no longer arms"
        if key not in self.documents:
            return "no health report yet" if key == "health" else f"no {key} yet"
        return self.documents[key], JSON_ENCODING

    def _last(self, last: str | None) -> tuple[bytes, str] | str:
        estimates = list(self.estimates)
        if last is None:
            return (estimates[-1], ESTIMATE_ENCODING) if estimates else "no estimate yet"
        if not (last.isascii() and last.isdigit() and len(last) <= _DIGITS and int(last) >= 1):
            return f"last={last[:20]}: give a whole number from 1 to 999999"
        selected = islice(estimates, max(0, len(estimates) - int(last)), None)
        return array_of(list(selected)), ESTIMATES_ENCODING

    def _take_command(self, key: str, query: Any) -> None:
        """Pass a command to the loop; an invalid one is refused at once."""
        kind = key.removeprefix("command/")
        refused = self._refusal(key, query)
        if len(self._commands) >= _WAITING:
            refused = "too many commands are waiting; ask again in a second"
        elif (
            str(query.key_expr) == f"{self._prefix}/{key}"
        ):  # a wildcard is not a command, so it is not recorded
            by = plain_name(query.parameters.get("by") or "") or "somebody"
            answer = partial(self._answer_later, kind, query)
            alarm_id = plain_name(query.parameters.get("id") or "", LONGEST_ID) or None
            without = query.parameters.get("without") or ""
            names = tuple(plain_name(name) for name in without[:LONGEST_ID].split(",") if name)
            self._commands.append(Command(kind, by, time.monotonic(), answer, refused, alarm_id, names))
        if refused is not None:
            with query:
                query.reply_err(refused)

    def _refusal(self, key: str, query: Any) -> str | None:
        """Why a command is invalid; None where key and hash are those of this axis and its configuration."""
        if str(query.key_expr) != f"{self._prefix}/{key}":
            return f"a command must name one axis: ask {self._prefix}/{key}, without a wildcard"
        digest = query.parameters.get("config")
        if digest is None:
            return (
                f"a command must name the configuration: add config=HASH, as given by {self._prefix}/config"
            )
        if not self._digest or digest != self._digest:
            return "config names a configuration that is not in force; check it and ask again"
        return None

    def _answer_later(self, kind: str, query: Any, outcome: Outcome) -> None:
        self._outcomes.append((kind, query, outcome))

    def _reply_outcome(self, kind: str, outcome: Outcome, query: Any) -> None:
        document = {"command": kind, "done": outcome.done, "text": outcome.text, "time_s": outcome.time_s}
        with query:
            query.reply(
                f"{self._prefix}/command/{kind}",
                to_json(document | {"instance": self._instance}),
                encoding=JSON_ENCODING,
            )
