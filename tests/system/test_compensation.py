"""The compensation of a real service: armed by the command, off at the first fault, off until armed again."""

from __future__ import annotations

import json
import subprocess
import sys

import pytest

from tests.patience import PATIENCE_S, Stopwatch
from tests.publish.router import free_port
from tests.system.plant import COMPENSATION, ROOT, Daemon, Subscriber, machine, table_for, until

pytestmark = pytest.mark.system


def _arm(endpoint: str, *names: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "observer", "arm", "--connect", endpoint, *names]
    return subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=PATIENCE_S)


def test_a_fault_switches_a_compensation_off_until_somebody_arms_it_again(tmp_path):
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    demo = ("--machine", "demo", "--axis", "x")
    with machine() as plant:
        table = table_for(plant.wires, mode="router", listen=[endpoint])
        table["compensation"] = COMPENSATION
        with Daemon(tmp_path, table) as daemon, Subscriber(endpoint) as heard:
            heard.wait_until_good()

            def newest():
                return (heard.documents.get("compensation") or [{}])[-1]

            until(lambda: newest().get("armed") is False)
            assert newest()["reason"] == "not armed yet"
            assert newest()["error_um"] is None
            done = _arm(endpoint, *demo)
            assert done.returncode == 0, done.stdout + done.stderr
            assert json.loads(done.stdout)["done"] is True
            assert json.loads(done.stdout)["instance"] == newest()["instance"]
            until(lambda: newest()["armed"] and newest()["error_um"])

            watch = Stopwatch(plant.pid, daemon.process.pid)
            plant.fault(open=["t1_degC"])
            assert watch.until(lambda: not newest()["armed"]) < 5.0
            assert "arm again" in newest()["reason"]
            assert newest()["offset_um"] is None
            refused = _arm(endpoint, *demo)
            assert refused.returncode == 1
            assert json.loads(refused.stdout)["done"] is False
            assert "cannot be armed" in json.loads(refused.stdout)["text"]

            plant.fault()
            heard.wait_until_good()
            seen = len(heard.documents["compensation"])
            until(lambda: len(heard.documents["compensation"]) > seen + 5)
            assert not any(d["armed"] for d in heard.documents["compensation"][seen:])
            assert _arm(endpoint, *demo).returncode == 0
            daemon.stop()
