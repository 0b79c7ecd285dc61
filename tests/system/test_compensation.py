"""The compensation of a real service: armed by a command, held through short faults, then released."""

from __future__ import annotations

import json
import re

import httpx
import numpy as np
import pytest

from tests.bus.router import free_port
from tests.patience import PATIENCE_S, Stopwatch
from tests.system.plant import (
    COMPENSATION,
    Daemon,
    Subscriber,
    ask,
    machine,
    run_observer,
    service,
    table_for,
    until,
)

pytestmark = pytest.mark.system


def test_a_fault_switches_a_compensation_off_until_somebody_arms_it_again(tmp_path):
    with service(tmp_path, compensation=COMPENSATION) as (plant, daemon, heard):
        heard.wait_until_good()

        def newest():
            return (heard.documents.get("compensation") or [{}])[-1]

        until(lambda: newest().get("armed") is False)
        assert newest()["reason"] == "not armed yet"
        assert newest()["error_um"] is None
        done = ask("arm", heard.endpoint)
        assert done.returncode == 0, done.stdout + done.stderr
        assert json.loads(done.stdout)["done"] is True
        assert json.loads(done.stdout)["instance"] == newest()["instance"]
        until(lambda: newest()["armed"] and newest()["error_um"])

        watch = Stopwatch(plant.pid, daemon.process.pid)
        plant.fault(open=["t1_degC"])
        assert watch.until(lambda: not newest()["armed"]) < 5.0
        assert "arm again" in newest()["reason"]
        until(lambda: newest()["offset_um"] is None)  # at its rate
        refused = ask("arm", heard.endpoint)
        assert refused.returncode == 1
        assert json.loads(refused.stdout)["done"] is False
        assert "cannot be armed" in json.loads(refused.stdout)["text"]

        plant.fault()
        heard.wait_until_good()
        seen = len(heard.documents["compensation"])
        until(lambda: len(heard.documents["compensation"]) > seen + 5)
        assert not any(d["armed"] for d in heard.documents["compensation"][seen:])
        # on a busy computer a position may be late just now: then the refusal is right
        until(lambda: ask("arm", heard.endpoint).returncode == 0)
        daemon.stop()


def _outlets(endpoint: str, metrics: int, heard: Subscriber) -> dict[str, str]:
    """What people and programs see of the alarms: the health command, metrics, and the alarms' message."""
    health = run_observer("health", "--connect", endpoint)
    page = httpx.get(f"http://127.0.0.1:{metrics}/metrics", timeout=PATIENCE_S).text
    alarms = heard.documents["alarms"][-1]["alarms"]
    return {"health": health.stdout, "metrics": page, "alarms": json.dumps(alarms)}


def test_a_late_position_is_held_and_a_lost_one_is_an_alarm_at_every_outlet(tmp_path):
    endpoint, metrics = f"tcp/127.0.0.1:{free_port()}", free_port()
    with machine() as plant:
        table = table_for(plant.wires, mode="router", listen=[endpoint])
        table["compensation"] = COMPENSATION | {"hold_s": 5.0, "rate_limit_um_s": 5.0}
        table["metrics"] = {"listen": f"127.0.0.1:{metrics}"}
        with Daemon(tmp_path, table) as daemon, Subscriber(endpoint) as heard:
            heard.wait_until_good()
            done = run_observer("arm", "--connect", endpoint)  # one service answers: no names are needed
            assert done.returncode == 0, done.stdout + done.stderr
            until(lambda: heard.documents["compensation"][-1]["armed"])

            def phases(since: int) -> list[str]:
                return [document["phase"] for document in heard.documents["compensation"][since:]]

            count = len(heard.documents["compensation"])
            plant.fault(hold_can_s=1.0)  # ten periods
            until(lambda: "holding" in phases(count))
            until(lambda: phases(count)[-1] == "following")
            assert set(phases(count)) == {"following", "holding"}
            assert heard.documents["alarms"][-1]["alarms"] == []

            plant.fault(silence_can=True)
            until(lambda: phases(count)[-1] in ("releasing", "off"))
            reason = heard.documents["compensation"][-1]["reason"]
            assert re.fullmatch(
                r"switched off at \d\d:\d\d:\d\d: no position from the control for \d+\.\d s; arm again",
                reason,
            )
            until(lambda: any(reason in alarm["reason"] for alarm in heard.documents["alarms"][-1]["alarms"]))
            until(lambda: phases(count)[-1] == "off")
            tables = [d["error_um"] for d in heard.documents["compensation"][count:] if d["error_um"]]
            steps_um = np.abs(np.diff(tables, axis=0)).max()
            assert steps_um <= 5.0 * 0.1 * (1 + 1e-6) + 2e-6  # the rate times a period

            shown = _outlets(endpoint, metrics, heard)
            assert "observer arm" in shown["alarms"]
            assert "no position from the control" in " ".join(shown["health"].split())
            assert re.search(
                r'alarms\{[^}]*severity="major",state="unacknowledged"\} [1-9]', shown["metrics"]
            )
            assert "compensation released" in daemon.said()
            daemon.stop()
        plant.fault()
        with Daemon(tmp_path, table) as daemon, Subscriber(endpoint) as heard:
            heard.wait_until_good()
            [checkpoint] = tmp_path.rglob("*.checkpoint")
            written_ns = checkpoint.stat().st_mtime_ns
            assert ask("arm", endpoint).returncode == 0
            until(lambda: checkpoint.stat().st_mtime_ns > written_ns)  # it is written after the next step
            daemon.process.kill()
            daemon.process.wait(PATIENCE_S)
        with Daemon(tmp_path, table) as daemon, Subscriber(endpoint) as heard:
            until(lambda: "the service ended or began anew" in str(heard.documents.get("alarms", "")))
            heard.wait_until_good()
            assert ask("arm", endpoint).returncode == 0
            daemon.stop()
            until(lambda: ": the service ended; arm again" in str(heard.documents["alarms"][-1]))
            assert not heard.documents["compensation"][-1]["armed"]
