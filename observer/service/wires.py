"""The drivers in a thread with an event loop of its own, so that no step delays a poll or a stamp.

Readings cross to the service's event loop in the order in which they were delivered. Drivers know nothing of
this; the loop knows of no other thread than through here.
"""

from __future__ import annotations

import asyncio
import contextlib
import dataclasses
import sys
import threading
import time
from collections import deque
from collections.abc import Callable

import structlog

from drivers.protocol import Clock, Driver, DriverStatus
from observer.frames import Reading

MAX_WAITING = 10_000  # readings; some minutes of a machine, far longer than the loop is ever busy
RESTART_S = 1.0
_BEAT_S = 0.5
_DEAF_S = 10.0  # a thread that has not responded for so long no longer reads
_END_S = 0.25
_TURN_S = 0.001  # with Python's own 5 ms, two busy threads keep a third waiting for up to 0.5 s

log = structlog.get_logger()


def take_short_turns() -> None:
    """Make computing threads yield after 1 ms instead of 5 ms: time stamps must not wait. It holds for the
    process.
    """
    sys.setswitchinterval(_TURN_S)


class Wires:
    """Runs drivers from `start` to `close`.

    A driver that fails is started again after a second. Readings that find the queue full are counted as its
    drops.

    Args:
        drivers: Drivers that have not run yet.
        now: The service's clock in s; it is called in the drivers' thread.
        take: Called with the driver's name and each reading, on the event loop on which this was made.
    """

    def __init__(self, drivers: tuple[Driver, ...], now: Clock, take: Callable[[str, Reading], None]) -> None:
        self._drivers = drivers
        self._now = now
        self._take = take
        self._waiting: deque[tuple[str, Reading]] = deque()
        self._called = False
        self._dropped = {driver.name: 0 for driver in drivers}
        self._home = asyncio.get_running_loop()
        self._loop = asyncio.new_event_loop()
        self._closing = asyncio.Event()
        self._beat_s = 0.0
        self._thread = threading.Thread(target=self._live, name="wires", daemon=True)

    def start(self) -> None:
        """Begin to read; returns at once."""
        self._beat_s = time.monotonic()
        self._thread.start()

    @property
    def alive(self) -> bool:
        """Whether the thread is alive and its event loop responds."""
        return self._thread.is_alive() and time.monotonic() - self._beat_s < _DEAF_S

    def statuses(self) -> dict[str, DriverStatus]:
        """The status of each driver, with the readings dropped on their way."""
        return {
            driver.name: dataclasses.replace(
                driver.status, drops=driver.status.drops + self._dropped[driver.name]
            )
            for driver in self._drivers
        }

    def drain(self) -> None:
        """Take everything that waits, in order; to be called on the receiving event loop."""
        self._called = False
        while self._waiting:
            self._take(*self._waiting.popleft())

    def close(self, timeout_s: float) -> bool:
        """End the drivers and take what they delivered last.

        Args:
            timeout_s: The longest wait, in s.

        Returns:
            False if one of them did not end in time; it is left to its daemon thread.
        """
        with contextlib.suppress(RuntimeError):  # the thread's event loop has ended by itself
            self._loop.call_soon_threadsafe(self._closing.set)
        self._thread.join(timeout_s)
        self.drain()
        return not self._thread.is_alive()

    def _live(self) -> None:
        try:
            with asyncio.Runner(loop_factory=lambda: self._loop) as runner:
                runner.run(self._run())
        except BaseException as error:  # whatever ended it, the loop sees that it is dead
            log.error("the drivers' thread has ended", error=repr(error), exc_info=True)

    async def _run(self) -> None:
        """Run every driver until asked to end; a driver that does not end then is left behind."""
        tasks = [asyncio.ensure_future(self._listen(driver)) for driver in self._drivers]
        while not self._closing.is_set():
            self._beat_s = time.monotonic()
            with contextlib.suppress(TimeoutError):
                await asyncio.wait_for(self._closing.wait(), _BEAT_S)
        for task in tasks:
            task.cancel()
        if tasks:
            await asyncio.wait(tasks, timeout=_END_S)

    async def _listen(self, driver: Driver) -> None:
        """Run a driver; one that fails is started again."""
        while True:
            try:
                await driver.run(lambda reading: self._deliver(driver.name, reading), self._now)
                return
            except Exception as error:  # one driver's defect must not end the others
                log.error("driver failed", driver=driver.name, error=repr(error), exc_info=True)
            await asyncio.sleep(RESTART_S)

    def _deliver(self, name: str, reading: Reading) -> None:
        """Queue a reading and have it taken soon; from any thread."""
        if len(self._waiting) >= MAX_WAITING:
            self._dropped[name] += 1
            return
        self._waiting.append((name, reading))
        if not self._called:
            self._called = True
            with contextlib.suppress(RuntimeError):  # the service has ended
                self._home.call_soon_threadsafe(self.drain)
