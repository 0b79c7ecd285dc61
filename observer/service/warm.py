"""Kernels that are not in the cache are compiled before the first tick, by a process that then ends.

A compiler leaves several times the memory behind that the service needs by itself; with its process that
memory goes. The service then loads what it left in the cache.
"""

from __future__ import annotations

import contextlib
import gc
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from typing import Any

import structlog
from numba.core import event

_EXTEND_S = 30.0
_LOOK_S = 5.0
_TELL_S = 30.0
"""How often it is told that this goes on."""
_LONGEST_S = 1800.0
"""No computer that could run the service takes longer; what has not ended by then hangs."""

log = structlog.get_logger()


class NotCompiledError(Exception):
    """Something would have to be compiled."""


class Compiler:
    """Has a configuration's kernels compiled, if they are not; `module` does so, told by a line of text."""

    def __init__(self, module: str, line: str, notify: Callable[[str], object]) -> None:
        """Take the module to run, what it reads, and how the service manager is told (`sd_notify`)."""
        self._command = (sys.executable, "-m", module)
        self._line = line
        self._notify = notify
        self._child: subprocess.Popen[bytes] | None = None
        self._ended = False

    def warm(self, run: Callable[[], object]) -> None:
        """Call `run`, which uses every kernel; what it lacks is compiled before."""
        try:
            with event.install_listener("numba:compile", _Refusing()):
                run()
        except NotCompiledError:
            gc.enable()  # a start that takes long, and may have to compile here, has garbage
            begun_s = time.monotonic()
            log.warning("compiling the estimator's kernels; this takes some four minutes at the first start")
            self._notify("STATUS=compiling the estimator's kernels")
            self._compile()
            if not self._ended:
                run()
                log.info("compiled", took_s=round(time.monotonic() - begun_s, 1))
                self._notify("STATUS=")

    def end(self) -> None:
        """Give up what is being compiled."""
        self._ended = True
        if self._child is not None:
            self._child.kill()

    def _compile(self) -> None:
        """Run the process to its end; one that fails is told, and `run` then compiles by itself."""
        # in a session of its own: Ctrl-C is for the service, which then ends it
        with subprocess.Popen(
            self._command, stdin=subprocess.PIPE, bufsize=0, start_new_session=True
        ) as child:
            self._child = child
            assert child.stdin is not None
            with contextlib.suppress(BrokenPipeError):  # it has failed already, which its code will say
                child.stdin.write(self._line.encode() + b"\n")  # and stays open: it ends when this one does
            begun_s, told = time.monotonic(), 0
            while not self._ended and (took_s := time.monotonic() - begun_s) < _LONGEST_S:
                self._notify(f"EXTEND_TIMEOUT_USEC={int(_EXTEND_S * 1e6)}")
                if took_s // _TELL_S > told:
                    told = int(took_s // _TELL_S)
                    log.info("still compiling", so_far_s=round(took_s))
                    self._notify(f"STATUS=compiling the estimator's kernels, {took_s:.0f} s so far")
                try:
                    code = child.wait(_LOOK_S)
                except subprocess.TimeoutExpired:
                    continue
                if code and not self._ended:
                    log.warning("compiling apart failed; compiling here", code=code)
                return
            child.kill()


class _Refusing(event.Listener):
    """Refuses to compile in one thread: told before anything that is not in the cache is."""

    def __init__(self) -> None:
        self._thread = threading.get_ident()

    def on_start(self, _event: Any) -> None:
        if threading.get_ident() == self._thread:
            raise NotCompiledError

    def on_end(self, _event: Any) -> None:
        """Nothing: it never begins."""
