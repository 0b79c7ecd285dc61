"""How patient the tests are: the one place that knows.

What must happen at all has `PATIENCE_S`, far more than it ever takes: only a test that fails waits so long.
What must happen *soon* is a claim about the product and is timed with a `Stopwatch`. It leaves out the time
in which the processes concerned were ready to run while the computer ran others, so that a claim is as strict
beside busy programs as on a quiet computer: who waits for a peer, a lock or a pause is not ready to run.
"""

from __future__ import annotations

import asyncio
import contextlib
import inspect
import os
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

PATIENCE_S = 60.0
PAUSE_S = 0.005  # between two looks
HERE = os.getpid()


class Stopwatch:
    """Seconds since it was made, less those that the processes named, or this one, have stood in the queue.

    The kernel reports how long each thread stood in it (`/proc/<pid>/task/<tid>/schedstat`); threads add up.
    A stay that has not ended is not counted yet.
    """

    def __init__(self, *pids: int) -> None:
        self._pids = pids or (HERE,)
        self._begun = _queued_s(self._pids)
        self._queued = dict(self._begun)
        self._start_s = time.monotonic()

    def held_up_s(self) -> float:
        """Seconds that the computer has kept these processes waiting so far."""
        self._queued |= _queued_s(self._pids)  # what a thread that has ended waited before stays known
        return sum(queued_s - self._begun.get(thread, 0.0) for thread, queued_s in self._queued.items())

    def took_s(self) -> float:
        """Seconds so far, without those in which the computer ran others."""
        return time.monotonic() - self._start_s - self.held_up_s()

    def until(self, what: Callable[[], Any]) -> float:
        """Wait for something to be there or true; returns how long after the start it still was not.

        So it does not matter how late this process sees it.
        """
        last_s = 0.0

        def is_there() -> bool:
            nonlocal last_s
            now_s = self.took_s()  # at every look: a process that ends takes its figures with it
            if what():
                return True
            last_s = now_s
            return False

        until(is_there)
        return last_s


def computed_s(pid: int) -> float:
    """Seconds of processor time that a process has had."""
    fields = Path(f"/proc/{pid}/stat").read_text(encoding="utf-8").rsplit(")", 1)[1].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def _queued_s(pids: tuple[int, ...]) -> dict[str, float]:
    """How long each thread of some processes has stood in the queue since it began; nothing of ended ones."""
    found = {}
    for pid in pids:
        with contextlib.suppress(FileNotFoundError):
            for thread in os.listdir(f"/proc/{pid}/task"):
                with contextlib.suppress(OSError), open(f"/proc/{pid}/task/{thread}/schedstat") as file:
                    found[thread] = int(file.read().split()[1]) * 1e-9
    return found


def until(what: Callable[[], Any], timeout_s: float = PATIENCE_S, pause_s: float = PAUSE_S) -> Any:
    """Wait for something to be there or true, and return it; a shorter time-out than usual is none."""
    end_s = time.monotonic() + (timeout_s := max(timeout_s, PATIENCE_S))
    while not (found := what()):
        assert time.monotonic() < end_s, f"not within {timeout_s} s"
        time.sleep(pause_s)
    return found


async def eventually(what: Callable[[], Any], timeout_s: float = PATIENCE_S) -> Any:
    """Do as `until` while the event loop goes on; what is asked may be awaited."""

    async def look() -> Any:
        found = what()
        return await found if inspect.isawaitable(found) else found

    end_s = time.monotonic() + (timeout_s := max(timeout_s, PATIENCE_S))
    while not (found := await look()):
        assert time.monotonic() < end_s, f"not within {timeout_s} s"
        await asyncio.sleep(PAUSE_S)
    return found
