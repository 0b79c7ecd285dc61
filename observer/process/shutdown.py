"""Leaving on SIGTERM or SIGINT within a limited time, even if the process hangs; SIGHUP requests a reload.

Commands that end without a signal are interrupted by an exception, raised where it is not lost.
"""

from __future__ import annotations

import math
import os
import select
import signal
import socket
import sys
import threading
import time
from collections.abc import Callable
from types import FrameType
from typing import NoReturn

GRACE_S = 1.7
AGAIN_S = 0.05
ON_ITS_WAY_S = 1.0


class StopSignals:
    """Reports the first SIGTERM or SIGINT and leaves the process `GRACE_S` later, or at the second.

    Signals reach a thread through the wake-up descriptor, which the system writes to even while the main
    thread hangs in compiled code. `flush` is called before the process is left by force. SIGHUP requests that
    the configuration be read again. Without a configuration, or if the terminal has closed, it ends the
    process like the others. Only the main thread may enter.
    """

    def __init__(self, flush: Callable[[], object]) -> None:
        self._flush = flush
        self._here, self._there = socket.socketpair()
        self._lock = threading.Lock()
        self._heard = False
        self._stop: Callable[[], None] | None = None
        self._reload: Callable[[], None] | None = None
        self._terminals = [fd for fd in range(3) if os.isatty(fd)]

    def when_asked(self, reload: Callable[[], None]) -> None:
        """Call `reload` at each SIGHUP from now on, and at one that was pending when the process was
        executed.
        """
        self._reload = reload
        signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGHUP})

    @property
    def heard(self) -> bool:
        """Whether a signal to end has come."""
        return self._heard

    def when_heard(self, stop: Callable[[], None]) -> None:
        """Call `stop` at the first signal, or now if it has come already."""
        with self._lock:
            self._stop = stop
            if self._heard:
                stop()

    def __enter__(self) -> StopSignals:
        self._there.setblocking(False)
        # nothing: the wake-up descriptor notifies the thread
        self._handlers = {s: signal.signal(s, lambda *_: None) for s in _HEARD}
        self._fd = signal.set_wakeup_fd(self._there.fileno(), warn_on_full_buffer=False)
        threading.Thread(target=self._listen, name="signals", daemon=True).start()
        return self

    def __exit__(self, *_error: object) -> None:
        signal.set_wakeup_fd(self._fd)
        for number, handler in self._handlers.items():
            signal.signal(number, handler)
        self._there.close()

    def _listen(self) -> None:
        with self._here:
            while (number := self._next(None)) == signal.SIGHUP and not self._is_end():
                pass
            if not number:
                return
            with self._lock:
                self._heard = True
                if self._stop is not None:
                    self._stop()
            end_s = time.monotonic() + GRACE_S
            while (number := self._next(end_s - time.monotonic())) == signal.SIGHUP:
                pass
            if number == 0:
                return  # left in good time
        self._flush()
        leave(0)

    def _next(self, timeout_s: float | None) -> int | None:
        """Return the number of the next handled signal; 0 after the end, None after the time-out."""
        self._here.settimeout(None if timeout_s is None else max(timeout_s, 1e-3))
        try:
            while (byte := self._here.recv(1)) and byte[0] not in self._handlers:
                pass
        except TimeoutError:
            return None
        return byte[0] if byte else 0

    def _is_end(self) -> bool:
        """Whether a SIGHUP ends the process; if not, the configuration is read again."""
        if self._reload is None or any(_is_hung_up(fd) for fd in self._terminals):
            return True
        self._reload()
        return False


_HEARD = (signal.SIGTERM, signal.SIGINT, signal.SIGHUP)


def _is_hung_up(terminal: int) -> bool:
    poll = select.poll()
    poll.register(terminal, select.POLLIN)
    return any(event & (select.POLLHUP | select.POLLERR | select.POLLNVAL) for _, event in poll.poll(0))


def leave(code: int) -> NoReturn:
    """End the process at once, without waiting for threads of libraries that may hang."""
    for stream in (sys.stdout, sys.stderr):
        try:
            stream.flush()
        except (OSError, ValueError):
            continue  # closed or broken: nobody reads it any more
    os._exit(code)


def arriving(act: Callable[[int], object]) -> Callable[[int, FrameType | None], None]:
    """Return a handler that calls `act`, which may raise, with the signal's number.

    Where an exception would be lost, the signal is raised again a little later, for its handler at that time.
    """

    def take(number: int, frame: FrameType | None) -> None:
        if _is_lost_in(frame):
            signal.signal(signal.SIGALRM, lambda *_: signal.raise_signal(number))
            signal.setitimer(signal.ITIMER_REAL, AGAIN_S)
        else:
            act(number)

    return take


def interrupting() -> Callable[[int], None]:
    """Return a function that raises `KeyboardInterrupt`, but not again while the first one is still being
    handled.
    """
    raised_s = -math.inf

    def interrupt(_number: int) -> None:
        nonlocal raised_s
        if time.monotonic() - raised_s > ON_ITS_WAY_S:
            raised_s = time.monotonic()
            raise KeyboardInterrupt

    return interrupt


def _is_lost_in(frame: FrameType | None) -> bool:
    """Whether an exception may be lost or replaced on its way out of a frame.

    Libraries take a module for missing whatever its import raises.
    """
    while frame is not None:
        if frame.f_code.co_filename.startswith("<frozen importlib"):
            return True
        frame = frame.f_back
    return False
