"""SIGTERM ends the real daemon within two seconds, whatever it is at, with its recording complete."""

from __future__ import annotations

import os
import signal

import pytest

from observer.files.logs import read_log
from tests.bus.router import free_port
from tests.patience import Stopwatch, computed_s
from tests.system.plant import Daemon, Subscriber, machine, table_for, until

pytestmark = pytest.mark.system

LIMIT_S = 2.0


def _started(daemon: Daemon) -> bool:
    return any(daemon.recordings.glob("*.csv"))


@pytest.fixture(scope="module")
def plant():
    with machine() as running:
        yield running


def _nobody_there() -> dict:
    return {"mode": "client", "connect": [f"tcp/127.0.0.1:{free_port()}"]}


@pytest.mark.parametrize("after_s", [0.05, 0.5, 1.0])
def test_while_it_is_being_loaded(plant, tmp_path, after_s):
    """Before it listens to signals there is nothing to save, and the system ends it."""
    with Daemon(tmp_path, table_for(plant.wires, **_nobody_there())) as daemon:
        until(lambda: computed_s(daemon.process.pid) >= after_s)
        watch = Stopwatch(daemon.process.pid)
        daemon.process.terminate()
        assert watch.until(lambda: daemon.process.poll() is not None) < LIMIT_S
        assert daemon.process.returncode in {0, -signal.SIGTERM}
        assert "Traceback" not in daemon.said()


def test_without_a_router(plant, tmp_path):
    with Daemon(tmp_path, table_for(plant.wires, **_nobody_there())) as daemon:
        until(lambda: _started(daemon) and daemon.recording().read_bytes().count(b"\n") > 10)
        assert daemon.stop() < LIMIT_S
    assert len(read_log(daemon.recording())) > 10


def test_while_its_devices_hang(plant, tmp_path):
    """The whole machine stands still: its Modbus server accepts and does not answer, its bus is silent."""
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    table = table_for(plant.wires, mode="router", listen=[endpoint])
    with Daemon(tmp_path, table) as daemon, Subscriber(endpoint) as seen:
        seen.wait_until_good()
        until(seen.health)
        os.kill(plant.pid, signal.SIGSTOP)
        try:
            watch = Stopwatch(daemon.process.pid)
            assert watch.until(lambda: seen.health()["channels"]["t1_degC"]["fault"] == "timeout") < 10.0
            flagged = len(seen.estimates)
            seen.wait_for_more(10)  # it goes on
            assert "good" not in {e["quality"] for e in seen.estimates[flagged:]}
            assert daemon.stop() < LIMIT_S
        finally:
            os.kill(plant.pid, signal.SIGCONT)
    daemon.assert_no_tick_is_missing()
    read_log(daemon.recording())  # refuses a cut last row
