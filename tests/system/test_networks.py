"""A router that dies, freezes or is slow to come, and a clock that is set: the estimates go on regardless."""

from __future__ import annotations

import time

import pytest

from tests.publish.router import Router, free_port
from tests.system.plant import PERIOD_S, Daemon, Subscriber, machine, table_for, until

pytestmark = [pytest.mark.system, pytest.mark.timeout(180)]

BACK_S = 1.0 + PERIOD_S + 0.1
OUTAGE_S = 3.3  # by then Zenoh's own pauses between attempts have grown to four seconds
MOST = 0.8  # a busy computer may hold up the daemon, or a reading, for a moment


def _client_of(endpoint: str) -> dict:
    return {"mode": "client", "connect": [endpoint]}


def _ticks(daemon: Daemon) -> int:
    return len(daemon.step_times_s())


def test_a_router_that_comes_late_is_killed_and_comes_back(tmp_path):
    port = free_port()
    endpoint = f"tcp/127.0.0.1:{port}"
    with machine() as plant, Daemon(tmp_path, table_for(plant.wires, **_client_of(endpoint))) as daemon:
        until(lambda: daemon.recordings.exists() and any(daemon.recordings.glob("*.csv")), 90.0)
        until(lambda: _ticks(daemon) > 10, 90.0)  # it works without a router
        with Router(port), Subscriber(endpoint) as seen:
            seen.wait_until_good(5.0)
            before = until(seen.health, 10.0)
        killed_s = time.time()
        time.sleep(OUTAGE_S)
        with Router(port), Subscriber(endpoint) as seen:
            listening_s = time.time()
            assert seen.wait_until_good(10.0) - listening_s < BACK_S
            until(lambda: seen.health().get("publish_reconnects") == before["publish_reconnects"] + 1, 10.0)
            assert seen.health()["publish_drops"] > before["publish_drops"]  # the outage is not hidden
            assert daemon.stop() < 2.0
        during = [t for t in daemon.step_times_s() if killed_s < t < killed_s + OUTAGE_S]
        assert len(during) >= MOST * OUTAGE_S / PERIOD_S
        daemon.assert_no_tick_is_missing()


def test_a_router_that_freezes_and_thaws(tmp_path):
    with Router() as router, machine() as plant:
        table = table_for(plant.wires, **_client_of(router.endpoint))
        with Daemon(tmp_path, table) as daemon, Subscriber(router.endpoint) as seen:
            seen.wait_until_good()
            router.freeze()
            frozen_s = time.time()
            time.sleep(4.0)  # twice the lease after which the link is given up
            router.thaw()
            thawed_s = time.time()
            until(lambda: any(e["time_s"] > thawed_s for e in list(seen.estimates)), 8.0)
            router.freeze()
            time.sleep(2.5)  # the link has been given up, and a new one hangs half open
            assert daemon.stop() < 2.0
            router.thaw()
        during = [t for t in daemon.step_times_s() if frozen_s < t < thawed_s]
        assert len(during) >= MOST * 4.0 / PERIOD_S
        daemon.assert_no_tick_is_missing()
