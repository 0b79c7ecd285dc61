"""Serial CAN adapters of the Lawicel kind, with the time stamps that they append to their lines.

python-can reads over such a stamp and gives every frame the time of its reading instead.
"""

from __future__ import annotations

import math

from can import Message
from can.interfaces.slcan import slcanBus

TURN_S = 60.0  # an adapter counts the milliseconds of a minute
_TURN_MS = 60_000
_STAMP_DIGITS = 4


class StampedSlcanBus(slcanBus):
    """As python-can's, but a frame's `timestamp` is the adapter's own, in seconds, or NaN where none came."""

    _line: str | None = None

    def _read(self, timeout: float | None) -> str | None:
        self._line = super()._read(timeout)
        return self._line

    def _recv_internal(self, timeout: float | None) -> tuple[Message | None, bool]:
        message, filtered = super()._recv_internal(timeout)
        if message is not None:
            message.timestamp = stamp_of(self._line or "", message)
        return message, filtered


def stamp_of(line: str, message: Message) -> float:
    """The stamp at the end of a frame's line, in seconds of the adapter's minute; NaN where there is none."""
    data = 0 if message.is_remote_frame else 2 * message.dlc
    digits = line.rstrip("\r")[(10 if message.is_extended_id else 5) + data :]
    try:
        count_ms = int(digits, 16)
    except ValueError:
        return math.nan
    return 1e-3 * count_ms if len(digits) == _STAMP_DIGITS and count_ms < _TURN_MS else math.nan
