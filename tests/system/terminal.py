"""A program in a terminal of its own, and a busy computer around it."""

from __future__ import annotations

import fcntl
import os
import struct
import subprocess
import sys
import termios
import threading
from collections.abc import Iterator
from contextlib import contextmanager

from tests.system.plant import ROOT

CTRL_C = b"\x03"
HIDE_CURSOR, SHOW_CURSOR = "\x1b[?25l", "\x1b[?25h"
_BUSY = """
import os, threading
threading.Thread(target=lambda: (os.read(0, 1), os._exit(0)), daemon=True).start()
while True: pass
"""
# A session's leader that opens a terminal has it for its own; then the program takes over. Tests behind
# other work may have Ctrl-C ignored; whoever sits at a terminal has not.
_TAKE_TERMINAL = """
import os, signal, sys
signal.signal(signal.SIGINT, signal.SIG_DFL)
os.close(os.open(os.ttyname(0), os.O_RDWR))
os.execv(sys.executable, [sys.executable, *sys.argv[1:]])
"""


class Terminal:
    """`python …` under a pseudo-terminal that is its controlling one; everything it prints is kept."""

    def __init__(self, *command: str) -> None:
        self._master, self._slave = os.openpty()
        fcntl.ioctl(self._slave, termios.TIOCSWINSZ, struct.pack("HHHH", 40, 120, 0, 0))
        self._modes = termios.tcgetattr(self._slave)
        self._pieces: list[bytes] = []
        self.process = subprocess.Popen(
            [sys.executable, "-c", _TAKE_TERMINAL, *command],
            cwd=ROOT,
            stdin=self._slave,
            stdout=self._slave,
            stderr=self._slave,
            start_new_session=True,
        )
        threading.Thread(target=self._read, daemon=True).start()

    def __enter__(self) -> Terminal:
        return self

    def __exit__(self, *_: object) -> None:
        self.process.kill()
        self.process.wait(5)
        os.close(self._slave)

    def _read(self) -> None:
        while True:
            try:
                self._pieces.append(os.read(self._master, 65536))
            except OSError:  # nobody has the terminal open any more
                os.close(self._master)
                return

    def type(self, keys: bytes) -> None:
        """Press keys."""
        os.write(self._master, keys)

    def shown(self) -> str:
        """Everything printed so far."""
        return b"".join(self._pieces).decode(errors="replace")

    def assert_sane(self) -> None:
        """The terminal is as before: its modes, a visible cursor, and no traceback on it."""
        assert termios.tcgetattr(self._slave) == self._modes
        shown = self.shown()
        assert shown.rfind(SHOW_CURSOR) >= shown.rfind(HIDE_CURSOR)
        assert "Traceback" not in shown


@contextmanager
def busy_cores() -> Iterator[None]:
    """One busy loop on every core."""
    loops = [
        subprocess.Popen([sys.executable, "-c", _BUSY], stdin=subprocess.PIPE)
        for _ in range(os.cpu_count() or 1)
    ]
    try:
        yield
    finally:
        for loop in loops:
            loop.kill()
            loop.wait()
            loop.stdin.close()
