"""No thermocouple on the screw: `observer demo --sensors housings`, and a file that `init` writes."""

from __future__ import annotations

import os
import subprocess
import sys
import tomllib

import pytest

from observer.installation.first_configuration import write_new
from tests.bus.router import free_port
from tests.patience import PATIENCE_S
from tests.system.plant import ROOT, Daemon, Subscriber, machine, until

pytestmark = pytest.mark.system

MOST_SIGMA = 5.0
"""Seats are a tenth or two off, and a fresh start knows little: σ holds this, or the machine is another."""


def test_heats_from_housings_stand_beside_the_truth(tmp_path):
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    command = ["demo", "--sensors", "housings", "--plain", "--no-page", "--seconds", "12"]
    with (tmp_path / "out").open("wb") as out, (tmp_path / "err").open("wb") as err:
        process = subprocess.Popen(
            [sys.executable, "-m", "observer", *command, "--listen", endpoint],
            cwd=ROOT, stdout=out, stderr=err, env={**os.environ, "TMPDIR": str(tmp_path)},
        )  # fmt: skip
    try:
        with Subscriber(endpoint) as seen:
            until(lambda: len(seen.documents.get("heat", ())) >= 12 and "truth/heat" in seen.documents)
            code = process.wait(PATIENCE_S)
    finally:
        process.kill()
        process.wait(PATIENCE_S)
    assert code == 0, (tmp_path / "err").read_text()
    heat = seen.documents["heat"][-1]
    truth = min(seen.documents["truth/heat"], key=lambda t: abs(t["time_s"] - heat["time_s"]))
    assert heat["sources"].keys() == truth["sources"].keys() == {"nut", "left_bearing", "right_bearing"}
    for name, entry in heat["sources"].items():
        off_W = abs(entry["heat_W"] - truth["sources"][name]["heat_W"])
        assert off_W < MOST_SIGMA * entry["sigma_W"], (name, entry)
    assert "truth" in (tmp_path / "out").read_text()


def test_a_first_configuration_runs_on_such_a_machine(tmp_path):
    """Without a look at the file: every reading is good, and each heat has its σ."""
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    with machine(1.0, "--housings") as running:
        given = {
            "machine": "demo", "length_m": "1.0 m", "stroke_m": "150 800 mm", "housings": "nut, left, right",
            "module_at": f"127.0.0.1:{running.wires['modbus_port']}", "ambient": "22 °C", "control": "can",
            "control_at": running.wires["can_device"], "dbc": str(ROOT / "drivers/simulated/axis.dbc"),
            "position_signal": "AxisStatus.NutPosition", "speed_signal": "AxisStatus.ScrewSpeed",
        }  # fmt: skip
        write_new(tmp_path / "first.toml", given, None)
        table = tomllib.loads((tmp_path / "first.toml").read_text(encoding="utf-8"))
        table.pop("page", None)
        table["publish"] = {"mode": "router", "listen": [endpoint]}
        with Daemon(tmp_path, table) as daemon, Subscriber(endpoint) as seen:
            until(lambda: len(seen.estimates) >= 20)
            daemon.stop()
    last = seen.estimates[-1]
    assert last["sensors"] == ["nut_body", "left_housing", "right_housing"]
    assert list(last["sensor_quality"]) == ["good"] * 3
    heats = seen.documents["heat"][-1]["sources"]
    assert set(heats) == {"nut", "left_bearing", "right_bearing"}
    assert all(one["sigma_W"] > 0.0 for one in heats.values())
