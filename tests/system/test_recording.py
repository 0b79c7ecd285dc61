"""What a live run published is, to the last bit, what the replay of its recording gives."""

from __future__ import annotations

import csv
import json
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.system.plant import run_observer, service

pytestmark = pytest.mark.system


def _replay(recording: Path, config: Path, output: Path) -> Path:
    done = _run_replay(recording, config, output)
    assert done.returncode == 0, done.stderr
    return output


def _run_replay(
    recording: Path, config: Path, output: Path, *options: str
) -> subprocess.CompletedProcess[str]:
    command = ["replay", str(recording), "--config", str(config), "--output", str(output), *options]
    return run_observer(*command)


def _rows(output: Path) -> dict[float, dict[str, str]]:
    with (output / "estimates.csv").open(encoding="utf-8", newline="") as file:
        return {float(row["time_s"]): row for row in csv.DictReader(file)}


def _columns(message: dict[str, Any]) -> dict[str, np.float32]:
    """Every number of a published estimate by the name of its column in `estimates.csv`."""
    columns = {}
    for j, name in enumerate(message["sources"]):
        columns[f"heat_{name}_W"] = message["heat_W"][j]
        columns[f"heat_{name}_sigma_W"] = message["heat_sigma_W"][j]
        columns[f"heat_{name}_bound_W"] = message["heat_bound_W"][j]
    for j, x_m in enumerate(message["position_m"]):
        mm = f"{1000 * round(float(x_m), 6):.10g}"  # the message has the position as float32
        columns[f"field_{mm}_degC"] = message["field_degC"][j]
        columns[f"field_{mm}_sigma_K"] = message["field_sigma_K"][j]
        columns[f"field_{mm}_bound_K"] = message["field_bound_K"][j]
        columns[f"error_{mm}_um"] = message["error_um"][j]
        columns[f"error_{mm}_sigma_um"] = message["error_sigma_um"][j]
        columns[f"error_{mm}_bound_um"] = message["error_bound_um"][j]
    for j, name in enumerate(message["sensors"]):
        unit = "um" if name in message.get("displacements", ()) else "K"
        columns[f"innovation_{name}_{unit}"] = message["innovation_K"][j]
    return columns


def _assert_same(message: dict[str, Any], row: dict[str, str]) -> None:
    columns = _columns(message)
    qualities = dict(
        zip((f"quality_{n}" for n in message["sensors"]), message["sensor_quality"], strict=True)
    )
    for name in ("quality", "heat_quality", "field_quality", "error_quality"):
        qualities[name] = message[name]
    qualities["sensors"] = str(len(message["sensors"]))
    qualities["sensors_used"] = str(message["sensors_used"])
    given = {name for name in row if not name.startswith("learned_")}  # which has a message of its own
    assert given == {"time_s"} | columns.keys() | qualities.keys()
    for name, value in columns.items():
        replayed = np.float32(row[name] or "nan")
        assert replayed.tobytes() == np.float32(value).tobytes() or np.isnan([replayed, value]).all(), name
    assert {name: row[name] for name in qualities} == qualities


def assert_replay_is_live(
    recording: Path, config: Path, live: list[dict[str, Any]], output: Path
) -> dict[str, Any]:
    """Every published estimate is in the replay, to the last bit; returns the replay's summary."""
    replayed = _rows(_replay(recording, config, output))
    for message in live:
        _assert_same(message, replayed[message["time_s"]])
    summary: dict[str, Any] = json.loads((output / "summary.json").read_text(encoding="utf-8"))
    return summary


def test_the_replay_of_a_modbus_and_can_recording_is_the_live_run(tmp_path):
    with service(tmp_path) as (plant, daemon, seen):
        seen.wait_until_good()
        seen.wait_for_more(30)
        plant.fault(open="t3_degC")
        seen.wait_for_more(15)
        plant.fault(silence_can=True)
        seen.wait_for_more(10)
        plant.fault()
        seen.wait_until_good()
        seen.wait_for_more(30)
        assert daemon.stop() < 2.0
        live = list(seen.estimates)
    daemon.assert_no_tick_is_missing()
    # every fault was in it, and more than 8 s of estimates
    assert {q for e in live for q in e["sensor_quality"]} >= {"good", "rejected"}
    assert {"good", "degraded"} <= {e["quality"] for e in live}
    assert len(live) > 70
    summary = assert_replay_is_live(daemon.recording(), daemon.config, live, tmp_path / "one")
    assert summary["start"] == "cold"
    _replay(daemon.recording(), daemon.config, tmp_path / "two")
    for name in ("estimates.csv", "summary.json", "overview.png"):
        assert (tmp_path / "one" / name).read_bytes() == (tmp_path / "two" / name).read_bytes(), name
    _flip_a_digit(daemon.recording())
    refused = _run_replay(daemon.recording(), daemon.config, tmp_path / "three")
    assert refused.returncode == 2
    assert "do not have the checksum they were recorded with" in refused.stderr
    assert "Traceback" not in refused.stderr
    assert not (tmp_path / "three").exists()
    accepted = _run_replay(daemon.recording(), daemon.config, tmp_path / "three", "--accept-damaged")
    assert accepted.returncode == 0, accepted.stderr
    left_out = len(_rows(tmp_path / "one")) - len(_rows(tmp_path / "three"))
    assert 0 <= left_out <= 30  # some 0.2 s, or what a busy computer wrote at once


def _flip_a_digit(recording: Path) -> None:
    data = bytearray(recording.read_bytes())
    place = next(k for k in range(len(data) // 2, len(data)) if data[k : k + 1] == b"7")
    data[place : place + 1] = b"8"
    recording.write_bytes(data)
