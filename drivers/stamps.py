"""The time at which a frame was sent, from the stamp of its adapter or kernel, in the service's clock.

A stamp comes from another clock than the service's. If that is this computer's clock, the age of the frame is
the difference to the present time. If it is an adapter's, only differences count: the recent frame with the
shortest delay gives the offset between the two clocks. No time is later than the arrival.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass

FURTHEST_S = 10.0  # a frame that seems older than this has a stamp that means something else
_LARGEST_S = 1e12  # what no clock shows
_BLOCK_S = 5.0
_BLOCKS = 6  # 30 s: clocks 100 ppm apart drift by 3 ms in it
_COARSE_S = 0.005  # so long after its like, a frame with the same stamp came later than the stamp says
_SHIFT_S = 0.05  # if every frame of a block is later by this much, it is not a delay: a clock was set


def wall_time(stamp_s: float, arrival_s: float, wall_s: float) -> float:
    """Return the time of a stamp of this computer's clock.

    The computer's clock may be set at any time, so only its difference to a recent stamp is used.

    Args:
        stamp_s: The stamp, in s since 1970.
        arrival_s: When the frame arrived, in s of the service's clock.
        wall_s: What this computer's clock shows now, in s since 1970.

    Returns:
        The time in s of the service's clock. It is the arrival if the stamp is in the future or older than
        `FURTHEST_S`.
    """
    delay_s = wall_s - stamp_s
    return arrival_s - delay_s if 0.0 <= delay_s <= FURTHEST_S else arrival_s


@dataclass(slots=True)
class _Block:
    """The two smallest values of arrival − stamp over some seconds of frames; the smallest may be a wrong
    stamp.
    """

    begin_s: float
    least_s: float = math.inf
    second_s: float = math.inf

    def take(self, offset_s: float) -> None:
        self.least_s, self.second_s = sorted((self.least_s, self.second_s, offset_s))[:2]


class DeviceClock:
    """Maps the stamps of one adapter to the service's clock, from the adapter's opening on.

    time = stamp + min (arrival − stamp) over the last 30 s, where each block of 5 s contributes its second
    smallest value. If a stamp did not advance, or while the clocks shift, the stamp is ignored and the
    arrival is used.

    Args:
        wrap_s: The period of the adapter's counter in s; None if it does not start again.
    """

    def __init__(self, wrap_s: float | None = None) -> None:
        self._wrap_s = wrap_s
        self._blocks: deque[_Block] = deque(maxlen=_BLOCKS)
        self._stamp_s = math.nan
        self._arrival_s = math.nan  # of the first frame with the newest stamp
        self._trusted = True

    def time_s(self, stamp_s: float, arrival_s: float) -> float:
        """Return the time of a frame, never later than the arrival.

        Call it for the frames in the order of their arrival.

        Args:
            stamp_s: The adapter's stamp in s; NaN if there is none.
            arrival_s: The arrival in s of the service's clock.

        Returns:
            Seconds of the service's clock.
        """
        if not abs(stamp_s) < _LARGEST_S:  # nor NaN
            return arrival_s
        stamp_s = self._unwrapped(stamp_s, arrival_s)
        standing = stamp_s <= self._stamp_s and arrival_s - self._arrival_s > _COARSE_S
        if stamp_s != self._stamp_s:
            self._stamp_s, self._arrival_s = stamp_s, arrival_s
        offset_s = arrival_s - stamp_s
        self._note(offset_s, arrival_s)
        delay_s = offset_s - min(block.second_s for block in self._blocks)
        if delay_s > FURTHEST_S:  # nothing is known of the clocks but this frame
            self._blocks.clear()
            self._note(offset_s, arrival_s)
            self._trusted = False
        if standing or not self._trusted:
            return arrival_s
        return arrival_s - max(delay_s, 0.0)

    def _unwrapped(self, stamp_s: float, arrival_s: float) -> float:
        """Return the stamp plus the number of counter periods that fits best to the frame before."""
        if self._wrap_s is None or math.isnan(self._stamp_s):
            return stamp_s
        expected_s = self._stamp_s + (arrival_s - self._arrival_s)
        return stamp_s + self._wrap_s * round((expected_s - stamp_s) / self._wrap_s)

    def _note(self, offset_s: float, arrival_s: float) -> None:
        """Add an offset to the newest block; blocks older than 30 s are removed."""
        while self._blocks and arrival_s - self._blocks[0].begin_s > _BLOCKS * _BLOCK_S:
            self._blocks.popleft()
        if not self._blocks:
            self._blocks.append(_Block(arrival_s))
        elif arrival_s - self._blocks[-1].begin_s > _BLOCK_S:
            self._finish()
            self._blocks.append(_Block(arrival_s))
        self._blocks[-1].take(offset_s)

    def _finish(self) -> None:
        """Compare the block that has just ended with those before, and stop trusting stamps after a shift."""
        ended = self._blocks[-1]
        least_s = min(block.second_s for block in self._blocks)
        self._trusted = not _SHIFT_S < ended.second_s - least_s < math.inf
        if not self._trusted:
            self._blocks.clear()
            self._blocks.append(ended)
