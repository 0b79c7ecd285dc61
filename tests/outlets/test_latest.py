"""What the outlets keep of the bus, and what those get who are slower."""

from __future__ import annotations

import asyncio
import threading

import pytest

from observer.outlets.messages import Latest, Pending


def test_a_slow_outlet_gets_the_newest_of_each_key_in_the_order_of_their_coming():
    woken = []
    pending = Pending(lambda: woken.append(1))
    for key, payload in (("heat", b"1"), ("health", b"a"), ("heat", b"2")):
        pending.put(key, payload)
    assert pending.take() == [("health", b"a"), ("heat", b"2")]
    assert pending.take() == []
    assert len(woken) == 1  # a reader that hangs gathers no calls
    pending.put("heat", b"3")
    assert len(woken) == 2


async def test_a_listener_hears_what_was_there_and_what_comes():
    latest = Latest(0.1)
    latest.put("health", b'{"state":"good"}')
    heard = latest.messages()
    assert await anext(heard) == ("health", b'{"state":"good"}')
    threads = [threading.Thread(target=latest.put, args=("heat", payload)) for payload in (b"1", b"2")]
    for thread in threads:  # as from Zenoh's
        thread.start()
        thread.join()
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
