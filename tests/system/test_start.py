"""The start of a daemon, as systemd sees it."""

from __future__ import annotations

import os
import re
import socket
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import pytest

from tests.bus.router import free_port
from tests.system.plant import ROOT, START_S, Daemon, Subscriber, children_of, machine, table_for, until

pytestmark = pytest.mark.system

UNIT = ROOT / "observer/installation/systemd/ballscrew-observer.service"
# As MemoryDenyWriteExecute= of the unit has it (PR_SET_MDWE, 65; kernels before 6.3 do not know it).
NO_CODE_MADE = (
    "-c",
    "import ctypes; ctypes.CDLL(None).prctl(65, 1, 0, 0, 0); from observer.cli import main; main()",
)


@contextmanager
def service_manager(monkeypatch: pytest.MonkeyPatch) -> Iterator[socket.socket]:
    """A socket where a daemon's `sd_notify` arrives."""
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as manager:
        name = f"ballscrew-test-{os.getpid()}"
        manager.bind(f"\0{name}")
        manager.settimeout(0.0)
        monkeypatch.setenv("NOTIFY_SOCKET", f"@{name}")
        yield manager


def heard(manager: socket.socket) -> list[str]:
    notes = []
    with suppress(BlockingIOError):
        while True:
            notes.append(manager.recv(4096).decode())
    return notes


def _memory_MB(pid: int, what: str) -> float:
    """What a process holds: `Pss`, shared pages counted in part; `Rss`, in full; 0 once it has ended."""
    try:
        text = Path(f"/proc/{pid}/smaps_rollup").read_text(encoding="utf-8")
    except OSError:
        return 0.0
    return int(re.search(rf"^{what}:\s+(\d+)", text, re.MULTILINE)[1]) / 1024


def test_it_is_ready_with_its_first_estimate_and_stays_within_its_memory(tmp_path, monkeypatch):
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    notes: list[str] = []
    peak_MB = 0.0
    with machine() as plant, service_manager(monkeypatch) as manager:
        table = table_for(plant.wires, mode="router", listen=[endpoint])
        with Daemon(tmp_path, table, NO_CODE_MADE) as daemon, Subscriber(endpoint) as seen:

            def ready() -> bool:
                nonlocal peak_MB
                pid = daemon.process.pid
                peak_MB = max(peak_MB, sum(_memory_MB(p, "Pss") for p in (pid, *children_of(pid))))
                notes.extend(heard(manager))
                return bool(notes)

            until(ready, START_S)
            seen.wait_until_good()
            settled_MB = _memory_MB(daemon.process.pid, "Rss")
            assert daemon.stop() < 2.0
    assert notes[0].startswith("READY=1")
    limit_MB = float(re.search(r"^MemoryMax=(\d+)M$", UNIT.read_text(encoding="utf-8"), re.MULTILINE)[1])
    print(f"start: {peak_MB:.0f} MB at most, {settled_MB:.0f} MB then, of {limit_MB:.0f} MB")
    assert peak_MB < limit_MB
    assert settled_MB < 300.0
