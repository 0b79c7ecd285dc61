"""The simulated control's process, as tests hold it."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from tests.patience import PATIENCE_S
from tests.system.plant import ROOT


class SimulatedControl:
    """A control that runs."""

    def __init__(self, process: subprocess.Popen[bytes]) -> None:
        self.process = process
        self.port: int = json.loads(process.stdout.readline())["port"]
        self.settings = {"kind": "modbus", "host": "127.0.0.1", "port": self.port}

    def command(self, **command: Any) -> dict[str, Any]:
        """Send a command; returns the status after it."""
        self.process.stdin.write(json.dumps(command).encode() + b"\n")
        self.process.stdin.flush()
        return json.loads(self.process.stdout.readline())

    def status(self) -> dict[str, Any]:
        """What it is doing now."""
        return self.command()

    @property
    def largest_um(self) -> float:
        """The largest correction anywhere now."""
        return max(map(abs, self.status()["now_um"]), default=0.0)


@contextmanager
def simulated_control(*arguments: str) -> Iterator[SimulatedControl]:
    """A running control; it ends when its standard input closes."""
    command = [sys.executable, "-m", "drivers.simulated.control", *arguments]
    pipe = subprocess.PIPE
    with subprocess.Popen(command, cwd=ROOT, stdin=pipe, stdout=pipe) as process:
        try:
            yield SimulatedControl(process)
        finally:
            process.send_signal(signal.SIGCONT)
            process.stdin.close()
            try:
                assert process.wait(PATIENCE_S) == 0
            finally:
                process.kill()
