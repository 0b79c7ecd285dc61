"""`observer demo --sensors housings`: no thermocouple on the screw, estimates beside the truth."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest

from tests.patience import PATIENCE_S
from tests.publish.router import free_port
from tests.system.plant import ROOT, Subscriber, until

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
