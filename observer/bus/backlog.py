"""The spans of time that a destination lacks: kept in a file, so that they survive a restart.

Live values resume at once after an outage. The recordings then give the values between the last one that
arrived and the first one after the outage. This is store and forward, as in Ignition or OIBus.
"""

from __future__ import annotations

import math
import threading
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import structlog

from observer.files.state import StateFile

_MOST_SPANS = 1000
STEP_KEYS = ("estimate", "readings", "heat", "field", "error")
"""The keys whose messages are sent late: those that are made of every step."""

log = structlog.get_logger()


class MissingSpan(NamedTuple):
    """Messages that a destination lacks.

    Attributes:
        from_s: The time of the first missing message, in s since 1970.
        to_s: The time before which the span ends.
        keys: The keys whose messages are missing.
    """

    from_s: float
    to_s: float
    keys: tuple[str, ...] = STEP_KEYS


class Backlog:
    """The spans that one destination lacks, the oldest first, each from a time up to another.

    Messages before the first value ever sent there do not count as missing. From any thread. At most 1000
    spans are kept; the oldest are given up, with a warning in the log.
    """

    def __init__(self, path: Path, destination: str) -> None:
        """Continue from a file; the spans of another destination are discarded.

        Args:
            path: The state file. If it cannot be read, a warning is logged and nothing is missing.
            destination: Names the receiver, such as a broker's address.
        """
        self._file = StateFile(path, f"messages that {destination} lacks", version=2)
        self._destination = destination
        self._lock = threading.Lock()
        self._got_s: float | None = None
        self._missing: list[MissingSpan] = []
        self._file.restore(self._take)

    def _take(self, document: Mapping[str, Any]) -> None:
        """Continue from a document, if it is of this destination."""
        if document["destination"] == self._destination:
            got_s = document["got_s"]
            spans = [MissingSpan(float(a), float(b), tuple(keys)) for a, b, keys in document["missing"]]
            self._missing, self._got_s = spans, None if got_s is None else float(got_s)

    @property
    def first(self) -> MissingSpan | None:
        """The oldest span that is missing; None if all has arrived."""
        with self._lock:
            return self._missing[0] if self._missing else None

    @property
    def left_s(self) -> float:
        """The total length of the missing spans, in s; spans of different keys count each."""
        with self._lock:
            return sum(span.to_s - span.from_s for span in self._missing)

    def behind_s(self, newest_s: float) -> float:
        """Return the missing spans and, during an outage, the time since its start, in s.

        Args:
            newest_s: The time of the newest message, in s since 1970.
        """
        with self._lock:
            out_s = 0.0 if self._got_s is None else max(newest_s - self._got_s, 0.0)
        return self.left_s + out_s

    def got(self, time_s: float) -> None:
        """Note that the live values up to a time have arrived; an earlier time changes nothing."""
        with self._lock:
            self._got_s = time_s if self._got_s is None else max(self._got_s, time_s)

    def resumed(self, time_s: float) -> None:
        """Note that live values go there again, from this time on, and save.

        The time since the last value that arrived becomes a missing span. It includes late values that were
        on their way.
        """
        with self._lock:
            if self._got_s is not None and time_s > self._got_s:
                after_s = math.nextafter(self._got_s, math.inf)
                before = [m._replace(to_s=min(m.to_s, after_s)) for m in self._missing if m.from_s < after_s]
                self._missing = [*before, MissingSpan(after_s, time_s)]
                if given_up := self._missing[:-_MOST_SPANS]:
                    log.warning("too many outages", given_up=given_up)
                    del self._missing[:-_MOST_SPANS]
            self._got_s = math.nextafter(time_s, -math.inf)
        self.save()

    def overtaken(self, key: str, last_s: float, time_s: float) -> None:
        """Note that a key's live values between two times were overtaken by newer ones.

        Args:
            key: The key.
            last_s: The time of the last value that was sent, in s since 1970.
            time_s: The time of the one that overtook the others.
        """
        with self._lock:
            if len(self._missing) < _MOST_SPANS:
                self._missing.append(MissingSpan(math.nextafter(last_s, math.inf), time_s, (key,)))

    def sent(self, span: MissingSpan, before_s: float) -> None:
        """Note that a span's late values before a time have arrived.

        Args:
            span: The span as `first` returned it; it may have been shortened meanwhile.
            before_s: The time up to which they have arrived, in s since 1970.
        """
        with self._lock:
            self._missing = [
                m._replace(from_s=max(m.from_s, before_s)) if _is_of(m, span) else m
                for m in self._missing
                if not _is_of(m, span) or m.to_s > before_s
            ]

    def save(self) -> None:
        """Write the file, whole or not at all.

        A failure to write is the state file's concern: it is logged, and the spans stay in memory.
        """
        with self._lock:
            document = {
                "destination": self._destination,
                "got_s": self._got_s,
                "missing": self._missing,
            }
            self._file.save(document)


def _is_of(missing: MissingSpan, span: MissingSpan) -> bool:
    """Whether a span is what is left of another, from which some has been sent."""
    return (missing.to_s, missing.keys) == (span.to_s, span.keys) and missing.from_s >= span.from_s


def holds_a_step(span: MissingSpan, every_s: float) -> bool:
    """Whether a multiple of a period lies within a span; a shorter outage has lost nothing that is sent.

    Args:
        span: The span; its end does not belong to it.
        every_s: The period of the messages in s; 0 for all of them.
    """
    before_s = math.nextafter(span.from_s, -math.inf)
    return every_s == 0.0 or math.floor(math.nextafter(span.to_s, -math.inf) / every_s) > math.floor(
        before_s / every_s
    )
