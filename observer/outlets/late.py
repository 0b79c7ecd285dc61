"""Sends late what a broker missed: from the published steps, in order, beside the live values.

Any live value may get lost unnoticed. So a retained `true` on `alive` follows them periodically at QoS 1: a
connection keeps the order of its messages, so its acknowledgement covers everything before it. Late values
are sent at QoS 1 themselves, each once the previous one is acknowledged.
"""

from __future__ import annotations

import asyncio
import json
import math
import time
from collections.abc import Callable
from typing import TYPE_CHECKING

import structlog

from observer.bus.backlog import STEP_KEYS, Backlog, MissingSpan, holds_a_step
from observer.bus.codec import decode_estimate
from observer.errors import UserError
from observer.record.pages import LatePage, Pages, Span

if TYPE_CHECKING:
    from paho.mqtt.client import MQTTMessageInfo

    from observer.config.outlets import ReportState
    from observer.outlets.messages import Latest
    from observer.outlets.start import Start

_LAST_OF_A_STEP = "readings"
_OF_EVERY_STEP = ("estimate", "heat", "readings")  # field and error are published less often
_MARK_S = 1.0
_SAVE_S = 5.0
_LOOK_S = 0.2
_SETTLE_S = 3.0  # until subscribers are back too, and the rows of the outage's end are on disk
_RETRY_S = 10.0
_ACKNOWLEDGED_S = 0.005
_SAVE_LATE_S = 1.0
_REPORT_EVERY_S = 1.0

Send = Callable[[str, bytes], "MQTTMessageInfo"]

log = structlog.get_logger()


class LateSender:
    """Tracks what a broker has received, and sends what it missed. `send` publishes at QoS 1 below the
    prefix, `report_state` reports the number of unsent steps.
    """

    def __init__(
        self,
        start: Start,
        latest: Latest,
        report_state: ReportState,
        send: Send,
        is_connected: Callable[[], bool],
    ) -> None:
        assert start.mqtt is not None
        assert start.recordings is not None
        self._settings = start.mqtt
        self._report_state, self._send, self._is_connected = report_state, send, is_connected
        self._latest, self._step_s = latest, start.mqtt.late_every_s or start.period_s
        self._reported: dict[str, float] | None = None
        name = f"{start.machine}-{start.axis}.mqtt-sent"
        self.backlog = Backlog(start.recordings / name, f"{start.mqtt.broker} {start.mqtt.prefix or ''}")
        self._marks: dict[int, tuple[int, float]] = {}
        self._connection = 0  # the library sends a mark again on the next one, where it says nothing
        self._resumes = False
        self._marked_s = self._saved_s = self._connected_s = self._resumed_s = self._reported_s = -math.inf
        self._slot = math.nan
        self._went: dict[str, tuple[str | None, int, float]] = {}
        assert start.past is not None
        self._past = Pages(start.past)

    def connected(self) -> None:
        """Note a connection, from any thread: the next estimate is the first that arrives."""
        self._connection += 1
        self._connected_s = time.monotonic()
        self._resumes = True

    def disconnected(self) -> None:
        """Note the end of the connection; from any thread."""
        self._connection += 1
        self.backlog.save()

    @property
    def is_settling(self) -> bool:
        """Whether subscribers may not be back yet: a broker keeps messages at QoS 1 for them."""
        return time.monotonic() - self._connected_s < _SETTLE_S

    @property
    def _is_resuming(self) -> bool:
        """Whether what lies before the first live value may not be on the disk yet, or nobody listens yet."""
        return self.is_settling or time.monotonic() - self._resumed_s < _SETTLE_S

    def can_send(self, key: str, payload: bytes) -> bool:
        """Note that a message is about to go live; returns False for the rest of a step already sent."""
        if self._resumes and key in STEP_KEYS:
            if key != "estimate":
                return False
            self._resumes, self._resumed_s = False, time.monotonic()
            estimate = decode_estimate(payload)
            time_s, number = float(estimate["time_s"]), int(estimate["sequence"])
            before_s = math.nextafter(time_s, -math.inf)
            self._went = dict.fromkeys(_OF_EVERY_STEP, (estimate.get("instance"), number - 1, before_s))
            self.backlog.resumed(time_s)
        return True

    def note_sent(self, key: str, payload: bytes) -> None:
        """Note that a message has gone live; send a mark after the last one of a step when due."""
        every_s, now_s = self._settings.late_every_s, time.monotonic()
        if key in self._went and every_s == 0.0:
            self._look_for_overtaken(key, payload)
        if key != _LAST_OF_A_STEP:
            return
        time_s = float(json.loads(payload)["time_s"])
        slot = math.floor(time_s / every_s) if every_s else time_s
        if slot != self._slot or now_s - self._marked_s >= _MARK_S:
            self._slot, self._marked_s = slot, now_s
            connection = self._connection
            # a copy: the library's thread removes marks meanwhile
            self._marks = {m: mark for m, mark in list(self._marks.items()) if mark[0] == connection}
            self._marks[self._send("alive", b"true").mid] = connection, time_s

    def _look_for_overtaken(self, key: str, payload: bytes) -> None:
        """Note the steps whose messages were overtaken by newer ones on a busy computer."""
        document = decode_estimate(payload) if key == "estimate" else json.loads(payload)
        number, time_s = int(document["sequence"]), float(document["time_s"])
        instance, before, last_s = self._went[key]
        if document.get("instance") != instance:  # the service has started again, and numbers from 0
            self._went[key] = document.get("instance"), number, time_s
            return
        if number > before + 1:
            self.backlog.overtaken(key, last_s, time_s)
            self._saved_s = -math.inf
        if number > before:
            self._went[key] = instance, number, time_s

    def acknowledged(self, mid: int) -> None:
        """Take an acknowledgement; from the library's thread."""
        connection, time_s = self._marks.pop(mid, (-1, math.nan))
        if connection == self._connection:
            self.backlog.got(time_s)

    async def run(self) -> None:
        """Send what is missing, for ever."""
        while True:
            await asyncio.sleep(_LOOK_S)
            self._report()
            if time.monotonic() - self._saved_s >= _SAVE_S and self._is_connected():
                self._saved_s = time.monotonic()
                await asyncio.to_thread(self.backlog.save)
            span = self.backlog.first
            if span is None or not self._is_connected() or self._is_resuming:
                continue
            if not holds_a_step(span, self._settings.late_every_s):
                self.backlog.sent(span, span.to_s)
                continue
            log.info("late values", outlet="mqtt", missing_s=round(self.backlog.left_s, 1))
            await self._send_span(span)

    def _report(self) -> None:
        """Say how much has not been sent yet, for health, where that has changed."""
        if time.monotonic() - self._reported_s < _REPORT_EVERY_S:
            return
        newest_s = float(self._latest.document("heat").get("time_s", -math.inf))
        is_out = not self._is_connected() or self._resumes
        behind_s = self.backlog.behind_s(newest_s) if is_out else self.backlog.left_s
        unsent = {"steps": round(behind_s / self._step_s), "duration_s": round(behind_s, 3)}
        if unsent != self._reported:
            self._reported, self._reported_s = unsent, time.monotonic()
            self._report_state({"unsent": unsent})

    async def _send_span(self, span: MissingSpan) -> None:
        """Send a page of a span."""

        def read() -> LatePage:
            return self._past.late(Span(span.from_s, span.to_s, self._settings.late_every_s), span.keys)

        try:
            page, saved_s = await asyncio.to_thread(read), time.monotonic()
        except UserError as error:
            log.warning("late values cannot be read", reason=str(error))
            await asyncio.sleep(_RETRY_S)
            return
        for note in page.notes:
            log.warning("late values", outlet="mqtt", note=note)
        for time_s, messages in page.steps:
            self._report()
            next_s = time.monotonic() + 1.0 / self._settings.late_rate_Hz
            waiting = [self._send(key, payload) for key, payload in messages.items()]
            while not all(info.is_published() for info in waiting):  # also after another outage
                await asyncio.sleep(_ACKNOWLEDGED_S)
            self.backlog.sent(span, math.nextafter(time_s, math.inf))
            if time.monotonic() - saved_s >= _SAVE_LATE_S:
                saved_s = time.monotonic()
                await asyncio.to_thread(self.backlog.save)
            await asyncio.sleep(max(0.0, next_s - time.monotonic()))
        self.backlog.sent(span, span.to_s if page.next_s is None else page.next_s)
        await asyncio.to_thread(self.backlog.save)

    def close(self) -> None:
        """Save the progress, and end."""
        self.backlog.save()
