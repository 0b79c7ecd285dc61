"""SIGHUP executes the service anew: the same process number, warm, with nothing lost and nobody orphaned."""

from __future__ import annotations

import os
import signal
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.bus.router import free_port
from tests.patience import until
from tests.system.plant import START_S, Daemon, Subscriber, children_of, machine, service, table_for
from tests.system.test_start import heard, service_manager

pytestmark = [pytest.mark.system, pytest.mark.timeout(300)]


def _reload(daemon: Daemon, seen: Subscriber, signals: int = 1) -> int:
    """Ask for a reload, and wait for the next instance; returns the number of its first estimate."""
    before = seen.estimates[-1]["instance"]
    for _ in range(signals):
        os.kill(daemon.process.pid, signal.SIGHUP)

    def first() -> int | None:
        instances = [e["instance"] for e in list(seen.estimates)]
        others = [k for k, name in enumerate(instances) if name != before and before in instances[:k]]
        return others[0] if others else None

    found: int = until(first, START_S)
    until(lambda: len(seen.estimates) > found + 10, START_S)
    return found


def _outlets(pid: int) -> int | None:
    """The process of page and plant, which a service starts beside itself."""
    for child in children_of(pid):
        try:
            if b"observer.outlets" in Path(f"/proc/{child}/cmdline").read_bytes():
                return child
        except OSError:
            continue
    return None


def _open_files(pid: int) -> int:
    return len(list(Path(f"/proc/{pid}/fd").iterdir()))


def _assert_warm(before: dict[str, Any], after: dict[str, Any]) -> None:
    """The heats and their σ go on: a cold start knows them to 15 W."""
    assert (np.abs(after["heat_W"] - before["heat_W"]) < 1.5 * before["heat_sigma_W"]).all()
    assert (after["heat_sigma_W"] < 1.5 * before["heat_sigma_W"]).all()


def test_a_reload_keeps_process_estimates_and_recording_and_ends_the_children(tmp_path, monkeypatch):
    endpoint, metrics = f"tcp/127.0.0.1:{free_port()}", f"127.0.0.1:{free_port()}"
    with machine() as plant, service_manager(monkeypatch) as manager:
        table = table_for(plant.wires, mode="router", listen=[endpoint]) | {"metrics": {"listen": metrics}}
        with Daemon(tmp_path, table) as daemon, Subscriber(endpoint) as seen:
            pid = daemon.process.pid
            command = Path(f"/proc/{pid}/cmdline").read_bytes()
            seen.wait_until_good()
            enough = len(seen.estimates) + 200
            until(lambda: len(seen.estimates) > enough, START_S)
            old_outlets = until(lambda: _outlets(pid), START_S)
            assert seen.health()["restart"] is None
            heard(manager)

            os.kill(old_outlets, signal.SIGSTOP)  # it cannot end by itself
            begun = _reload(daemon, seen)
            assert daemon.process.poll() is None
            assert Path(f"/proc/{pid}/cmdline").read_bytes() == command
            _assert_warm(seen.estimates[begun - 1], seen.estimates[begun])
            new_outlets = until(lambda: _outlets(pid), START_S)
            assert new_outlets != old_outlets
            assert not Path(f"/proc/{old_outlets}").exists()
            until(lambda: children_of(pid) == [new_outlets])  # steps of the time before are packed meanwhile

            notes = heard(manager)
            reloading = next(k for k, note in enumerate(notes) if note.startswith("RELOADING=1"))
            assert "MONOTONIC_USEC=" in notes[reloading]
            assert notes[reloading + 1].startswith("READY=1")
            assert sum("READY=1" in note for note in notes) == 1

            # clients learn the reason before the gap and after it
            until(lambda: seen.health()["instance"] == seen.estimates[-1]["instance"], START_S)
            for instance in (seen.estimates[begun - 1]["instance"], seen.estimates[begun]["instance"]):
                reports = [h for h in seen.documents["health"] if h["instance"] == instance]
                assert reports[-1]["restart"]["reason"] == "the configuration was read again"

            # signals that come while it restarts end nothing, and it keeps no files open
            open_files = _open_files(pid)
            _reload(daemon, seen, signals=5)
            _reload(daemon, seen, signals=2)
            assert _open_files(pid) <= open_files + 5
            assert daemon.process.poll() is None
            published_s = {e["time_s"] for e in seen.estimates}
            assert daemon.stop() < 2.0
    assert daemon.said().count("warm start") >= 3
    assert published_s <= set(daemon.ticks_s())


def test_a_wrong_configuration_changes_nothing_and_a_repaired_one_is_taken(tmp_path):
    with service(tmp_path) as (_, daemon, seen):
        seen.wait_until_good()
        text = daemon.config.read_text(encoding="utf-8")
        instance = seen.estimates[-1]["instance"]
        for wrong, words in (
            ("[screw", "not valid TOML"),
            ("x = 1\n" + text, "unknown key"),
            (text.replace("[estimator]", "[estimator]\ngate_sigma = -1.0"), "estimator.gate_sigma"),
        ):
            daemon.config.write_text(wrong, encoding="utf-8")
            os.kill(daemon.process.pid, signal.SIGHUP)
            until(lambda words=words: any(words in r for r in seen.health()["reasons"]), START_S)
        assert seen.estimates[-1]["instance"] == instance
        daemon.config.write_text(text, encoding="utf-8")
        begun = _reload(daemon, seen)
        _assert_warm(seen.estimates[begun - 1], seen.estimates[begun])
        until(lambda: not any("rejected" in r for r in seen.health()["reasons"]), START_S)

        # one that is spoilt while the process restarts neither ends the service nor goes unnoticed
        before = seen.health()["restart"]
        os.kill(daemon.process.pid, signal.SIGHUP)
        until(lambda: seen.health()["restart"] != before, START_S)
        daemon.config.write_text("[screw", encoding="utf-8")
        os.kill(daemon.process.pid, signal.SIGHUP)
        instance = seen.estimates[-1]["instance"]
        until(lambda: seen.estimates[-1]["instance"] != instance, START_S)
        until(lambda: any("not valid TOML" in r for r in seen.health()["reasons"]), START_S)
        assert daemon.process.poll() is None
        assert daemon.stop() < 2.0
