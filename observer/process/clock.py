"""The service's time: seconds since the epoch that never go back and never jump."""

from __future__ import annotations

import asyncio
import math
import time
from collections.abc import Callable

STEP_S = 0.5
"""The computer's clock was set once it is further than this from the service's time."""


class ServiceClock:
    """The epoch time at the start plus the time that a monotonic clock has counted since.

    When the computer's clock is set, the service's time continues evenly, and `offset_s` is the difference.
    """

    def __init__(
        self, wall: Callable[[], float] = time.time, monotonic: Callable[[], float] = time.monotonic
    ) -> None:
        self._wall = wall
        self._monotonic = monotonic
        self._epoch_s = wall() - monotonic()
        self._last_s = -math.inf

    def now(self) -> float:
        """Return seconds since the epoch, later than every time returned before."""
        now_s = self._epoch_s + self._monotonic()
        self._last_s = now_s if now_s > self._last_s else math.nextafter(self._last_s, math.inf)
        return self._last_s

    def offset_s(self) -> float:
        """Return how far the computer's clock is ahead of the service's time, in s."""
        return self._wall() - (self._epoch_s + self._monotonic())

    async def sleep_until(self, time_s: float) -> None:
        """Wait until `now` has reached a time."""
        while (rest_s := time_s - self.now()) > 0:
            await asyncio.sleep(rest_s)


def stepped(offset_s: float) -> str | None:
    """Return a sentence if the computer's clock has departed from the service's, else None."""
    return f"the computer's clock was set, by {offset_s:+.1f} s" if abs(offset_s) > STEP_S else None
