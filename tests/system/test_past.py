"""The past of a running service, asked by time: it is what was published, and no tick waits for it."""

from __future__ import annotations

import itertools
import json
import math
from datetime import UTC, datetime

import numpy as np
import pytest
import zenoh

from observer.bus.codec import decode
from observer.bus.session import session_config
from tests.bus.router import Router, free_port
from tests.patience import PATIENCE_S, until
from tests.system.plant import PERIOD_S, PREFIX, Daemon, Subscriber, machine, table_for

pytestmark = pytest.mark.system
OUTAGE_STEPS = 30


def _ask(session: zenoh.Session, selector: str) -> bytes:
    """The answer to a query; raises `LookupError` with the words of a refusal."""
    for reply in session.get(f"{PREFIX}/{selector}", timeout=PATIENCE_S):
        if reply.ok is None:
            raise LookupError(reply.err.payload.to_string())
        return reply.ok.payload.to_bytes()
    raise LookupError("no answer")


def _gaps_s(daemon: Daemon, from_s: float, to_s: float) -> list[list[float]]:
    """Where ticks are more than two periods and a half apart: a busy computer's service skips some."""
    ticks_s = [t for t in daemon.ticks_s() if from_s <= t <= to_s]
    return [[a, b] for a, b in itertools.pairwise(ticks_s) if b - a > 2.5 * PERIOD_S]


def test_a_running_service_serves_its_past_from_several_files(tmp_path):
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    with machine() as plant:
        table = table_for(plant.wires, mode="router", listen=[endpoint])
        with Daemon(tmp_path, table, rotate_MB=0.03) as daemon, Subscriber(endpoint) as seen:
            seen.wait_until_good()
            until(lambda: len(list(daemon.recordings.glob("*.csv"))) >= 3)
            seen.wait_for_more(20)
            published = seen.estimates[2:]
            first_s, last_s = published[0]["time_s"], published[-1]["time_s"]
            at = datetime.fromtimestamp(first_s, UTC).isoformat()
            with zenoh.open(session_config("client", (endpoint,), ())) as session:

                def all_there() -> bool:  # the newest rows are on their way to the disk
                    page = decode(_ask(session, f"estimate?from={at};to={last_s + 0.01}"))
                    return page["estimates"][-1]["time_s"] == last_s and page

                page = until(all_there)
                readings = json.loads(_ask(session, f"readings?from={first_s};to={last_s + 0.01}"))
                with pytest.raises(LookupError, match="ISO 8601"):
                    _ask(session, "estimate?from=noon")
                assert json.loads(_ask(session, "readings"))["time_s"] >= last_s
            found = {e["sequence"]: e for e in page["estimates"]}
            assert page["notes"] == []
            assert page["gaps_s"] == _gaps_s(daemon, first_s, last_s)
            assert len(readings["readings"]) == len(page["estimates"])
            for one in published:
                for key, value in one.items():
                    np.testing.assert_array_equal(found[one["sequence"]][key], value, err_msg=key)
            answered = readings["readings"][2:]

            def live() -> dict[int, object]:
                return {d["sequence"]: d for d in seen.documents["readings"]}

            # the bus may be slower than the answer
            until(lambda: {d["sequence"] for d in answered} <= live().keys())
            assert all(live()[d["sequence"]] == d for d in answered)
            daemon.stop()


def test_who_was_cut_off_by_a_dead_router_gets_every_step_by_time(tmp_path):
    port = free_port()
    with machine() as plant, Router(port) as router:
        table = table_for(plant.wires, connect=[router.endpoint])
        with Daemon(tmp_path, table) as daemon:
            with Subscriber(router.endpoint) as seen:
                seen.wait_for_more(5)
                last_s = seen.estimates[-1]["time_s"]
            router.kill()
            until(lambda: sum(t > last_s for t in daemon.ticks_s()) > OUTAGE_STEPS)
            router.start()
            with Subscriber(router.endpoint) as seen:
                seen.wait_for_more(2)
                first_s = seen.estimates[0]["time_s"]
                missed = [t for t in daemon.ticks_s() if last_s < t < first_s]
                with zenoh.open(session_config("client", (router.endpoint,), ())) as session:
                    begin_s = math.nextafter(last_s, math.inf)
                    selector = f"estimate?from={begin_s!r};to={first_s!r}"

                    def all_there() -> bool:  # the newest rows are on their way to the disk
                        page = decode(_ask(session, selector))
                        return [e["time_s"] for e in page["estimates"]] == missed and page

                    page = until(all_there)
            assert len(missed) > OUTAGE_STEPS
            assert page["gaps_s"] == _gaps_s(daemon, missed[0], missed[-1])
            daemon.stop()
