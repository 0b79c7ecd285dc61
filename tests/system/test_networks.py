"""A router that dies, freezes or is slow to come, and a clock that is set: the estimates go on regardless."""

from __future__ import annotations

import time

import pytest

from tests.patience import HERE, Stopwatch
from tests.publish.router import Router, free_port
from tests.system.plant import PERIOD_S, START_S, Daemon, Subscriber, machine, table_for, until

pytestmark = [pytest.mark.system, pytest.mark.slow]

BACK_S = 1.0 + PERIOD_S + 0.1
OUTAGE_S = 3.3  # by then Zenoh's own pauses between attempts have grown to four seconds
MOST = 0.8  # a busy computer may hold up the daemon, or a reading, for a moment


def _client_of(endpoint: str) -> dict:
    return {"mode": "client", "connect": [endpoint]}


def _wait_for_ticks_until(daemon: Daemon, time_s: float) -> None:
    """Whatever became of the router: the daemon goes on."""
    until(lambda: max(daemon.step_times_s(), default=0.0) > time_s, START_S)


def test_a_router_that_comes_late_is_killed_and_comes_back(tmp_path):
    port = free_port()
    endpoint = f"tcp/127.0.0.1:{port}"
    with machine() as plant, Daemon(tmp_path, table_for(plant.wires, **_client_of(endpoint))) as daemon:
        until(lambda: any(daemon.recordings.glob("*.csv")), START_S)
        _wait_for_ticks_until(daemon, time.time() + 1.0)  # it works without a router
        with Router(port), Subscriber(endpoint) as seen:
            watch = Stopwatch(daemon.process.pid, plant.pid)
            seen.wait_for_more(1)
            assert watch.took_s() < 5.0
            seen.wait_until_good()
            before = until(seen.health)
        killed_s = time.time()
        _wait_for_ticks_until(daemon, killed_s + OUTAGE_S)
        with Router(port) as router, Subscriber(endpoint) as seen:
            # who listens has to come back to the router too
            watch, listening_s = Stopwatch(router.pid, daemon.process.pid, plant.pid, HERE), time.time()
            assert seen.wait_until_good() - listening_s - watch.held_up_s() < BACK_S
            until(lambda: seen.health().get("publish_reconnects") == before["publish_reconnects"] + 1)
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
            _wait_for_ticks_until(daemon, frozen_s + 4.0)  # twice the lease after which the link is given up
            watch, thawed_s = Stopwatch(router.pid, daemon.process.pid), time.time()
            router.thaw()
            assert watch.until(lambda: any(e["time_s"] > thawed_s for e in list(seen.estimates))) < 8.0
            router.freeze()
            # the link is given up meanwhile, and a new one hangs half open
            _wait_for_ticks_until(daemon, time.time() + 2.5)
            assert daemon.stop() < 2.0
            router.thaw()
        during = [t for t in daemon.step_times_s() if frozen_s < t < thawed_s]
        assert len(during) >= MOST * 4.0 / PERIOD_S
        daemon.assert_no_tick_is_missing()
