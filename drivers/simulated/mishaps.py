"""What can befall the axis's frames between its controller and the adapter that the service reads."""

from __future__ import annotations

import asyncio
import random
from collections.abc import Callable

from drivers.simulated.faults import Faults


class Mishaps:
    """Hands lines on to `write`, or holds them up, drops, doubles or swaps them, as the faults say.

    Needs a running event loop, which delivers what was held up.
    """

    def __init__(self, write: Callable[[bytes], None], seed: int) -> None:
        self._write = write
        self._random = random.Random(seed)
        self._faults = Faults()
        self._held: list[bytes] | None = None
        self._behind = b""

    def set(self, faults: Faults) -> None:
        """Put faults in force; a hold-up without `hold_can_every_s` happens once, now."""
        self._faults = faults
        if faults.hold_can_s and faults.hold_can_every_s is None:
            self._hold_up(faults.hold_can_s)

    def put(self, line: bytes, period_s: float) -> None:
        """Send one of the lines that come each period."""
        faults = self._faults
        every_s = faults.hold_can_every_s
        if faults.hold_can_s and every_s and self._random.random() < period_s / every_s:
            self._hold_up(faults.hold_can_s)
        if self._random.random() < faults.drop_can:
            return
        if self._random.random() < faults.double_can:
            line += line
        if not self._behind and self._random.random() < faults.swap_can:
            self._behind = line  # until the next has overtaken it
            return
        line, self._behind = line + self._behind, b""
        if self._held is None:
            self._write(line)
        else:
            self._held.append(line)

    def _hold_up(self, for_s: float) -> None:
        """Keep all lines for some time, then deliver them at once."""
        if self._held is None:
            self._held = []
            asyncio.get_running_loop().call_later(for_s, self._release)

    def _release(self) -> None:
        held, self._held = self._held or [], None
        self._write(b"".join(held))
