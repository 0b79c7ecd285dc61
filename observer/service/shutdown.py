"""Leaving on SIGTERM or SIGINT within a bound, whatever the rest of the process is stuck in."""

from __future__ import annotations

import os
import signal
import socket
import sys
import threading
from collections.abc import Callable
from types import FrameType, TracebackType
from typing import NoReturn

GRACE_S = 1.7


class StopSignals:
    """Tells of the first SIGTERM or SIGINT and leaves the process `GRACE_S` later, or at the second.

    Signals are heard by a thread through the wake-up descriptor, which the system writes to even while the
    main thread hangs in compiled code. `flush` is called before the process is left by force. Only the main
    thread may enter.
    """

    def __init__(self, flush: Callable[[], object]) -> None:
        self._flush = flush
        self._here, self._there = socket.socketpair()
        self._lock = threading.Lock()
        self._heard = False
        self._stop: Callable[[], None] | None = None

    def when_heard(self, stop: Callable[[], None]) -> None:
        """Call `stop` at the first signal, or now if it has come already."""
        with self._lock:
            self._stop = stop
            if self._heard:
                stop()

    def __enter__(self) -> StopSignals:
        self._there.setblocking(False)
        self._handlers = {s: signal.signal(s, _ignored) for s in (signal.SIGTERM, signal.SIGINT)}
        self._fd = signal.set_wakeup_fd(self._there.fileno(), warn_on_full_buffer=False)
        threading.Thread(target=self._listen, name="signals", daemon=True).start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        signal.set_wakeup_fd(self._fd)
        for number, handler in self._handlers.items():
            signal.signal(number, handler)
        self._there.close()

    def _listen(self) -> None:
        heard = {bytes([s]) for s in self._handlers}
        with self._here:
            while (byte := self._here.recv(1)) not in heard:
                if not byte:
                    return
            with self._lock:
                self._heard = True
                if self._stop is not None:
                    self._stop()
            self._here.settimeout(GRACE_S)
            try:
                if not self._here.recv(1):
                    return  # left in good time
            except TimeoutError:
                pass
        self._flush()
        leave(0)


def _ignored(_number: int, _frame: FrameType | None) -> None:
    """Nothing: the wake-up descriptor has told the thread already."""


def leave(code: int) -> NoReturn:
    """End the process at once, without waiting for threads of libraries that may hang."""
    for stream in (sys.stdout, sys.stderr):
        try:
            stream.flush()
        except (OSError, ValueError):
            continue  # closed or broken: nobody reads it any more
    os._exit(code)
