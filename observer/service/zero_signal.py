"""Turns a control's signal that the machine has just been zeroed into the command `zero`."""

from __future__ import annotations

import math
import time

from observer.bus.exchange import Command, Outcome, plain_name
from observer.control.compensation import LATE_PERIODS
from observer.frames import Reading
from observer.installation import Installation

_HIGH = 0.5


class ZeroSignal:
    """Watches one channel's readings as they come, before the tick reduces them to one value.

    A rise above 0.5 is a new zero. Pulses shorter than a tick are seen.
    """

    def __init__(self, channel: str, late_s: float) -> None:
        """Begin without a value.

        Args:
            channel: The channel that rises.
            late_s: The time without a value, in s, after which it is lost.
        """
        self._channel, self._late_s = channel, late_s
        self._was_high: bool | None = None
        self._heard_s = -math.inf
        self._risen = False

    @classmethod
    def of(cls, config: Installation) -> ZeroSignal | None:
        """Return the signal of a configuration; None without `compensation.zero_channel`."""
        channel = config.compensation.zero_channel
        if channel is None:
            return None
        period_s = max(config.estimator.period_s, config.sample_s.get(channel, 0.0))
        return cls(channel, LATE_PERIODS * period_s)

    def hear(self, reading: Reading) -> None:
        """Take a reading; the very first value never counts as a rise."""
        value = reading.values.get(self._channel, math.nan)
        if not math.isfinite(value) or self._channel in reading.faults:
            return
        is_high = value > _HIGH
        self._risen |= is_high and self._was_high is False
        self._was_high, self._heard_s = is_high, reading.time_s

    def commands(self) -> list[Command]:
        """Return the command requested by a rise since the last call; several rises are one command."""
        risen, self._risen = self._risen, False
        by = plain_name(f"{self._channel}@signal")
        return [Command("zero", by, time.monotonic(), _answered)] if risen else []

    def lost(self, now_s: float) -> str | None:
        """Return why a rise could have been missed.

        Args:
            now_s: The time of the service.

        Returns:
            A sentence with the channel; None while the channel comes.
        """
        if now_s - self._heard_s <= self._late_s:
            return None
        return f"{self._channel}, which reports a new zero, has no value (check its driver)"


def _answered(_outcome: Outcome) -> None:
    """Nobody waits for an answer: log, recording and the `compensation` document report the outcome."""
