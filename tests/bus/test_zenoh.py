"""Publishing on real Zenoh sessions and routers: nothing waits, what is lost is counted, links return."""

import json
import subprocess
import sys
import threading
import time

import pytest
import zenoh

from observer.bus.codec import decode, decode_estimate
from observer.bus.session import session_config
from observer.bus.watch import Subscription
from observer.bus.zenoh import ServiceIdentity, ZenohPublisher
from observer.config.publishing import Publish
from tests.bus.blocks import LAYOUT, block
from tests.bus.router import Router, free_port
from tests.patience import HERE, PATIENCE_S, Stopwatch
from tests.patience import until as _wait

pytestmark = pytest.mark.system

HELD_UP_S = 0.5  # a call that waits for the network takes seconds
OUTAGE_S = 3.3  # by then Zenoh's own pauses between attempts have grown to four seconds


def _publisher(endpoint: str, mode: str = "client", **settings) -> ZenohPublisher:
    ends = {"listen": (endpoint,)} if mode == "router" else {"connect": (endpoint,)}
    publisher = ZenohPublisher(
        ServiceIdentity("lathe-7", "z", "0a0a0a0a"),
        Publish(mode=mode, **ends, **settings),
        '{"hash":"h"}',
        LAYOUT,
    )
    publisher.start()
    return publisher


def _keep_publishing(publisher, until, period_s=0.02):
    """Publish until a condition holds; returns the longest time that one call took."""
    sequence, longest_s = 0, 0.0

    def published() -> bool:
        nonlocal sequence, longest_s
        if until():
            return True
        watch = Stopwatch()
        publisher.publish(block(1.8e9 + sequence * period_s), sequence)
        longest_s = max(longest_s, watch.took_s())
        sequence += 1
        return False

    _wait(published, pause_s=period_s)
    return longest_s


@pytest.fixture
def router():
    with Router() as running:
        yield running


@pytest.fixture
def publisher():
    """A publisher that is a router itself, and its endpoint."""
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    made = _publisher(endpoint, "router", history=5)
    _wait(lambda: made.status.connected)
    yield made, endpoint
    assert made.close(2.0)


def test_a_subscriber_gets_every_message_of_the_contract(publisher):
    made, endpoint = publisher
    with Subscription((endpoint,), "lathe-7", "z") as subscription:
        _keep_publishing(made, lambda: "field" in subscription.latest())
        made.publish(block(1.9e9, seed=4), 77)
        made.document("health", {"state": "good"})
        latest = _wait(
            lambda: (d := subscription.latest()).get("health") and d["error"]["sequence"] == 77 and d
        )
    assert {"estimate", "heat", "field", "error", "learned", "health"} == set(latest)
    assert set(latest["learned"]["parameters"]["sensor.t1.offset_K"]) == {"value", "sigma"}
    assert {latest[key]["sequence"] for key in ("estimate", "heat", "field", "error")} == {77}
    assert {latest[key]["time_s"] for key in ("estimate", "heat", "field", "error")} == {1.9e9}
    assert latest["field"]["position_m"] == pytest.approx(latest["estimate"]["position_m"].tolist(), rel=1e-5)


def test_messages_carry_their_encoding_and_may_be_dropped(publisher):
    made, endpoint = publisher
    with zenoh.open(session_config("client", (endpoint,), ())) as session:
        subscriber = session.declare_subscriber("ballscrew/**")
        _keep_publishing(made, lambda: made.status.published > 40)
        samples = {}
        while (sample := subscriber.try_recv()) is not None:
            samples.setdefault(str(sample.key_expr), sample)
    prefix = "ballscrew/lathe-7/z"
    assert str(samples[f"{prefix}/estimate"].encoding) == "application/cbor;ballscrew.estimate.v1"
    assert str(samples[f"{prefix}/heat"].encoding) == "application/json"
    assert all(s.congestion_control == zenoh.CongestionControl.DROP for s in samples.values())


def test_field_and_error_keep_their_rate_by_the_time_of_the_estimate():
    publisher = ZenohPublisher(
        ServiceIdentity("m", "x", "0a0a0a0a"), Publish(field_rate_Hz=2.0), "{}", LAYOUT
    )
    sent = []
    publisher._put = lambda key, payload: sent.append((key, payload))
    for k in range(1000):
        publisher.publish(block(1.8e9 + 0.01 * k), k)
    counts = {
        key: sum(sent_key == key for sent_key, _ in sent)
        for key in ("estimate", "heat", "field", "error", "learned")
    }
    assert counts == {"estimate": 1000, "heat": 1000, "field": 20, "error": 20, "learned": 10}


def _get(endpoint, selector):
    with zenoh.open(session_config("client", (endpoint,), ())) as session:
        return list(session.get(selector, timeout=PATIENCE_S))


def test_a_publisher_answers_for_the_configuration_and_the_last_estimates(publisher):
    made, endpoint = publisher
    prefix = "ballscrew/lathe-7/z"
    (none,) = _get(endpoint, f"{prefix}/estimate")
    assert none.err.payload.to_string() == "no estimate yet"
    for k in range(8):
        made.publish(block(float(k)), k)
    (unknown,) = _get(endpoint, f"{prefix}/health")
    assert unknown.err.payload.to_string() == "no health report yet"
    made.document("health", {"state": "good"})
    (health,) = _get(endpoint, f"{prefix}/health")
    counts = {"sequence": 7, "sensors_used": 2, "sensors": 2}
    assert json.loads(health.ok.payload.to_bytes()) == counts | {"state": "good"}
    (config,) = _get(endpoint, f"{prefix}/config")
    assert json.loads(config.ok.payload.to_bytes()) == {"hash": "h"}
    (last,) = _get(endpoint, f"{prefix}/estimate")
    assert decode_estimate(last.ok.payload.to_bytes())["sequence"] == 7
    for asked, expected in (("3", [5, 6, 7]), ("100", [3, 4, 5, 6, 7])):  # history holds five
        (several,) = _get(endpoint, f"{prefix}/estimate?last={asked}")
        assert [e["sequence"] for e in decode(several.ok.payload.to_bytes())] == expected


def test_the_liveliness_token_lives_as_long_as_the_service():
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    with Router(int(endpoint.rsplit(":", 1)[1])):
        made = _publisher(endpoint)
        with zenoh.open(session_config("client", (endpoint,), ())) as session:

            def alive():
                return [
                    str(r.ok.key_expr)
                    for r in session.liveliness().get("ballscrew/*/*/alive", timeout=PATIENCE_S)
                ]

            _wait(lambda: alive() == ["ballscrew/lathe-7/z/alive"])
            assert made.close(2.0)
            _wait(lambda: alive() == [])


@pytest.mark.parametrize("mode", ["client", "peer"])
def test_a_router_that_is_not_there_yet_holds_up_nothing(mode):
    port = free_port()
    made = _publisher(f"tcp/127.0.0.1:{port}", mode)
    longest_s = _keep_publishing(made, lambda: made.status.dropped >= 40)
    assert longest_s < HELD_UP_S
    assert made.status.reason is not None
    assert not made.status.connected
    with Router(port) as router, Subscription((router.endpoint,), "lathe-7", "z") as subscription:
        _keep_publishing(made, lambda: "estimate" in subscription.latest())
        _wait(lambda: made.status.connected and made.status.reason is None)
    assert made.close(2.0)


def test_a_killed_router_is_counted_as_an_outage_and_found_again_within_a_second():
    with Router() as router:
        made = _publisher(router.endpoint)
        _keep_publishing(made, lambda: made.status.connected)
    longest_s = _keep_publishing(made, lambda: not made.status.connected)
    lost_s, before = time.monotonic(), made.status.dropped
    longest_s = max(longest_s, _keep_publishing(made, lambda: time.monotonic() - lost_s > OUTAGE_S))
    assert made.status.dropped > before + 20
    assert longest_s < HELD_UP_S
    assert "nobody answers" in made.status.reason
    with Router(router.port) as router, Subscription((router.endpoint,), "lathe-7", "z") as subscription:
        watch = Stopwatch(HERE, router.pid)
        _keep_publishing(made, lambda: "estimate" in subscription.latest())
        assert watch.took_s() < 1.0
        _wait(lambda: made.status.connected)
        assert made.status.reconnects == 1
    made.close(1.0)


def test_a_frozen_router_neither_stalls_publishing_nor_closing():
    with Router() as router:
        made = _publisher(router.endpoint)
        _keep_publishing(made, lambda: made.status.connected)
        router.freeze()
        longest_s = _keep_publishing(made, lambda: not made.status.connected, period_s=0.002)
        watch = Stopwatch()
        made.close(1.0)
        closed_s = watch.took_s()
        router.thaw()
    assert longest_s < HELD_UP_S
    assert closed_s < 1.0 + HELD_UP_S


def test_closing_at_once_under_a_frozen_router_gives_up_in_time():
    with Router() as router:
        made = _publisher(router.endpoint)
        _keep_publishing(made, lambda: made.status.connected)
        router.freeze()
        for k in range(3000):
            made.publish(block(1.8e9 + k), k)
        watch = Stopwatch()
        made.close(0.7)
        assert watch.took_s() < 0.7 + HELD_UP_S
        router.thaw()


def test_a_slow_subscriber_stalls_nobody(publisher):
    made, endpoint = publisher
    gate = threading.Event()
    with zenoh.open(session_config("client", (endpoint,), ())) as session:
        slow = session.declare_subscriber(
            "ballscrew/**", zenoh.handlers.Callback(lambda sample: gate.wait(3), indirect=False)
        )
        start = made.status.published
        longest_s = _keep_publishing(made, lambda: made.status.published > start + 2000, period_s=0.0005)
        with Subscription((endpoint,), "lathe-7", "z") as other:
            _keep_publishing(made, lambda: "estimate" in other.latest())
        gate.set()
        slow.undeclare()
    assert longest_s < HELD_UP_S


def test_a_port_in_use_is_reported_and_retried():
    with Router() as router:
        made = _publisher(router.endpoint, "router")
        _wait(lambda: made.status.reason and "no session" in made.status.reason)
        assert "/root" not in made.status.reason
    _wait(lambda: made.status.connected)
    assert made.close(2.0)


def test_a_process_with_an_open_session_exits(tmp_path):
    script = (
        "from tests.bus.test_zenoh import _publisher, _wait, free_port\n"
        "made = _publisher(f'tcp/127.0.0.1:{free_port()}', 'router')\n"
        "_wait(lambda: made.status.connected)\n"
    )
    subprocess.run([sys.executable, "-c", script], check=True, timeout=PATIENCE_S)
