"""What the archive answers: pages of estimates and readings, and messages that are sent late."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from datetime import UTC, datetime
from typing import Any

import cbor2

from observer.archive.store import Archive, Chapter, Origin
from observer.errors import ConfigError
from observer.publish.codec import EstimateEncoder, array_of, late, late_json, to_json

LONGEST_S = 3600.0
"""Of a page."""
LEAST_EVERY_S = 1e-3
_MOST_BYTES = 1_000_000
_MOST_MESSAGES = 500
_WITHIN_S = 6.0
_LATEST_S = 1e11
_GAP_PERIODS = 2.5


def time_of(text: str, key: str) -> float:
    """A moment in seconds since 1970, from such a number or ISO 8601, without a zone UTC.

    Raises `ConfigError`.
    """
    try:
        found = float(text)
    except ValueError:
        try:
            moment = datetime.fromisoformat(text)
        except ValueError:
            raise ConfigError(
                f"{key}={text[:40]}: give seconds since 1970 or ISO 8601, such as 2026-03-01T06:00:00Z"
            ) from None
        found = (moment if moment.tzinfo else moment.replace(tzinfo=UTC)).timestamp()
    if not abs(found) <= _LATEST_S:
        raise ConfigError(f"{key}={text[:40]}: give a finite time in seconds since 1970")
    return found


@dataclass(frozen=True, slots=True)
class Span:
    """The requested span: from one time to another, one step per `every_s`, all steps if that is 0."""

    from_s: float
    to_s: float
    every_s: float = 0.0

    @classmethod
    def of(cls, asked: dict[str, str], now_s: float) -> Span:
        """The span that a query names; raises `ConfigError`."""
        if "from" not in asked:
            raise ConfigError("to=… alone is not a span; give from=… too")
        begin_s = time_of(asked["from"], "from")
        end_s = time_of(asked["to"], "to") if "to" in asked else now_s
        every_s = asked.get("every", "0")
        try:
            apart_s = float(every_s)
        except ValueError:
            apart_s = math.nan
        if not (apart_s == 0.0 or LEAST_EVERY_S <= apart_s <= LONGEST_S):
            raise ConfigError(
                f"every={every_s[:20]}: give 0, or seconds from {LEAST_EVERY_S:g} to {LONGEST_S:.0f}"
            )
        if not begin_s < end_s:
            raise ConfigError("from must be before to; give an earlier from or a later to")
        return cls(begin_s, end_s, apart_s)

    def slot(self, time_s: float) -> float:
        """Which interval of `every_s` a time is in."""
        return math.floor(time_s / self.every_s) if self.every_s else time_s


@dataclass(slots=True)
class Steps:
    """The steps of a span, one after the other, until the page is full or their origin changes.

    Afterwards `next_s` is where to continue, None at the end of the span; `notes` and `gaps_s`
    describe it, `origin` is its source.
    """

    archive: Archive
    span: Span
    until_s: float
    estimates: bool = True
    notes: list[str] = field(default_factory=list)
    gaps_s: list[tuple[float, float]] = field(default_factory=list)
    origin: Origin | None = None
    next_s: float | None = None
    full: bool = False

    def __iter__(self) -> Iterator[tuple[Chapter, int]]:
        """Yield chapter and row of each step."""
        span = self.span
        end_s = min(span.to_s, span.from_s + LONGEST_S)
        slot = span.slot(math.nextafter(span.from_s, -math.inf))
        self.next_s = end_s if end_s < span.to_s else None
        last_s = span.from_s
        read = self.archive.read(
            span.from_s, end_s, self.notes, estimates=self.estimates, until_s=self.until_s
        )
        for chapter in read:
            apart_s = _GAP_PERIODS * self.archive.setup(chapter.origin.used).plan.period_s
            own, time_s_of = chapter.origin, chapter.frames.time_s.tolist()
            for k in chapter.wanted.tolist():
                time_s = time_s_of[k]
                changed = self.origin is not None and (own.recorded, own.used) != (
                    self.origin.recorded, self.origin.used
                )  # fmt: skip
                if self.full or changed:
                    self.next_s = time_s
                    return
                if time_s - last_s > apart_s:
                    self.gaps_s.append((last_s, time_s))
                last_s, self.origin = time_s, self.origin or own
                if span.slot(time_s) != slot:
                    slot = span.slot(time_s)
                    yield chapter, k
        if end_s - last_s > _GAP_PERIODS:
            self.gaps_s.append((last_s, end_s))

    def head(self) -> dict[str, Any]:
        """The head of a page."""
        return {
            "from_s": self.span.from_s,
            "to_s": self.span.to_s if self.next_s is None else self.next_s,
            "next": self.next_s,
            "config": None if self.origin is None else self.origin.recorded,
            "estimated_with": None if self.origin is None else self.origin.used,
            "in_force": self.archive.in_force,
            "gaps_s": self.gaps_s,
            "notes": self.notes,
        }


class Pages:
    """Answers of one archive."""

    def __init__(self, archive: Archive) -> None:
        self._archive = archive
        self._encoders: dict[tuple[str, str], EstimateEncoder] = {}

    def estimates(self, span: Span) -> bytes:
        """A page of estimates, CBOR: `estimates` is an array of what was published."""
        steps, found, size = self._steps(span), list[bytes](), 0
        for chapter, k in steps:
            assert chapter.estimates is not None
            found.append(self._encoder(chapter.origin).cbor(chapter.estimates, k, int(chapter.sequence[k])))
            size += len(found[-1])
            steps.full = size >= _MOST_BYTES
        return cbor2.dumps({**steps.head(), "estimates": []})[:-1] + array_of(found)

    def readings(self, span: Span) -> bytes:
        """A page of readings, JSON: `readings` is an array of what was published."""
        steps, found, size = self._steps(span, estimates=False), list[bytes](), 0
        for chapter, k in steps:
            found.append(self._encoder(chapter.origin).readings(chapter.frames, k, int(chapter.sequence[k])))
            size += len(found[-1])
            steps.full = size >= _MOST_BYTES
        return to_json({**steps.head(), "readings": []})[:-2] + b",".join(found) + b"]}"

    def late(self, span: Span, keys: list[str]) -> bytes:
        """The messages that were published on these keys at each step, marked as late, as CBOR.

        `{"next": where to go on or None, "notes": sentences, "steps": [[time_s, {key: message}]]}`
        """
        steps, found = self._steps(span), list[Any]()
        for chapter, k in steps:
            encoder, block, number = (
                self._encoder(chapter.origin),
                chapter.estimates,
                int(chapter.sequence[k]),
            )
            assert block is not None
            messages: dict[str, bytes] = {}
            for key in keys:
                if key == "estimate":
                    messages[key] = late(encoder.cbor(block, k, number))
                elif key == "readings":
                    messages[key] = late_json(encoder.readings(chapter.frames, k, number))
                elif key != "error" or block.error_um.shape[1]:
                    messages[key] = late_json(encoder.documents[key](block, k, number))
            found.append([float(chapter.frames.time_s[k]), messages])
            steps.full = len(found) >= _MOST_MESSAGES
        return cbor2.dumps({"next": steps.next_s, "notes": steps.notes, "steps": found})

    def _steps(self, span: Span, *, estimates: bool = True) -> Steps:
        return Steps(self._archive, span, time.monotonic() + _WITHIN_S, estimates)

    def _encoder(self, origin: Origin) -> EstimateEncoder:
        about = origin.used, origin.instance
        if about not in self._encoders:
            self._encoders = {
                about: EstimateEncoder(self._archive.setup(origin.used).layout, origin.instance)
            }
        return self._encoders[about]
