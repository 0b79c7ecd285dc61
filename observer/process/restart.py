"""Executes the process anew: the same program, arguments and process number, with all memory fresh."""

from __future__ import annotations

import contextlib
import os
import signal
import sys
import time
from pathlib import Path
from typing import Any, NamedTuple, NoReturn

import cbor2
import structlog

from observer.process.shutdown import leave

_VARIABLE = "OBSERVER_RESTART"
_CHILDREN_END_S = 1.0
_LOOK_S = 0.01

log = structlog.get_logger()


class Restart(NamedTuple):
    """What a process that is executed anew is told.

    Why and when it was, and the table of the configuration that was checked; `reload_pending` says that a
    reload was requested since. At `ends_s` of `time.monotonic()` the process ends, None if never.
    """

    reason: str
    time_s: float
    table: dict[str, Any]
    reload_pending: bool = False
    ends_s: float | None = None

    def document(self) -> dict[str, Any]:
        """The field of health."""
        return {"time_s": self.time_s, "reason": self.reason}


def restarted() -> Restart | None:
    """What this process was told, None after an ordinary start; only the first call returns it."""
    number = os.environ.pop(_VARIABLE, None)
    if number is None:
        return None
    try:
        with os.fdopen(int(number), "rb") as file:
            return Restart(**cbor2.load(file))
    except (OSError, ValueError, TypeError, cbor2.CBORError):
        return None  # the variable is somebody else's


def execute_anew(restart: Restart) -> NoReturn:
    """Execute the process anew; its children are ended before.

    Where the program cannot be executed any more, the process ends with exit code 1.
    """
    _end_children()
    # it would end the new program until that handles it; here it waits until then
    signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGHUP})
    with os.fdopen(os.memfd_create("restart"), "w+b") as file:
        cbor2.dump(restart._asdict(), file)
        file.flush()
        file.seek(0)
        os.set_inheritable(file.fileno(), True)
        os.environ[_VARIABLE] = str(file.fileno())
        sys.stdout.flush()
        try:
            os.execv(sys.executable, sys.orig_argv)
        except OSError as error:
            log.error("the program cannot be executed anew", program=sys.executable, reason=error.strerror)
            leave(1)


def _end_children() -> None:
    """Kill every child process and take its exit code: the new program knows none of them."""
    end_s = time.monotonic() + _CHILDREN_END_S
    while time.monotonic() < end_s:
        for thread in Path("/proc/self/task").iterdir():
            with contextlib.suppress(OSError):
                for child in (thread / "children").read_text(encoding="ascii").split():
                    os.kill(int(child), signal.SIGKILL)
        try:
            while os.waitpid(-1, os.WNOHANG)[0]:
                pass
        except ChildProcessError:
            return
        time.sleep(_LOOK_S)
