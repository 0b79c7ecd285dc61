"""Several axes from one command: a process each, started in turn, supervised and restarted.

For containers, and wherever there is no systemd: the parent reads the messages that systemd would
(`sd_notify`: READY, WATCHDOG), and restarts a process that has ended or hangs.
"""

from __future__ import annotations

import os
import select
import signal
import socket
import subprocess
import sys
import tempfile
import threading
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
"""An axis that has run for so long begins with the short pause again."""
END_S = 4.0
_OWN_PORT = "give each axis a port of its own"
_ONE_ROUTER = 'let one of them, or a router, listen there; the others have mode = "client" and connect to it'
_REMEDY = {
    "publish.listen": _ONE_ROUTER,
    "page.listen": _OWN_PORT,
    "metrics.listen": _OWN_PORT,
    "opcua.listen": _OWN_PORT,
}
FOR_A_PERSON = 2
"""The exit code for what a person has to fix, such as the configuration; a restart does not help."""
_ONE_OF_SEVERAL = "BALLSCREW_OBSERVER_AXIS"
"""Set to the name of its axis in the environment of each process."""


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


def one_of_several() -> str | None:
    """Name the axis that this process serves for a parent, and end with that parent; None without one."""
    if (name := os.environ.get(_ONE_OF_SEVERAL)) is not None:
        threading.Thread(target=_end_with_parent, name="parent", daemon=True).start()
    return name


def _end_with_parent() -> None:
    """Standard input closes when the parent ends, for whatever reason."""
    sys.stdin.read()
    os.kill(os.getpid(), signal.SIGTERM)


class AxisProcess:
    """The process of one axis: its last message, and when it is due to be started again."""

    def __init__(self, name: str, command: Sequence[str], address: Path) -> None:
        """Prepare; `address` is the socket that receives its messages."""
        self.name, self._command, self._address = name, command, address
        self.inbox = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        self.inbox.bind(str(address))
        self.inbox.setblocking(False)
        self.process: subprocess.Popen[bytes] | None = None
        self.ready = False
        self.exit_code: int | None = None
        """Set once it is not to be started again."""
        self.due_s = 0.0
        self._pause_s = FIRST_PAUSE_S
        self._started_s = self._heard_s = 0.0

    def start(self, now_s: float) -> None:
        """Start its process."""
        environment = os.environ | {"NOTIFY_SOCKET": str(self._address), _ONE_OF_SEVERAL: self.name}
        self.process = subprocess.Popen(
            self._command, stdin=subprocess.PIPE, env=environment, start_new_session=True
        )
        self.ready = False
        self._started_s = self._heard_s = now_s

    def receive(self, now_s: float) -> None:
        """Read its messages."""
        with suppress(BlockingIOError):
            while lines := self.inbox.recv(4096).decode(errors="replace").split("\n"):
                self.ready = self.ready or "READY=1" in lines
                if "WATCHDOG=1" in lines or "READY=1" in lines:
                    self._heard_s = now_s

    def supervise(self, now_s: float, *, ending: bool) -> None:
        """Kill it if it hangs; if it has ended, log that, and schedule its restart."""
        if self.process is None:
            return
        code = self.process.poll()
        if code is None:
            if now_s - self._heard_s > (WATCHDOG_S if self.ready else START_S):
                log.error("axis hangs and is killed", axis=self.name, silent_s=round(now_s - self._heard_s))
                self.process.kill()
            return
        if self.process.stdin is not None:
            self.process.stdin.close()
        self.process = None
        if ending or code in (0, FOR_A_PERSON):
            self.exit_code = code
            if not ending and code:
                log.error("axis is given up until its configuration is fixed", axis=self.name)
            return
        if now_s - self._started_s > STEADY_S:
            self._pause_s = FIRST_PAUSE_S
        log.error("axis has ended and is restarted", axis=self.name, code=code, in_s=self._pause_s)
        self.due_s, self._pause_s = now_s + self._pause_s, min(2 * self._pause_s, LONGEST_PAUSE_S)

    def send(self, number: int) -> None:
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
    options = ["--log-format", log_format, *([] if seconds is None else ["--seconds", str(seconds)])]
    with tempfile.TemporaryDirectory(prefix="observer-") as folder, _signals() as received:
        axes = [
            AxisProcess(
                f"{config.machine.name}/{config.machine.axis}",
                [sys.executable, "-m", "observer", "run", "--config", str(path), *options],
                Path(folder, str(number)),
            )
            for number, (path, config) in enumerate(zip(paths, configs, strict=True))
        ]
        try:
            ready = False
            while any(axis.exit_code is None for axis in axes) and received.isdisjoint(_END):
                if signal.SIGHUP in received:
                    received.discard(signal.SIGHUP)
                    for axis in axes:
                        axis.send(signal.SIGHUP)
                _supervise(axes)
                if not ready and all(axis.ready or axis.exit_code is not None for axis in axes):
                    notify("READY=1")
                    ready = True
                notify("WATCHDOG=1" if ready else f"EXTEND_TIMEOUT_USEC={int(START_S * 1e6)}")
        finally:
            _end(axes)
    return max((axis.exit_code or 0 for axis in axes), default=0)


def _supervise(axes: Sequence[AxisProcess]) -> None:
    """Supervise each, and start the next one that is due; at most as many at a time as there are cores."""
    select.select([axis.inbox for axis in axes], [], [], LOOK_S)
    now_s = time.monotonic()
    for axis in axes:
        axis.receive(now_s)
        axis.supervise(now_s, ending=False)
    starting = sum(axis.process is not None and not axis.ready for axis in axes)
    if starting < (os.cpu_count() or 1):
        for axis in axes:
            if axis.process is None and axis.exit_code is None and now_s >= axis.due_s:
                axis.start(now_s)
                break


def _end(axes: Sequence[AxisProcess]) -> None:
    """End all of them, by force where they do not end in time."""
    for axis in axes:
        axis.send(signal.SIGTERM)
    end_s = time.monotonic() + END_S
    for axis in axes:
        if axis.process is not None:
            try:
                axis.process.wait(max(0.0, end_s - time.monotonic()))
            except subprocess.TimeoutExpired:
                axis.process.kill()
                axis.process.wait()
        axis.supervise(time.monotonic(), ending=True)
        axis.inbox.close()


_END = (signal.SIGTERM, signal.SIGINT)


@contextmanager
def _signals() -> Iterator[set[int]]:
    """Collect SIGTERM, SIGINT and SIGHUP in a set."""
    received: set[int] = set()
    before = {
        number: signal.signal(number, lambda number, _frame: received.add(number))
        for number in (*_END, signal.SIGHUP)
    }
    try:
        yield received
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
