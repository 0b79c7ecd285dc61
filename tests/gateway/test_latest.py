"""What the gateway keeps of the service's messages, and what those get who are slower."""

from __future__ import annotations

import asyncio
import io

import pytest
from hypothesis import given
from hypothesis import strategies as st

from observer.gateway.messages import Latest, Pending
from observer.process.pipes import framed, messages

KEYS = st.text(max_size=30).filter(lambda key: len(key.encode()) < 100)


@given(st.lists(st.tuples(KEYS, st.binary(max_size=300)), max_size=5))
def test_messages_pass_through_a_pipe_unchanged(sent):
    data = b"".join(framed(key, payload) for key, payload in sent)
    assert list(messages(io.BytesIO(data).read)) == sent
    for cut in range(1, min(len(data), 400)):
        whole = list(messages(io.BytesIO(data[:-cut]).read))
        assert whole == sent[: len(whole)]
        assert len(whole) < len(sent)


def test_a_slow_outlet_gets_the_newest_of_each_key_in_the_order_of_their_coming():
    woken = []
    pending = Pending(lambda: woken.append(1))
    for key, payload in (("heat", b"1"), ("health", b"a"), ("heat", b"2")):
        pending.put(key, payload)
    assert pending.take() == [("health", b"a"), ("heat", b"2")]
    assert pending.take() == []
    assert len(woken) == 3


async def test_a_listener_hears_what_was_there_and_what_comes():
    latest = Latest(0.1)
    latest.put("health", b'{"state":"good"}')
    heard = latest.messages()
    assert await anext(heard) == ("health", b'{"state":"good"}')
    latest.put("heat", b"1")
    latest.put("heat", b"2")
    assert await asyncio.wait_for(anext(heard), 10.0) == ("heat", b"2")
    assert latest.document("health") == {"state": "good"}
    assert latest.document("alarms") == {}


@pytest.mark.parametrize(("silent_s", "stale"), [(0.4, False), (0.6, True)])
def test_two_periods_of_silence_are_stale(silent_s, stale):
    now_s = [100.0]
    latest = Latest(0.1, lambda: now_s[0])
    latest.put("estimate", b"")
    now_s[0] += silent_s
    assert latest.is_stale is stale
