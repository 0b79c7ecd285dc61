"""A computer's clock that is set while the service runs, or wrong when it starts: times are soon right."""

from __future__ import annotations

import json
import time
from pathlib import Path

import pytest

from observer.files.logs import read_log
from tests.system.plant import COMPENSATION, Subscriber, ask, service, until

pytestmark = [pytest.mark.system, pytest.mark.slow, pytest.mark.timeout(180)]

LAUNCHER = ("-m", "tests.system.clock_steps")
HOUR_S = 3600.0
PLUG = "sensor_fault.t3.open_circuit"


def _set_clock(folder: Path, ahead_s: float) -> None:
    """Set the daemon's clock at once, as a rename replaces a file."""
    part = folder / "step.part"
    part.write_text(repr(ahead_s))
    part.replace(folder / "step")


@pytest.mark.parametrize("step_s", [HOUR_S, -HOUR_S])
def test_a_clock_that_is_set(tmp_path, step_s):
    """Estimates go on with the new time and from where they stood; the compensation is off at once."""
    with service(tmp_path, LAUNCHER, compensation=COMPENSATION) as (_, daemon, seen):
        seen.wait_until_good()
        until(lambda: ask("arm", seen.endpoint).returncode == 0, 30.0)
        until(lambda: seen.documents["compensation"][-1]["armed"], 30.0)
        _set_clock(tmp_path, step_s)
        set_s = time.time()
        until(lambda: any("clock" in r for r in seen.health()["reasons"]), 30.0)
        seen_at = len(seen.documents["compensation"])
        until(lambda: abs(seen.estimates[-1]["time_s"] - time.time() - step_s) < HOUR_S / 2, 60.0)
        before = [e for e in seen.estimates if abs(e["time_s"] - set_s) < HOUR_S / 2]
        new = len(seen.estimates)
        until(lambda: len(seen.estimates) > new + 20, 30.0)
        until(lambda: seen.health()["clock_offset_s"] == pytest.approx(0.0, abs=0.5), 30.0)
        documents = list(seen.documents["compensation"])
        assert daemon.stop() < 2.0
    after = [e for e in seen.estimates if abs(e["time_s"] - set_s - step_s) < HOUR_S / 2]
    assert len(before) + len(after) == len(seen.estimates)
    # from when the step is seen until somebody arms again, no document is armed, whichever clock it carries
    assert documents[seen_at:]
    assert not any(d["armed"] for d in documents[seen_at:])
    assert any("clock was set" in str(d["reason"]) for d in documents[seen_at:])
    assert all(d["valid_until_s"] < set_s + 5.0 for d in documents if d["armed"])
    # nothing is lost by it: the heats go on from where they stood
    for was, now, sigma in zip(
        before[-1]["heat_W"], after[0]["heat_W"], after[0]["heat_sigma_W"], strict=True
    ):
        assert abs(now - was) < 3.0 * sigma
    # each file has times that only go on
    files = sorted(
        (read_log(path) for path in daemon.recordings.glob("*.csv")), key=lambda log: log.time_s[0]
    )
    assert len(files) == 2
    assert abs(files[1].time_s[0] - files[0].time_s[0]) == pytest.approx(HOUR_S, abs=120.0)


@pytest.mark.parametrize("step_s", [HOUR_S, -HOUR_S])
def test_a_step_of_the_clock_announces_no_standing_alarm_again(tmp_path, step_s):
    """An open thermocouple is reported and acknowledged before; no folder keeps its alarm."""
    with service(tmp_path, LAUNCHER) as (plant, daemon, seen):
        seen.wait_until_good()
        plant.fault(open="t3_degC")
        until(lambda: PLUG in _alarms(seen), 60.0)
        until(lambda: ask("acknowledge", seen.endpoint).returncode == 0, 30.0)
        until(lambda: _alarms(seen)[PLUG]["state"] == "acknowledged", 30.0)
        first = seen.documents["alarms"][-1]["instance"]
        _set_clock(tmp_path, step_s)
        until(lambda: seen.documents["alarms"][-1]["instance"] != first, 60.0)
        new = len(seen.documents["alarms"])
        until(lambda: len(seen.documents["alarms"]) > new + 1, 60.0)
        after = seen.documents["alarms"][new:]
        assert daemon.stop() < 2.0
    announced = [json.loads(line) for line in daemon.said().splitlines() if '"alarm"' in line]
    for document in after:
        alarms = {alarm["id"]: alarm for alarm in document["alarms"]}
        assert alarms[PLUG]["state"] == "acknowledged"
        for alarm in alarms.values():
            assert abs(document["time_s"] - alarm["since_s"]) < HOUR_S / 2
            assert "from the service's start" not in alarm["reason"] + alarm["remedy"]
        assert isinstance(document["sequence"], int)
    assert [a["state"] for a in announced if a.get("alarm") == PLUG].count("unacknowledged") == 1


def _alarms(seen: Subscriber) -> dict[str, dict]:
    documents = seen.documents.get("alarms", [])
    return {alarm["id"]: alarm for alarm in documents[-1]["alarms"]} if documents else {}


def test_a_clock_that_is_wrong_at_boot(tmp_path):
    """A computer without a battery starts in 1970; the time comes from the network some seconds later."""
    _set_clock(tmp_path, -time.time())
    with service(tmp_path, LAUNCHER) as (_, daemon, seen):
        until(lambda: any(e["quality"] == "good" for e in seen.estimates), 90.0)
        assert seen.estimates[-1]["time_s"] < 1e6
        _set_clock(tmp_path, 0.0)
        until(lambda: abs(seen.estimates[-1]["time_s"] - time.time()) < 10.0, 60.0)
        seen.wait_until_good(60.0)
        assert daemon.stop() < 2.0
    said = [json.loads(line) for line in daemon.said().splitlines()]
    assert any("clock was set" in str(line.get("reason")) for line in said)
