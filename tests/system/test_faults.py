"""Faults of devices and wires, on a running daemon: always flagged, back when the peer is, nothing lost."""

from __future__ import annotations

import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from types import SimpleNamespace

import pytest

from tests.publish.router import free_port
from tests.system.plant import PERIOD_S, PREFIX, ROOT, Daemon, Subscriber, machine, table_for, until

pytestmark = [pytest.mark.system, pytest.mark.timeout(180)]

SENSORS = ("t1", "t2", "t3", "t4", "t5")
SLOW = """
import sys, time, zenoh
from observer.publish.zenoh import session_config

def dawdle(sample):
    print("got one")
    time.sleep(1.0)

with zenoh.open(session_config("client", (sys.argv[1],), ())) as session:
    subscriber = session.declare_subscriber(sys.argv[2], dawdle)
    time.sleep(60)
"""
# A fault shows in the next reading, a reading in the next tick: two periods. A process that is told of it may
# itself be late on a busy machine.
FLAGGED_S = 2 * PERIOD_S + 0.1
BACK_S = 1.0 + PERIOD_S + 0.1


@pytest.fixture(scope="module")
def service(tmp_path_factory):
    """A machine, the daemon on it and a subscriber, for all tests of this file; each clears its faults."""
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    with machine() as plant:
        table = table_for(plant.wires, mode="router", listen=[endpoint])
        folder = tmp_path_factory.mktemp("faults")
        with Daemon(folder, table) as daemon, Subscriber(endpoint) as seen:
            seen.wait_until_good()
            until(seen.health, 6.0)
            yield SimpleNamespace(plant=plant, daemon=daemon, seen=seen, endpoint=endpoint)
            assert daemon.stop() < 2.0
            daemon.assert_no_tick_is_missing()
            overruns = seen.health()["overruns"]
            assert overruns == 0


@contextmanager
def _fault(service, lasts_s: float, sensors: tuple[str, ...], **faults) -> Iterator[list[dict]]:
    """Put a fault in force, give the estimates under it, and see that all is good soon after it."""
    service.seen.wait_until_good()
    begin_s = service.plant.fault(**faults)
    estimates: list[dict] = []
    try:
        time.sleep(lasts_s)
        end_s = time.time()
        estimates += service.seen.between(begin_s + FLAGGED_S, end_s)
        assert len(estimates) >= 0.8 * (lasts_s - FLAGGED_S) / PERIOD_S
        assert "good" not in {e["quality"] for e in estimates}
        for e in estimates:
            quality = dict(zip(e["sensors"], e["sensor_quality"], strict=True))
            assert {n for n in SENSORS if quality[n] != "good"} == set(sensors), e["time_s"] - begin_s
        yield estimates
    finally:
        cleared_s = service.plant.fault()
    assert service.seen.wait_until_good(5.0) - cleared_s < BACK_S
    ticks = [round(t / PERIOD_S) for t in service.daemon.step_times_s()]
    assert ticks == list(range(ticks[0], ticks[-1] + 1))


def _faults(service) -> dict[str, str | None]:
    return {name: channel["fault"] for name, channel in service.seen.health()["channels"].items()}


def test_a_modbus_server_that_is_gone_and_back(service):
    before = service.seen.health()["drivers"]["thermocouples"]["reconnects"]
    with _fault(service, 1.5, SENSORS, drop_modbus=True):
        assert _faults(service)["t1_degC"] == "disconnected"
        assert any("thermocouples is not connected" in r for r in service.seen.health()["reasons"])
    until(lambda: service.seen.health()["state"] == "good", 2.0)
    assert service.seen.health()["drivers"]["thermocouples"]["reconnects"] == before + 1


@pytest.mark.parametrize("code", [2, 4, 6])
def test_exception_replies(service, code):
    with _fault(service, 0.8, SENSORS, exception=code):
        assert _faults(service)["t1_degC"] == f"exception_{code}"


def test_an_open_thermocouple(service):
    with _fault(service, 0.8, ("t3",), open="t3_degC"):
        assert _faults(service) | {"t3_degC": None} == dict.fromkeys(_faults(service))
        assert _faults(service)["t3_degC"] == "open_circuit"


def test_a_thermocouple_out_of_range(service):
    with _fault(service, 0.8, ("t4",), over_range="t4_degC"):
        assert _faults(service)["t4_degC"] == "over_range"


def test_several_faults_at_once(service):
    with _fault(service, 1.0, ("t1", "t5"), open=["t1_degC", "t5_degC"], silence_can=True):
        assert _faults(service)["nut_position_m"] == "silent"


def test_a_silent_can_bus(service):
    service.seen.wait_until_good()
    begin_s = service.plant.fault(silence_can=True)
    time.sleep(1.2)
    # the driver is patient for 0.15 s (its timeout_s) before it calls a channel silent
    estimates = service.seen.between(begin_s + 0.15 + FLAGGED_S, time.time())
    faults = _faults(service)
    cleared_s = service.plant.fault()
    assert estimates
    assert {e["quality"] for e in estimates} == {"degraded"}
    assert faults["nut_position_m"] == faults["screw_speed_rpm"] == "silent"
    assert service.seen.wait_until_good(5.0) - cleared_s < BACK_S


def test_a_stuck_thermocouple(service):
    """Its frozen value is plausible, so only its stillness tells: 60 samples, more after long repeats."""
    service.seen.wait_until_good()
    begin_s = service.plant.fault(stuck="t2_degC")
    try:
        until(lambda: _faults(service)["t2_degC"] == "stuck", 30.0)
        flagged_s = time.time()
        time.sleep(0.5)
        after = service.seen.between(flagged_s + FLAGGED_S, time.time())
    finally:
        cleared_s = service.plant.fault()
    assert flagged_s - begin_s > 59 * PERIOD_S - 1.0  # it may have repeated for a while before
    assert after
    assert {e["sensor_quality"][1] for e in after} == {"rejected"}
    assert "good" not in {e["quality"] for e in after}
    assert service.seen.wait_until_good(5.0) - cleared_s < BACK_S


def test_a_slow_subscriber_holds_up_nothing(service):
    """Its callback sleeps a second for each message; the others get theirs at every tick."""
    service.seen.wait_until_good()
    slow = subprocess.Popen(
        [sys.executable, "-u", "-c", SLOW, service.endpoint, f"{PREFIX}/**"], cwd=ROOT, stdout=subprocess.PIPE
    )
    try:
        assert slow.stdout.readline() == b"got one\n"
        start_s = time.time()
        time.sleep(3.0)
        end_s = time.time()
    finally:
        slow.kill()
        rest, _ = slow.communicate(timeout=5)
    time.sleep(2 * PERIOD_S)  # the last ones are on their way
    estimates = service.seen.between(start_s, end_s)
    assert len(rest.splitlines()) < len(estimates)
    numbers = [round(e["time_s"] / PERIOD_S) for e in estimates]
    assert numbers == list(range(numbers[0], numbers[-1] + 1))
    assert len(numbers) >= 29
    assert {e["quality"] for e in estimates} == {"good"}
