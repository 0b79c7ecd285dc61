"""The service's queries of the past are answered by processes that end, whatever was asked."""

from __future__ import annotations

import os
import signal
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing

import pytest

from observer.bus.codec import decode
from observer.record.asking import PastProcess
from tests.patience import until
from tests.record.lived import BEGIN_S, configuration, lived

pytestmark = pytest.mark.system
SPAN = {"from": f"{BEGIN_S}", "to": f"{BEGIN_S + 5.0}"}
HUGE = ("nan", "inf", "-inf", "1e300", "-1e300", "1e-300")


@pytest.fixture
def past(tmp_path):
    config = configuration(tmp_path)
    lived(config, 60)
    with closing(PastProcess(tmp_path, "demo-x", config.digest, 0.5)) as past:
        yield past


def test_an_answer_is_the_page_that_was_asked_for(past):
    page = decode(past.ask("estimate", SPAN).payload)
    assert len(page["estimates"]) == 10
    assert page["config"] == page["in_force"]


def test_every_hostile_query_gets_a_sentence_or_a_page(past):
    for name, value in [*((n, v) for n in ("from", "to", "every") for v in HUGE), ("every", "5e-324")]:
        reply = past.ask("readings", SPAN | {name: value})
        assert reply.payload or "give" in reply.reason, (name, value)


def test_of_twelve_queries_at_once_four_wait_and_the_others_are_refused(past):
    with ThreadPoolExecutor(12) as threads:
        first = threads.submit(past.ask, "estimate", SPAN)
        until(lambda: past._child is not None)
        os.kill(past._child.pid, signal.SIGSTOP)
        try:
            replies = [first, *(threads.submit(past.ask, "estimate", SPAN) for _ in range(11))]
            until(lambda: sum(reply.done() for reply in replies) == 8)
        finally:
            os.kill(past._child.pid, signal.SIGCONT)
        reasons = [reply.result().reason for reply in replies]
    assert reasons.count(None) == 4
    assert reasons.count("too many requests at once; ask again in a second") == 8


def test_a_process_that_is_killed_fails_one_query_only(past):
    with ThreadPoolExecutor(1) as threads:
        reply = threads.submit(past.ask, "estimate", SPAN)
        until(lambda: past._child is not None)
        past._child.kill()
        assert reply.result().reason == "the query failed; ask for another span"
    assert len(decode(past.ask("estimate", SPAN).payload)["estimates"]) == 10


def test_a_service_that_ends_asks_no_more(past):
    past.close()
    assert past.ask("estimate", SPAN).reason == "the service ends"
