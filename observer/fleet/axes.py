"""Several axes from one command: a process each, started in turn, watched over, and started again.

The parent is to its axes what systemd is to a single service: it hears the same messages (`sd_notify`: READY,
WATCHDOG), and ends and restarts what has ended or hangs.
"""

from __future__ import annotations

import os
import select
import signal
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path

import structlog

from observer.errors import ConfigError
from observer.installation import Installation, load
from observer.process.notify import service_manager
from observer.publish.session import listening

log = structlog.get_logger()
LOOK_S = 0.2
WATCHDOG_S = 10.0
"""As in the unit of a single service: WATCHDOG comes from completed cycles only."""
START_S = 90.0
"""To READY, as in the unit."""
FIRST_PAUSE_S, LONGEST_PAUSE_S = 1.0, 60.0
STEADY_S = 60.0
"""An axis that has lived so long begins with the short pause again."""
END_S = 4.0
_OWN_PORT = "give each axis a port of its own"
_ONE_ROUTER = 'let one of them, or a router, listen there; the others have mode = "client" and connect to it'
_REMEDY = {
    "publish.listen": _ONE_ROUTER,
    "page.listen": _OWN_PORT,
    "metrics.listen": _OWN_PORT,
    "opcua.listen": _OWN_PORT,
}
NOT_TO_BE_MENDED = 2
"""The exit code for what a person has to mend, which starting again does not."""


def check_axes(paths: Sequence[Path]) -> list[Installation]:
    """Read the configurations of several axes. Raises `ConfigError` where two are in each other's way."""
    configs = [load(path) for path in paths]
    names: dict[str, Path] = {}
    taken: dict[str, Path] = {}
    for path, config in zip(paths, configs, strict=True):
        name = f"{config.machine.name}/{config.machine.axis}"
        if name in names:
            raise ConfigError(f"{path}: {name} is the axis of {names[name]} already; give it another name")
        names[name] = path
        for key, place in _listens(config):
            if place in taken:
                raise ConfigError(f"{path}: {key}: {taken[place]} listens on {place} already; {_REMEDY[key]}")
            taken[place] = path
    return configs


def _listens(config: Installation) -> Iterator[tuple[str, str]]:
    """Where an axis listens, by key."""
    for endpoint in listening(config.publish):
        yield "publish.listen", endpoint
    for key in ("page", "metrics", "opcua"):
        if (table := getattr(config, key)) is not None:
            yield f"{key}.listen", table.listen


class Axis:
    """One axis: its process, when it was last heard of, and when it is to be started again."""

    def __init__(self, name: str, command: Sequence[str], place: Path) -> None:
        """Prepare; `place` is where its messages are heard."""
        self.name, self._command, self._place = name, command, place
        self.ear = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        self.ear.bind(str(place))
        self.ear.setblocking(False)
        self.process: subprocess.Popen[bytes] | None = None
        self.ready = False
        self.over: int | None = None
        self.due_s = 0.0
        self._pause_s = FIRST_PAUSE_S
        self._begun_s = self._heard_s = 0.0

    def start(self, now_s: float) -> None:
        """Start its process."""
        environment = os.environ | {"NOTIFY_SOCKET": str(self._place)}
        self.process = subprocess.Popen(
            self._command, stdin=subprocess.PIPE, env=environment, start_new_session=True
        )
        self.ready = False
        self._begun_s = self._heard_s = now_s

    def hear(self, now_s: float) -> None:
        """Take what it has said."""
        with suppress(BlockingIOError):
            while words := self.ear.recv(4096).decode(errors="replace").split("\n"):
                self.ready = self.ready or "READY=1" in words
                if "WATCHDOG=1" in words or "READY=1" in words:
                    self._heard_s = now_s

    def see_to(self, now_s: float, *, ending: bool) -> None:
        """End it where it hangs; where it has ended, say so, and when it is started again."""
        if self.process is None:
            return
        code = self.process.poll()
        if code is None:
            if now_s - self._heard_s > (WATCHDOG_S if self.ready else START_S):
                log.error("axis hangs and is ended", axis=self.name, silent_s=round(now_s - self._heard_s))
                self.process.kill()
            return
        if self.process.stdin is not None:
            self.process.stdin.close()
        self.process = None
        if ending or code in (0, NOT_TO_BE_MENDED):
            self.over = code
            if not ending and code:
                log.error("axis is given up until it is mended", axis=self.name)
            return
        if now_s - self._begun_s > STEADY_S:
            self._pause_s = FIRST_PAUSE_S
        log.error("axis has ended and is started again", axis=self.name, code=code, in_s=self._pause_s)
        self.due_s, self._pause_s = now_s + self._pause_s, min(2 * self._pause_s, LONGEST_PAUSE_S)

    def tell(self, number: int) -> None:
        """Send it a signal."""
        if self.process is not None:
            self.process.send_signal(number)


def serve_axes(paths: Sequence[Path], seconds: float | None, log_format: str) -> int:
    """Serve several axes until SIGTERM, SIGINT or for `seconds`; returns the exit code. Raises `ConfigError`.

    SIGHUP has all of them read their configurations again. Should this process be killed, they end by
    themselves.
    """
    configs = check_axes(paths)
    notify = service_manager()
    with tempfile.TemporaryDirectory(prefix="observer-") as folder, _signals() as heard:
        tail = [log_format, "" if seconds is None else str(seconds)]
        axes = [
            Axis(
                f"{config.machine.name}/{config.machine.axis}",
                [sys.executable, "-m", "observer.fleet.axis", str(path), *tail],
                Path(folder, str(number)),
            )
            for number, (path, config) in enumerate(zip(paths, configs, strict=True))
        ]
        try:
            told = False
            while any(axis.over is None for axis in axes) and not heard(axes):
                _look_after(axes)
                if not told and all(axis.ready or axis.over is not None for axis in axes):
                    notify("READY=1")
                    told = True
                notify("WATCHDOG=1" if told else f"EXTEND_TIMEOUT_USEC={int(START_S * 1e6)}")
        finally:
            _end(axes)
    return max((axis.over or 0 for axis in axes), default=0)


def _look_after(axes: Sequence[Axis]) -> None:
    """Hear and see to each, and start the next one that is to run; as many at a time as there are cores."""
    select.select([axis.ear for axis in axes], [], [], LOOK_S)
    now_s = time.monotonic()
    for axis in axes:
        axis.hear(now_s)
        axis.see_to(now_s, ending=False)
    starting = sum(axis.process is not None and not axis.ready for axis in axes)
    if starting < (os.cpu_count() or 1):
        for axis in axes:
            if axis.process is None and axis.over is None and now_s >= axis.due_s:
                axis.start(now_s)
                break


def _end(axes: Sequence[Axis]) -> None:
    """End all of them, by force where they do not end in time."""
    for axis in axes:
        axis.tell(signal.SIGTERM)
    end_s = time.monotonic() + END_S
    for axis in axes:
        if axis.process is not None:
            try:
                axis.process.wait(max(0.0, end_s - time.monotonic()))
            except subprocess.TimeoutExpired:
                axis.process.kill()
                axis.process.wait()
        axis.see_to(time.monotonic(), ending=True)
        axis.ear.close()


@contextmanager
def _signals() -> Iterator[_Heard]:
    """Take SIGTERM, SIGINT and SIGHUP as notes to be read between two looks."""
    heard = _Heard()
    before = {number: signal.signal(number, heard.take) for number in _TAKEN}
    try:
        yield heard
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


_TAKEN = (signal.SIGTERM, signal.SIGINT, signal.SIGHUP)


class _Heard:
    """The signals that came; called, it hands SIGHUP on and says whether to end."""

    def __init__(self) -> None:
        self._numbers: list[int] = []

    def take(self, number: int, _frame: object) -> None:
        """Note a signal."""
        self._numbers.append(number)

    def __call__(self, axes: Sequence[Axis]) -> bool:
        numbers, self._numbers = self._numbers, []
        if signal.SIGHUP in numbers:
            for axis in axes:
                axis.tell(signal.SIGHUP)
        return signal.SIGTERM in numbers or signal.SIGINT in numbers
