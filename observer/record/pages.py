"""The messages that were published in a span: pages of estimates and readings, and those sent late."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime
from typing import Any, NamedTuple

import cbor2

from observer.bus.codec import EstimateEncoder, array_of, late, late_json, to_json
from observer.errors import ConfigError
from observer.frames import EstimateBlock, FrameBlock
from observer.record.step_columns import StepSource
from observer.record.step_store import Past

LONGEST_S = 3600.0
"""Of a page."""
LEAST_EVERY_S = 1e-3
_MOST_BYTES = 1_000_000
_MOST_MESSAGES = 500
_LATEST_S = 1e11


def time_of(text: str, key: str) -> float:
    """Return a moment in seconds since 1970.

    Args:
        text: Such a number, or ISO 8601; without a zone it is UTC.
        key: Name of the parameter, for errors.

    Raises:
        ConfigError: The text is neither, or not finite.
    """
    try:
        time_s = float(text)
    except ValueError:
        try:
            moment = datetime.fromisoformat(text)
        except ValueError:
            raise ConfigError(
                f"{key}={text[:40]}: give seconds since 1970 or ISO 8601, such as 2026-03-01T06:00:00Z"
            ) from None
        time_s = (moment if moment.tzinfo else moment.replace(tzinfo=UTC)).timestamp()
    if not abs(time_s) <= _LATEST_S:
        raise ConfigError(f"{key}={text[:40]}: give a finite time in seconds since 1970")
    return time_s


@dataclass(frozen=True, slots=True)
class Span:
    """The requested span.

    Attributes:
        from_s: First time, s since 1970.
        to_s: End, itself excluded.
        every_s: One step per interval of this length; 0 for all steps.
    """

    from_s: float
    to_s: float
    every_s: float = 0.0

    @classmethod
    def of(cls, parameters: dict[str, str], now_s: float) -> Span:
        """Return the span that a query names.

        Args:
            parameters: `from`, and optionally `to` and `every`, as text.
            now_s: End of a span without `to`.

        Raises:
            ConfigError: `from` is missing, a value is invalid, or the span is empty.
        """
        if "from" not in parameters:
            raise ConfigError("to=… alone is not a span; give from=… too")
        begin_s = time_of(parameters["from"], "from")
        end_s = time_of(parameters["to"], "to") if "to" in parameters else now_s
        every_s = parameters.get("every", "0")
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
        """Return the number of the interval of `every_s` that a time is in; the time itself without
        intervals.
        """
        return math.floor(time_s / self.every_s) if self.every_s else time_s


class _Step(NamedTuple):
    """The step `k` of a block, its number, and the encoder of its messages."""

    encoder: EstimateEncoder
    estimates: EstimateBlock
    frames: FrameBlock
    k: int
    sequence: int


@dataclass(slots=True)
class PageOfSteps:
    """The steps of a span, one after the other, until the page is `full` or the configuration changes.

    A page ends after an hour at the latest. The attributes below `span` are complete after the iteration.

    Attributes:
        past: The published steps.
        span: The requested span.
        gap_s: A longer time between two steps is a gap.
        notes: Sentences about files that are left out.
        gaps_s: Begin and end of each gap.
        source: The configuration of the steps; None without any step.
        next_s: The time at which the next page continues; None at the end of the span.
        full: Set by the reader to end the page before the next step.
    """

    past: Past
    span: Span
    gap_s: float
    notes: list[str] = field(default_factory=list)
    gaps_s: list[tuple[float, float]] = field(default_factory=list)
    source: StepSource | None = None
    next_s: float | None = None
    full: bool = False

    def __iter__(self) -> Iterator[_Step]:
        """Yield the steps."""
        span = self.span
        end_s = min(span.to_s, span.from_s + LONGEST_S)
        slot = span.slot(math.nextafter(span.from_s, -math.inf))
        self.next_s = end_s if end_s < span.to_s else None
        last_s, encoder, encodes = span.from_s, None, None
        for steps in self.past.read(span.from_s, end_s, self.notes):
            source = steps.source
            if self.source is not None and source.digest != self.source.digest:
                self.next_s = float(steps.time_s[0])
                return
            self.source = self.source or source
            if encoder is None or encodes is not source:
                encoder, encodes = EstimateEncoder(source.layout, source.instance), source
            estimates, frames = steps.estimates, steps.frames
            for k, (time_s, sequence) in enumerate(steps.rows[["time_s", "sequence"]].tolist()):
                if self.full:
                    self.next_s = time_s
                    return
                if time_s - last_s > self.gap_s:
                    self.gaps_s.append((last_s, time_s))
                last_s = time_s
                if span.slot(time_s) != slot:
                    slot = span.slot(time_s)
                    yield _Step(encoder, estimates, frames, k, sequence)
        if end_s - last_s > self.gap_s:
            self.gaps_s.append((last_s, end_s))

    def head(self, in_force: str) -> dict[str, Any]:
        """Return the head of a page: span, `next`, configuration, gaps and notes.

        Args:
            in_force: Hash of the configuration in force.
        """
        digest = None if self.source is None else self.source.digest
        return {
            "from_s": self.span.from_s,
            "to_s": self.span.to_s if self.next_s is None else self.next_s,
            "next": self.next_s,
            "config": digest,
            "estimated_with": digest,
            "in_force": in_force,
            "gaps_s": self.gaps_s,
            "notes": self.notes,
        }


@dataclass(frozen=True, slots=True)
class Pages:
    """The messages of an axis by time.

    Attributes:
        past: The published steps.
        in_force: Hash of the configuration in force.
        gap_s: A longer time between two steps is a gap.
    """

    past: Past
    in_force: str = ""
    gap_s: float = 2.5

    def estimates(self, span: Span) -> bytes:
        """Return a page of estimates as CBOR: its head, and `estimates`, an array of the published
        messages.

        A page has about 1 MB.
        """
        page, messages, size = PageOfSteps(self.past, span, self.gap_s), list[bytes](), 0
        for encoder, estimates, _, k, sequence in page:
            messages.append(encoder.cbor(estimates, k, sequence))
            size += len(messages[-1])
            page.full = size >= _MOST_BYTES
        return cbor2.dumps({**page.head(self.in_force), "estimates": []})[:-1] + array_of(messages)

    def readings(self, span: Span) -> bytes:
        """Return a page of readings as JSON: its head, and `readings`, an array of the published messages.

        A page has about 1 MB.
        """
        page, messages, size = PageOfSteps(self.past, span, self.gap_s), list[bytes](), 0
        for encoder, _, frames, k, sequence in page:
            messages.append(encoder.readings(frames, k, sequence))
            size += len(messages[-1])
            page.full = size >= _MOST_BYTES
        return to_json({**page.head(self.in_force), "readings": []})[:-2] + b",".join(messages) + b"]}"

    def late(self, span: Span, keys: Sequence[str]) -> LatePage:
        """Return the messages that were published at each step of a span, marked as late.

        Args:
            span: The span.
            keys: `estimate`, `readings`, `heat`, `field`, `error` or `learned`.

        Returns:
            At most 500 steps. A machine without an expansion coefficient has no message `error`.
        """
        page, steps = PageOfSteps(self.past, span, self.gap_s), list[tuple[float, dict[str, bytes]]]()
        for encoder, estimates, frames, k, sequence in page:
            messages: dict[str, bytes] = {}
            for key in keys:
                if key == "estimate":
                    messages[key] = late(encoder.cbor(estimates, k, sequence))
                elif key == "readings":
                    messages[key] = late_json(encoder.readings(frames, k, sequence))
                elif key != "error" or estimates.error_um.shape[1]:
                    messages[key] = late_json(encoder.documents[key](estimates, k, sequence))
            steps.append((float(estimates.time_s[k]), messages))
            page.full = len(steps) >= _MOST_MESSAGES
        return LatePage(page.next_s, page.notes, steps)


class LatePage(NamedTuple):
    """Messages to be sent late.

    Attributes:
        next_s: The time at which to continue; None at the end of the span.
        notes: Sentences about files that are left out.
        steps: Time and messages by key of each step.
    """

    next_s: float | None
    notes: list[str]
    steps: list[tuple[float, dict[str, bytes]]]
