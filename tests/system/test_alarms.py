"""Alarms of a running daemon: raised by a fault, published, acknowledged, and gone or kept."""

from __future__ import annotations

import pytest

from tests.bus.router import free_port
from tests.system.plant import Daemon, Subscriber, ask, machine, service, table_for, until

pytestmark = pytest.mark.system
PLUG = "sensor_fault.t3.open_circuit"


def _alarms(seen: Subscriber) -> dict[str, dict]:
    documents = seen.documents.get("alarms", [])
    return {alarm["id"]: alarm for alarm in documents[-1]["alarms"]} if documents else {}


def test_an_open_thermocouple_raises_an_alarm_that_is_acknowledged_and_goes(tmp_path):
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    with machine() as plant:
        table = table_for(plant.wires, mode="router", listen=[endpoint])
        table["checkpoint"] = {"directory": str(tmp_path / "kept")}
        with Daemon(tmp_path, table) as daemon, Subscriber(endpoint) as seen:
            seen.wait_until_good()
            plant.fault(open="t3_degC")
            until(lambda: PLUG in _alarms(seen))
            alarm = _alarms(seen)[PLUG]
            assert (alarm["severity"], alarm["state"], alarm["target"]) == ("major", "unacknowledged", "t3")
            assert "open_circuit" in alarm["reason"]
            assert "plug" in alarm["remedy"]
            assert ask("acknowledge", endpoint, "sensor_fault.t9").returncode == 1
            assert ask("acknowledge", endpoint, PLUG).returncode == 0
            until(lambda: _alarms(seen)[PLUG]["state"] == "acknowledged")
            assert "alarm" in daemon.said()
        with Daemon(tmp_path, table), Subscriber(endpoint) as seen:  # what was seen stays seen
            until(lambda: PLUG in _alarms(seen))
            assert _alarms(seen)[PLUG]["state"] == "acknowledged"
            plant.fault()
            until(lambda: seen.documents.get("alarms") and PLUG not in _alarms(seen))


def test_kept_alarms_that_nest_without_end_are_set_aside_in_words(tmp_path):
    file = tmp_path / "kept" / "demo-x.alarms.json"
    file.parent.mkdir()
    file.write_text("[" * 100_000, encoding="utf-8")
    with service(tmp_path, checkpoint={"directory": str(file.parent)}) as (_, daemon, seen):
        until(lambda: daemon.process.poll() is not None or seen.documents.get("alarms"))
        assert daemon.process.poll() is None, daemon.said()[-500:]
        assert "alarms and usual heats: no state restored" in daemon.said()
        assert "Traceback" not in daemon.said()
