"""One writer: a second service is refused, and two that run at once notice each other."""

import cbor2
import pytest
import zenoh

from observer.bus.codec import EstimateEncoder, instance_of
from observer.bus.session import session_config
from observer.bus.zenoh import ServiceIdentity, ZenohPublisher
from observer.config.publishing import Publish
from tests.bus.blocks import LAYOUT, block
from tests.bus.people import PREFIX, ask, published, session
from tests.bus.router import Router, free_port
from tests.patience import until as wait


def _client(endpoint: str, instance: str, mode: str = "client") -> ZenohPublisher:
    settings = Publish.model_validate({"mode": mode, "connect": (endpoint,)})
    made = ZenohPublisher(ServiceIdentity("lathe-7", "z", instance), settings, '{"hash":"ab12"}', LAYOUT)
    made.start()
    return made


def test_an_instance_is_found_in_every_message():
    encoder, one = EstimateEncoder(LAYOUT, "0a1b2c3d"), block()
    for message in (encoder.cbor(one, 0, 1), encoder.heat(one, 0, 1), encoder.field(one, 0, 1)):
        assert instance_of(message) == "0a1b2c3d"
    assert instance_of(cbor2.dumps({"instance": "0a1b2c3d9"})) is None


@pytest.mark.system
@pytest.mark.parametrize("mode", ["client", "peer"])
def test_a_second_service_is_refused_until_the_first_has_gone(mode):
    with Router() as router:
        first = _client(router.endpoint, "11111111", mode)
        wait(lambda: first.status.connected)
        second = _client(router.endpoint, "22222222", mode)
        wait(lambda: second.status.settled)
        assert f"another service runs as {PREFIX}; end it" in second.status.taken
        assert second.status.reason == second.status.taken
        second.publish(block(), 0)
        assert (second.status.published, second.status.dropped) == (0, 5)
        assert first.close(5.0)
        wait(lambda: second.status.connected and second.status.taken is None)
        assert second.close(5.0)


@pytest.mark.system
def test_a_service_that_comes_back_at_once_is_not_refused():
    with Router() as router:
        first = _client(router.endpoint, "11111111")
        wait(lambda: first.status.connected)
        again = _client(router.endpoint, "22222222")
        assert first.close(5.0)
        wait(lambda: again.status.settled)
        assert again.status.taken is None
        assert again.close(5.0)


@pytest.mark.system
@pytest.mark.parametrize("mode", ["client", "peer"])
def test_two_services_that_both_went_on_notice_each_other(monkeypatch, mode):
    monkeypatch.setattr("observer.bus.zenoh.DuplicateServiceDetector.token_is_there", lambda _: False)
    with Router() as router:
        pair = [_client(router.endpoint, name, mode) for name in ("11111111", "22222222")]
        wait(lambda: all(one.status.connected and one.status.duplicate for one in pair))
        words = [one.status.duplicate for one in pair]
        assert all(one.status.reason == word for one, word in zip(pair, words, strict=True))
        assert "instance 22222222" in words[0]
        assert "instance 11111111" in words[1]
        assert pair[0].close(5.0)
        wait(lambda: pair[1].status.duplicate is None)
        assert pair[1].close(5.0)


@pytest.mark.system
def test_its_own_tokens_and_those_of_another_axis_are_no_duplicates():
    with published() as (made, endpoint), session(endpoint) as other:
        liveliness = other.liveliness()
        held = [liveliness.declare_token("ballscrew/lathe-8/z/alive/0b0b0b0b")]
        tokens = liveliness.declare_subscriber("ballscrew/**", zenoh.handlers.FifoChannel(10), history=True)
        keys = {str(tokens.recv().key_expr) for _ in range(3)}
        assert keys == {f"{PREFIX}/alive", f"{PREFIX}/alive/0a0a0a0a", "ballscrew/lathe-8/z/alive/0b0b0b0b"}
        assert made.status.duplicate is None
        held.append(liveliness.declare_token(f"{PREFIX}/alive/0b0b0b0b"))
        wait(lambda: made.status.duplicate)
        assert (
            made.status.reason == f"another service runs as {PREFIX} (instance 0b0b0b0b); end one of the two"
        )


@pytest.mark.system
def test_where_nobody_answers_a_service_starts_all_the_same():
    for mode in ("client", "peer"):
        made = _client(f"tcp/127.0.0.1:{free_port()}", "11111111", mode)
        wait(lambda made=made: made.status.settled)
        assert made.status.taken is None
        made.close(1.0)


@pytest.mark.system
def test_a_large_message_does_not_come_in():
    with published() as (_, endpoint), zenoh.open(session_config("client", (endpoint,), ())) as other:
        for size in (70_000, 1_000_000, 100_000_000):
            assert ask(other, f"{PREFIX}/config", payload=b"x" * size) in ([], ["! Timeout"])
        assert ask(other, f"{PREFIX}/config", payload=b"small") == ['{"hash":"ab12"}']
