"""`observer check --wires`: what the devices of a running machine deliver, and what they do not."""

from __future__ import annotations

import json
import socket
from pathlib import Path
from typing import Any

import pytest

from tests.system.plant import machine, run_observer, table_for, write

pytestmark = [pytest.mark.system, pytest.mark.timeout(120)]


def look(folder: Path, table: dict[str, Any], *more: str) -> tuple[int, str]:
    """Exit code and output of the command."""
    done = run_observer("check", "--wires", "--config", str(write(folder, table)), *more)
    assert "Traceback" not in done.stderr
    return done.returncode, done.stdout + done.stderr


def documents(folder: Path, table: dict[str, Any]) -> tuple[int, dict[str, Any]]:
    """Exit code, and every channel with the name of its driver gone."""
    code, printed = look(folder, table, "--json")
    found = json.loads(printed)
    channels = {name: one for d in found["drivers"].values() for name, one in d["channels"].items()}
    assert found["good"] == (code == 0) == all(one["usable"] for one in channels.values())
    return code, channels


@pytest.fixture(scope="module")
def plant():
    with machine() as running:
        yield running


@pytest.fixture
def restored(plant):
    yield plant
    plant.fault()


def test_every_channel_of_a_healthy_machine_comes(plant, tmp_path):
    code, printed = look(tmp_path, table_for(plant.wires))
    assert code == 0, printed
    lines = {line.split()[0]: line for line in printed.splitlines() if line.strip()}
    for name, unit in (("t1_degC", "°C"), ("nut_position_m", "m"), ("screw_speed_rpm", "rpm")):
        assert f" {unit} " in lines[name]
    assert "connected" in lines["thermocouples"]
    assert "10 Hz wanted" in lines["thermocouples"]


def test_an_open_thermocouple_is_reported(restored, tmp_path):
    restored.fault(open="t3_degC")
    code, channels = documents(tmp_path, table_for(restored.wires))
    assert code == 1
    assert channels["t3_degC"]["fault"] == "open_circuit"
    assert [name for name, one in channels.items() if not one["usable"]] == ["t3_degC"]
    assert "terminals of this input" in channels["t3_degC"]["remedy"]
    assert channels["t1_degC"]["remedy"] is None


def test_a_silent_bus_is_reported(restored, tmp_path):
    restored.fault(silence_can=True)
    code, channels = documents(tmp_path, table_for(restored.wires))
    assert code == 1
    assert {channels[c]["fault"] for c in ("nut_position_m", "screw_speed_rpm")} == {"silent"}
    assert channels["t1_degC"]["usable"]


def test_a_missing_device_is_reported(plant, tmp_path):
    with socket.create_server(("127.0.0.1", 0)) as gone:
        port = gone.getsockname()[1]
    table = table_for(plant.wires)
    table["drivers"]["thermocouples"]["port"] = port
    code, printed = look(tmp_path, table)
    assert code == 1
    assert "not connected" in printed
    assert "disconnected" in printed
    assert "usable" in printed
    assert f"t1_degC, t2_degC, t3_degC, t4_degC, t5_degC: nothing listens at 127.0.0.1:{port}" in " ".join(
        printed.split()
    )
    assert "Errno" not in printed


def test_a_position_in_mm_is_reported(plant, tmp_path):
    table = table_for(plant.wires)
    table["drivers"]["axis"]["channels"]["nut_position_m"]["scale"] = 1000.0
    code, channels = documents(tmp_path, table)
    assert code == 1
    assert "looks like mm" in channels["nut_position_m"]["implausible"]
    assert "scale" in channels["nut_position_m"]["remedy"]


def test_unusable_input_is_rejected_before_anything_is_opened(plant, tmp_path):
    table = table_for(plant.wires)
    table["drivers"]["axis"]["channels"]["nut_position_m"]["signal"] = "NutPlace"
    code, printed = look(tmp_path, table)
    assert code == 2
    assert 'no signal "NutPlace"' in printed


def test_without_drivers_nothing_can_come(tmp_path):
    table = table_for({"modbus_port": 1, "can_device": "none"})
    del table["drivers"]
    code, printed = look(tmp_path, table)
    assert code == 1
    assert "no drivers" in printed
