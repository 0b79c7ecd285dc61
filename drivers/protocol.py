"""What every driver is to the rest of the house, however its wire works."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from math import nan
from typing import Protocol

from observer.frames import Reading

Deliver = Callable[[Reading], None]
Clock = Callable[[], float]
Decoded = tuple[dict[str, float], dict[str, str]]  # values and faults by channel


@dataclass(frozen=True, slots=True)
class DriverStatus:
    """A snapshot of how a driver fares.

    `reconnects` counts connections after the first, `errors` polls or frames that failed, `drops` samples
    that arrived and could not be handed on.
    """

    connected: bool = False
    reconnects: int = 0
    errors: int = 0
    drops: int = 0
    last_error: str | None = None


class Driver(Protocol):
    """A source of readings.

    `run` delivers readings stamped with `now()` until it is cancelled, reconnects for ever, and lets no
    channel fall silent: what cannot be read is delivered as NaN with its fault, every `period_s`. It calls
    `deliver` on the event loop's own thread.
    """

    name: str
    channels: tuple[str, ...]
    period_s: float
    status: DriverStatus

    async def run(self, deliver: Deliver, now: Clock) -> None:
        """Deliver readings until cancelled."""


def faulty(channels: Iterable[str], fault: str, time_s: float) -> Reading:
    """A reading that says why each of these channels has no value."""
    faults = dict.fromkeys(channels, fault)
    return Reading(time_s, dict.fromkeys(faults, nan), faults)
