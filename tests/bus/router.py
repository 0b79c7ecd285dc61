"""A Zenoh router in a process of its own, to be killed or frozen; it ends when its standard input closes."""

import itertools
import os
import signal
import socket
import subprocess
import sys
from contextlib import suppress
from types import TracebackType

from tests.patience import PATIENCE_S

SCRIPT = """
import sys
import zenoh
from observer.bus.session import session_config
with zenoh.open(session_config("router", (), (sys.argv[1],))):
    print("ready", flush=True)
    sys.stdin.read()
"""


FIRST_PORT, PORTS, WORKERS = 20_000, 1_500, 8
"""Ports that tests listen on: so many for each worker, all below those that systems give away."""
_WORKER = int(os.environ.get("PYTEST_XDIST_WORKER", "gw0")[2:]) % WORKERS
_ports = itertools.count(os.getpid())  # another process of the same worker hardly begins where this one is


def free_port() -> int:
    """A port of the loopback interface that nobody listens on now, and that is given to nobody else.

    One that the system chooses may go to an outgoing connection, or to another test, before who is to listen
    on it has started.
    """
    for number in itertools.islice(_ports, PORTS):
        port = FIRST_PORT + _WORKER * PORTS + number % PORTS
        with socket.socket() as probe, suppress(OSError):
            probe.bind(("127.0.0.1", port))
            return port
    raise OSError(f"all ports of {_WORKER} are taken")


class Router:
    """A router as a context; `endpoint` is where it listens."""

    def __init__(self, port: int | None = None) -> None:
        self.port = port or free_port()
        self.endpoint = f"tcp/127.0.0.1:{self.port}"

    def __enter__(self) -> "Router":
        self.start()
        return self

    def start(self) -> None:
        """Start it, also once more after it was killed."""
        self._process = subprocess.Popen(
            [sys.executable, "-c", SCRIPT, self.endpoint], stdin=subprocess.PIPE, stdout=subprocess.PIPE
        )
        self.pid = self._process.pid
        assert self._process.stdout.readline() == b"ready\n"

    def kill(self) -> None:
        self._process.kill()
        self._process.wait(PATIENCE_S)
        self._process.stdin.close()
        self._process.stdout.close()

    def freeze(self) -> None:
        self._process.send_signal(signal.SIGSTOP)

    def thaw(self) -> None:
        self._process.send_signal(signal.SIGCONT)

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.kill()
