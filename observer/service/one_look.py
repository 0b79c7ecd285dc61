"""Runs every driver for a few seconds, for `observer check --wires`, and notes the readings.

A driver is run as the service runs it, so nothing is sent that a normal run would not send.
"""

from __future__ import annotations

import asyncio
import contextlib
import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

from drivers.protocol import Driver
from observer.frames import Reading
from observer.process.clock import ServiceClock
from observer.quality.alarm_classes import remedy_for

LOOK_S = 5.0
"""Time allowed for a value of every channel; one and a half periods, where that is longer."""
LONGEST_S = 15.0
ENOUGH = 4
"""Number of readings of a driver that gives its rate."""
_END_S = 2.0
_LOOK_AGAIN_S = 0.05

Implausible = Callable[[str, float], str | None]


@dataclass
class _DriverReadings:
    """The readings of one driver: the newest value, fault and arrival of each channel."""

    readings: int = 0
    first_s: float = math.nan
    last_s: float = math.nan
    newest: dict[str, tuple[float, str | None, float]] = field(default_factory=dict)
    usable: set[str] = field(default_factory=set)

    def take(self, reading: Reading) -> None:
        """Note a reading."""
        now_s = time.monotonic()
        self.readings += 1
        self.first_s = now_s if math.isnan(self.first_s) else self.first_s
        self.last_s = now_s
        for channel, value in reading.values.items():
            fault = reading.faults.get(channel, None if math.isfinite(value) else "not_a_number")
            self.newest[channel] = value, fault, now_s
            if fault is None:
                self.usable.add(channel)

    def rate_Hz(self) -> float | None:
        """How often readings came, None where fewer than two did."""
        spent_s = self.last_s - self.first_s
        return (self.readings - 1) / spent_s if self.readings > 1 and spent_s > 0 else None


def look(drivers: Sequence[Driver], implausible: Implausible, look_s: float = LOOK_S) -> dict[str, Any]:
    """Run drivers until each of their channels has arrived, or for `look_s`.

    It blocks, in an event loop of its own. Nothing is sent that a normal run would not send.

    Args:
        drivers: Drivers that have not run yet.
        implausible: Says by channel and value why a value cannot be right; None where it may be.
        look_s: The longest look, in s; one and a half periods of the slowest driver if that is longer, up to
            15 s.

    Returns:
        Plain data: `good`, and for each driver its state, rate in Hz, last error, and for each channel value,
        fault, age in s and remedy.
    """
    return asyncio.run(_look(drivers, implausible, look_s))


async def _look(drivers: Sequence[Driver], implausible: Implausible, look_s: float) -> dict[str, Any]:
    readings = {driver.name: _DriverReadings() for driver in drivers}
    slowest_s = max((driver.period_s for driver in drivers), default=0.0)
    end_s = time.monotonic() + min(max(look_s, 1.5 * slowest_s), max(look_s, LONGEST_S))
    now = ServiceClock().now
    tasks = [asyncio.create_task(driver.run(readings[driver.name].take, now)) for driver in drivers]
    while time.monotonic() < end_s and not all(_enough(d, readings[d.name]) for d in drivers):
        await asyncio.sleep(_LOOK_AGAIN_S)
    results = {driver.name: _driver_result(driver, readings[driver.name], implausible) for driver in drivers}
    for driver, task in zip(drivers, tasks, strict=True):
        if task.done() and not task.cancelled() and task.exception() is not None:
            results[driver.name]["last_error"] = str(task.exception())
        task.cancel()
    with contextlib.suppress(TimeoutError):  # a device that hangs must not hold up the answer
        await asyncio.wait_for(asyncio.gather(*tasks, return_exceptions=True), _END_S)
    good = all(c["usable"] for d in results.values() for c in d["channels"].values())
    return {"good": bool(results) and good, "drivers": results}


def _enough(driver: Driver, readings: _DriverReadings) -> bool:
    return readings.readings >= ENOUGH and readings.usable.issuperset(driver.channels)


def _driver_result(driver: Driver, readings: _DriverReadings, implausible: Implausible) -> dict[str, Any]:
    now_s, status = time.monotonic(), driver.status
    return {
        "connected": status.connected,
        "errors": status.errors,
        "last_error": status.last_error,
        "rate_Hz": readings.rate_Hz(),
        "period_s": driver.period_s,
        "channels": {
            channel: _channel(channel, readings, now_s, implausible, status.last_error)
            for channel in driver.channels
        },
    }


def _channel(
    channel: str, readings: _DriverReadings, now_s: float, implausible: Implausible, last_error: str | None
) -> dict[str, Any]:
    value, fault, arrived_s = readings.newest.get(channel, (math.nan, "never_came", math.nan))
    doubt = None if fault else implausible(channel, value)
    explained = last_error if fault in ("disconnected", "tiny_number") else None
    return {
        "value": None if fault else value,
        "fault": fault,
        "age_s": None if math.isnan(arrived_s) else now_s - arrived_s,
        "implausible": doubt,
        "usable": fault is None and doubt is None,
        "remedy": explained or remedy_for(fault, doubt),
    }
