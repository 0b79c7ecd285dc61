"""The first start of a daemon on a machine where nothing has been compiled yet."""

from __future__ import annotations

import os
import re
import socket
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import pytest

from tests.patience import COMPILE_S
from tests.publish.router import free_port
from tests.system.plant import ROOT, Daemon, Subscriber, children_of, machine, table_for, until

pytestmark = [pytest.mark.system, pytest.mark.timeout(2 * COMPILE_S)]

UNIT = ROOT / "config" / "ballscrew-observer.service"


@contextmanager
def _service_manager(monkeypatch: pytest.MonkeyPatch) -> Iterator[socket.socket]:
    """A socket where a daemon's `sd_notify` arrives."""
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as manager:
        name = f"ballscrew-test-{os.getpid()}"
        manager.bind(f"\0{name}")
        manager.settimeout(0.0)
        monkeypatch.setenv("NOTIFY_SOCKET", f"@{name}")
        yield manager


def _heard(manager: socket.socket) -> list[str]:
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


@pytest.mark.slow
def test_it_compiles_before_it_is_ready_says_so_and_stays_within_its_memory(tmp_path, monkeypatch):
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "empty"))
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    notes: list[str] = []
    peak_MB = 0.0
    with machine() as plant, _service_manager(monkeypatch) as manager:
        table = table_for(plant.wires, mode="router", listen=[endpoint])
        with Daemon(tmp_path, table) as daemon, Subscriber(endpoint, COMPILE_S) as seen:

            def ready() -> bool:
                nonlocal peak_MB
                pid = daemon.process.pid
                peak_MB = max(peak_MB, sum(_memory_MB(p, "Pss") for p in (pid, *children_of(pid))))
                notes.extend(_heard(manager))
                return any(note.startswith("READY=1") for note in notes)

            until(ready, COMPILE_S)
            seen.wait_until_good()
            settled_MB = _memory_MB(daemon.process.pid, "Rss")
            assert daemon.stop() < 2.0
    # said, and more time asked for while it lasted, before it was ready
    assert "compiling the estimator's kernels; this takes some four minutes" in daemon.said()
    at_READY = next(k for k, note in enumerate(notes) if note.startswith("READY=1"))
    assert "STATUS=compiling the estimator's kernels" in notes[:at_READY]
    assert "EXTEND_TIMEOUT_USEC=30000000" in notes[:at_READY]
    # the compiler's memory is within the unit's limit, and has gone with its process
    limit_MB = float(re.search(r"^MemoryMax=(\d+)M$", UNIT.read_text(encoding="utf-8"), re.MULTILINE)[1])
    print(f"first start: {peak_MB:.0f} MB at most, {settled_MB:.0f} MB then, of {limit_MB:.0f} MB")
    assert peak_MB < limit_MB
    assert settled_MB < 300.0
    # A kernel that is compiled between two ticks would hold them up. Numba writes one to its cache at once.
    first_s = daemon.step_times_s()[0]
    compiled = {path.name: path.stat().st_mtime for path in (tmp_path / "empty").rglob("*.nbi")}
    assert len(compiled) > 5
    assert not {name: written_s for name, written_s in compiled.items() if written_s > first_s}
