"""A service that is restarted, or reloads its configuration, continues from where it was."""

from __future__ import annotations

import json
import os
import signal
import time
from typing import Any

import numpy as np
import pytest
import tomlkit

from tests.bus.router import free_port
from tests.system.plant import Daemon, Subscriber, machine, service, table_for, until
from tests.system.test_recording import assert_replay_is_live

pytestmark = [pytest.mark.system, pytest.mark.timeout(240)]

WALK_W2_S = 0.1**2  # of the demo's heats
COMPENSATION = {"enabled": True, "controller_compensates": False, "position_feedback": "motor"}


def _good(seen: Subscriber) -> dict[str, Any]:
    """The next estimate that is good."""
    time_s = seen.wait_until_good()
    return next(e for e in seen.estimates if e["time_s"] == time_s)


def _moved(before: dict[str, Any], after: dict[str, Any]) -> float:
    """How far the heats have moved, in standard deviations."""
    sigma_W = np.maximum(before["heat_sigma_W"], after["heat_sigma_W"])
    return float(np.max(np.abs(after["heat_W"] - before["heat_W"]) / sigma_W))


@pytest.mark.slow
def test_a_restart_of_ten_seconds(tmp_path):
    """Heats and their uncertainty go on; the recording after it replays to the last bit."""
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    with machine() as plant:
        table = table_for(plant.wires, mode="router", listen=[endpoint]) | {"compensation": COMPENSATION}
        with Daemon(tmp_path, table) as daemon, Subscriber(endpoint) as seen:
            seen.wait_until_good()
            enough = len(seen.estimates) + 300  # by then the heats are known to some 2 W
            until(lambda: len(seen.estimates) > enough, 120.0)
            before = _good(seen)
            assert daemon.stop() < 2.0
        stopped_s = time.monotonic()
        until(lambda: time.monotonic() - stopped_s > 8.0, 60.0)  # the machine goes on meanwhile
        with Daemon(tmp_path, table) as daemon, Subscriber(endpoint) as seen:
            after = _good(seen)
            until(lambda: len(seen.estimates) > 50, 60.0)
            off = seen.documents["compensation"][0]
            assert daemon.stop() < 2.0
            live = list(seen.estimates)
    assert "warm start" in daemon.said()
    assert after["time_s"] - before["time_s"] > 8.0
    # an estimate moves by what is learnt between, P_before + Q - P_after, Q what the heats may wander
    gone_s = after["time_s"] - before["time_s"]
    learnt_W2 = before["heat_sigma_W"] ** 2 + WALK_W2_S * gone_s - after["heat_sigma_W"] ** 2
    assert ((after["heat_W"] - before["heat_W"]) ** 2 < 4.0**2 * learnt_W2).all()
    assert (after["heat_sigma_W"] < 2.0 * before["heat_sigma_W"]).all()  # a cold start knows much less
    assert not off["armed"]
    (recording,) = (path.with_suffix(".csv") for path in daemon.recordings.glob("*.start"))
    summary = assert_replay_is_live(recording, daemon.config, live, tmp_path / "replay")
    assert summary["start"].startswith(f"warm, from {recording.stem}.start")


def test_after_a_crash_the_last_checkpoint_has_to_do_and_one_of_no_use_stops_nothing(tmp_path):
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    (tmp_path / "recordings").mkdir()
    (tmp_path / "recordings" / "demo-x.checkpoint").write_bytes(b"no checkpoint at all")
    with machine() as plant:
        table = table_for(plant.wires, mode="router", listen=[endpoint]) | {"checkpoint": {"period_s": 1.0}}
        with Daemon(tmp_path, table) as daemon, Subscriber(endpoint) as seen:
            seen.wait_until_good()
            enough = len(seen.estimates) + 100
            until(lambda: len(seen.estimates) > enough, 60.0)
            daemon.process.kill()
            daemon.process.wait(10)
            before = seen.estimates[-1]
            (line,) = [json.loads(line) for line in daemon.said().splitlines() if '"cold start"' in line]
            assert "not a checkpoint of this program" in line["reason"]
        with Daemon(tmp_path, table) as daemon, Subscriber(endpoint) as seen:
            after = _good(seen)
            assert daemon.stop() < 2.0
    assert "warm start" in daemon.said()
    # the checkpoint is up to a second older than the crash, and a cold start knows 100 W
    assert (after["heat_sigma_W"] < 1.5 * before["heat_sigma_W"]).all()


def test_a_changed_configuration_is_reloaded(tmp_path):
    with service(tmp_path, compensation=COMPENSATION) as (_, daemon, seen):
        seen.wait_until_good()
        enough = len(seen.estimates) + 100
        until(lambda: len(seen.estimates) > enough, 60.0)
        good = tomlkit.parse(daemon.config.read_text(encoding="utf-8"))

        def reload() -> None:
            daemon.config.write_text(tomlkit.dumps(good), encoding="utf-8")
            os.kill(daemon.process.pid, signal.SIGHUP)

        before = len(seen.estimates)

        # what lies beside the model is changed: the estimates go on
        good["publish"]["field_rate_Hz"] = 1.0
        reload()
        begun = until(lambda: _begun_anew(seen, before), 60.0)
        until(lambda: len(seen.estimates) > begun + 20, 60.0)
        assert _moved(seen.estimates[begun - 1], seen.estimates[begun]) < 1.5
        assert not any("configuration was rejected" in r for r in seen.health()["reasons"])
        assert not seen.documents["compensation"][-1]["armed"]

        # another model of the screw: field and heats are carried over
        again = len(seen.estimates)
        good["screw"]["conductivity_W_mK"] = 40.0
        reload()
        begun = until(lambda: _begun_anew(seen, again), 60.0)
        until(lambda: len(seen.estimates) > begun + 5, 60.0)
        assert _moved(seen.estimates[begun - 1], seen.estimates[begun]) < 1.5

        # one that has nothing in common with it: a cold start, which is said
        again = len(seen.estimates)
        good["output"] = {"positions_m": [0.0, 0.5, 1.0]}
        reload()
        begun = until(lambda: _begun_anew(seen, again), 60.0)
        until(lambda: len(seen.estimates) > begun + 5, 60.0)
        assert daemon.stop() < 2.0
    said = [json.loads(line) for line in daemon.said().splitlines()]
    assert any(line["event"] == "cold start" and "another configuration" in line["reason"] for line in said)
    assert len(list(daemon.recordings.glob("*.csv"))) == 4
    assert len(list(daemon.recordings.glob("*.start"))) == 2


def _begun_anew(seen: Subscriber, since: int) -> int | None:
    """The first estimate of parts that were built anew."""
    numbers = [e["sequence"] for e in list(seen.estimates)]
    return next((k for k in range(since, len(numbers)) if numbers[k] < numbers[k - 1]), None)
