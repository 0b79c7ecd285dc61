"""Polls a device or server for every channel each period, for ever: shared by Modbus, OPC UA and MTConnect.

The task that polls also connects, so it reconnects to a peer within `RETRY_S` of the peer's return. Channels
without an answer by the end of a period are delivered as faulty.
"""

from __future__ import annotations

import asyncio
import dataclasses
from collections.abc import Awaitable, Callable, Mapping
from importlib import import_module
from math import isnan, nan
from typing import ClassVar, Protocol

from drivers.protocol import Clock, Deliver, DriverStatus, DriverTable, faulty
from drivers.stamps import DeviceClock
from observer.frames import Reading

RETRY_S = 0.25
_END_S = 0.2  # for closing a session
_AFTER_S = 1e-6


class LostError(Exception):
    """A failed poll.

    Attributes:
        fault: The fault of the channels until the next poll, such as `timeout`.
        readings: Those obtained before the failure; empty if there were none.
        lasts: Whether the connection can be used again.

    Args:
        fault: The fault.
        text: A sentence with the device and the remedy, for the driver's status.
    """

    def __init__(self, fault: str, text: str) -> None:
        super().__init__(text)
        self.fault = fault
        self.readings: list[Reading] = []
        self.lasts = False


@dataclasses.dataclass(frozen=True, slots=True)
class PolledValue:
    """A server's answer for a channel: a value or a fault, and the source's own time where given.

    Attributes:
        value: In the unit of the channel's name; NaN if there is a fault.
        fault: The name of the fault; None if the value counts.
        stamp_s: The source's own time in s since 1970; NaN if it gives none.
    """

    value: float = nan
    fault: str | None = None
    stamp_s: float = nan


class Session(Protocol):
    """One connection to a server; `problem` is a sentence if a channel is not available as configured.

    It is used by one task, which closes it after a `LostError` whose `lasts` is false.
    """

    problem: str | None

    async def ask(self) -> list[Reading]:
        """Request every channel and return a reading for each time, oldest first.

        The call may take longer than a period. The channels are faulty until it returns.

        Raises:
            LostError: If the server has not answered; it may carry readings.
        """

    async def close(self) -> None:
        """End the connection. It must not raise, and not wait long for a peer that is gone."""


class SourceTimes:
    """The times of values in the service's clock, from the stamps of their sources.

    A server repeats the stamp of an unchanged value; such a value gets the time of its arrival. The stamp of
    a changed value comes from the source's clock, whose offset `DeviceClock` estimates. No value is older
    than the previous answer, which did not have it yet. So the time of a channel never runs back.
    """

    def __init__(self) -> None:
        self._clocks: dict[str, DeviceClock] = {}
        self._stamps_s: dict[str, float] = {}
        self._before_s = nan

    def readings(self, answers: Mapping[str, PolledValue], arrival_s: float) -> list[Reading]:
        """Return the answers as readings, one for each time, oldest first.

        Args:
            answers: The answer of each channel.
            arrival_s: When they came, in s of the service's clock.

        Returns:
            Readings with times in s of the service's clock, none later than the arrival.
        """
        at: dict[float, dict[str, PolledValue]] = {}
        for channel, answer in answers.items():
            at.setdefault(self._time_s(channel, answer.stamp_s, arrival_s), {})[channel] = answer
        self._before_s = arrival_s
        return [
            Reading(
                time_s,
                {c: a.value for c, a in at[time_s].items()},
                {c: a.fault for c, a in at[time_s].items() if a.fault is not None},
            )
            for time_s in sorted(at)
        ]

    def _time_s(self, channel: str, stamp_s: float, arrival_s: float) -> float:
        """Return the time of one channel's answer, in s of the service's clock."""
        before_s, self._stamps_s[channel] = self._stamps_s.get(channel, nan), stamp_s
        if isnan(before_s) or isnan(stamp_s) or stamp_s == before_s:
            return arrival_s
        time_s = self._clocks.setdefault(channel, DeviceClock()).time_s(stamp_s, arrival_s)
        return min(max(time_s, self._before_s + _AFTER_S), arrival_s)


class PolledTable(DriverTable):
    """A table of a device or server that is polled each period.

    `session` is the module whose `connect(table, now)` makes a session. `open` imports it, and with it the
    bus library.

    Attributes:
        session: The full name of that module.
    """

    session: ClassVar[str]

    def open(self, name: str) -> Polled:
        """Make the driver that polls; its bus library is imported here. Nothing is connected before `run`."""
        connect = import_module(self.session).connect
        return Polled(name, self.delivered or (), self.sample_s or 1.0, lambda now: connect(self, now))


class Polled:
    """A device or server that is polled each period.

    A peer that returns is found within `RETRY_S`. While a poll goes on beyond its period, each further period
    delivers the fault `timeout`, or `slow_poll` if the last answered poll took that long too.

    Args:
        name: The driver's name in the configuration.
        channels: All channels of the driver.
        period_s: The interval of the polls in s.
        connect: Makes a session from the service's clock, or raises `LostError`.
    """

    def __init__(
        self,
        name: str,
        channels: tuple[str, ...],
        period_s: float,
        connect: Callable[[Clock], Awaitable[Session]],
    ) -> None:
        self.name = name
        self.channels = channels
        self.period_s = period_s
        self.status = DriverStatus()
        self._connect = connect
        self._session: Session | None = None
        self._tried_s = 0.0
        self._why = "disconnected"
        self._unfinished = "timeout"  # the fault of channels while a poll goes on beyond its period

    async def run(self, deliver: Deliver, now: Clock) -> None:
        """Deliver the current value or fault of each channel once a period, until cancelled.

        Periods that a busy computer has missed are left out, not made up. Cancellation ends the poll and
        closes the session.
        """
        loop = asyncio.get_running_loop()
        poll: asyncio.Task[list[Reading]] | None = None
        next_s = loop.time()
        try:
            while True:
                next_s = max(next_s + self.period_s, loop.time())
                poll = poll or loop.create_task(self._poll(now))
                await asyncio.wait({poll}, timeout=next_s - loop.time())
                if poll.done():
                    for reading in poll.result():
                        deliver(reading)
                    poll = None
                else:
                    why = self._why if self._session is None else self._unfinished
                    deliver(faulty(self.channels, why, now()))
                await asyncio.sleep(next_s - loop.time())
        finally:
            while poll is not None and not poll.done():
                poll.cancel()  # again where a connection that opens at this very moment swallowed it
                await asyncio.wait({poll}, timeout=_END_S)
            await self._close()

    async def _poll(self, now: Clock) -> list[Reading]:
        """Poll until there is an answer, on a new connection after each failure; return its readings."""
        loop = asyncio.get_running_loop()
        while True:
            try:
                if self._session is None:
                    self._tried_s = loop.time()
                    self._session = await self._connect(now)
                asked_s = loop.time()
                readings = await self._session.ask()
                self._answered(self._session, loop.time() - asked_s)
                return readings
            except LostError as error:
                failed = error
            self._why, self._unfinished = failed.fault, "timeout"
            self.status = self.status.failed(str(failed))
            if not failed.lasts:
                await self._close()
            if failed.readings:
                return failed.readings
            if loop.time() - self._tried_s < RETRY_S:  # refused, or accepted and closed at once
                await asyncio.sleep(RETRY_S)

    def _answered(self, session: Session, poll_s: float) -> None:
        """Update the status after an answered poll: the session's problem, or that it took longer than its
        period.
        """
        self.status = self.status.opened()
        problem = session.problem
        self._unfinished = "timeout"
        if poll_s > self.period_s:
            self._unfinished = "slow_poll"
            problem = (
                problem or f"a poll takes {poll_s:.2g} s, longer than period_s = {self.period_s:g}; raise it"
            )
        if problem is not None:
            self.status = self.status.failed(problem, connected=True)

    async def _close(self) -> None:
        session, self._session = self._session, None
        if session is not None:
            await session.close()
