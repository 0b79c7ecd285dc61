"""Executes the process anew: the same program, arguments and process number, with all memory fresh."""

from __future__ import annotations

import contextlib
import json
import os
import signal
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple, NoReturn

import structlog

from observer.process.shutdown import leave

_VARIABLE = "OBSERVER_RESTART"
_CHILDREN_END_S = 1.0
_LOOK_S = 0.01

log = structlog.get_logger()


class Restart(NamedTuple):
    """Why the process was executed anew and when, and at which `time.monotonic()` it ends, None if never."""

    reason: str
    time_s: float
    ends_s: float | None = None

    def document(self) -> dict[str, Any]:
        """The field of health."""
        return {"time_s": self.time_s, "reason": self.reason}


def restarted() -> Restart | None:
    """Why this process was executed anew, None for any other start; only the first call tells."""
    text = os.environ.pop(_VARIABLE, None)
    if text is None:
        return None
    with contextlib.suppress(ValueError, TypeError):
        return Restart(**json.loads(text))
    return None


def execute_anew(restart: Restart) -> NoReturn:
    """Execute the process anew; its children are ended before.

    Where the program cannot be executed any more, the process ends with exit code 1.
    """
    _end_children()
    # it would end the new program until that handles it; here it waits until then
    signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGHUP})
    os.environ[_VARIABLE] = json.dumps(restart._asdict())
    for stream in (sys.stdout, sys.stderr):
        with contextlib.suppress(OSError, ValueError):
            stream.flush()
    try:
        os.execv(sys.executable, sys.orig_argv)
    except OSError as error:
        log.error("the program cannot be executed anew", program=sys.executable, reason=error.strerror)
        leave(1)


def _end_children() -> None:
    """Kill every child process and take its exit code: the new program knows none of them."""
    end_s = time.monotonic() + _CHILDREN_END_S
    while time.monotonic() < end_s:
        for child in _children():
            with contextlib.suppress(ProcessLookupError):
                os.kill(child, signal.SIGKILL)
        with contextlib.suppress(InterruptedError):
            try:
                while os.waitpid(-1, os.WNOHANG)[0]:
                    pass
            except ChildProcessError:
                return
        time.sleep(_LOOK_S)


def _children() -> Iterator[int]:
    """The processes that this one has started and that have not ended."""
    for thread in Path("/proc/self/task").iterdir():
        with contextlib.suppress(OSError):
            yield from map(int, (thread / "children").read_text(encoding="ascii").split())
