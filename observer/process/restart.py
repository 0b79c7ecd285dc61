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
    """The state that a process hands to itself when it is executed anew.

    Attributes:
        reason: why
        time_s: when
        table: the checked table of the configuration
        reload_pending: whether another reload was requested since
        ends_s: time of `time.monotonic()` at which the process ends, None if never
    """

    reason: str
    time_s: float
    table: dict[str, Any]
    reload_pending: bool = False
    ends_s: float | None = None

    def document(self) -> dict[str, Any]:
        """Return the field of health."""
        return {"time_s": self.time_s, "reason": self.reason}


def restarted() -> Restart | None:
    """Return the state of the process before, None after an ordinary start; only the first call returns
    it.
    """
    number = os.environ.pop(_VARIABLE, None)
    if number is None:
        return None
    try:
        with os.fdopen(int(number), "rb") as file:
            return Restart(**cbor2.load(file))
    except (OSError, ValueError, TypeError, cbor2.CBORError):
        return None  # the variable is somebody else's


def execute_anew(restart: Restart) -> NoReturn:
    """Execute the process anew after ending its children.

    If the program can no longer be executed, the process ends with exit code 1.
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
    """Kill every child process and take its exit code, since the new program does not know them."""
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
