"""The archive's process outlives every query, and is started again where it ends all the same."""

from __future__ import annotations

import os
import signal
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing

import pytest

from observer.archive.client import Archivist
from observer.publish.codec import config_json, decode
from tests.archive.lived import BEGIN_S, configuration, lived
from tests.patience import until

pytestmark = pytest.mark.system
HEAT = ["Heat", "nut", "Heat_W"]
SPAN = {"from": f"{BEGIN_S}", "to": f"{BEGIN_S + 5.0}"}
TIMES = {"from_s": BEGIN_S, "to_s": BEGIN_S + 5.0}
HUGE = (float("nan"), float("inf"), -float("inf"), 1e300, -1e300, 1e-300)
HOSTILE = [
    ("estimate", SPAN | {"every": "1e-300"}),
    ("readings", SPAN | {"every": "5e-324"}),
    *[("estimate", SPAN | {name: f"{value}"}) for name in ("from", "to", "every") for value in HUGE],
    *[("late", TIMES | {"keys": ["estimate"], "every_s": value}) for value in HUGE],
    *[("series", TIMES | {name: value, "node": HEAT, "most": 5, "backwards": False})
      for name in ("from_s", "to_s") for value in HUGE],
    ("series", TIMES | {"node": ["nothing"], "most": 5, "backwards": True}),
    ("late", {}),
]  # fmt: skip


@pytest.fixture
def archivist(tmp_path):
    config = configuration(tmp_path)
    lived(config, 60)
    with closing(Archivist(config_json(config, "00000001").encode(), tmp_path)) as archivist:
        assert len(decode(archivist.ask("estimate", SPAN).payload)["estimates"]) == 10
        yield archivist


def test_no_query_ends_the_process(archivist):
    process = archivist._child
    for kind, question in HOSTILE:
        archivist.ask(kind, question)
        assert process.poll() is None, (kind, question)
    assert "give" in archivist.ask(*HOSTILE[0]).reason
    assert len(decode(archivist.ask("estimate", SPAN).payload)["estimates"]) == 10
    assert archivist._child is process


def test_of_twelve_queries_at_once_four_wait_and_the_others_are_refused(archivist):
    os.kill(archivist._child.pid, signal.SIGSTOP)
    with ThreadPoolExecutor(12) as threads:
        try:
            replies = [threads.submit(archivist.ask, "estimate", SPAN) for _ in range(12)]
            until(lambda: sum(reply.done() for reply in replies) == 8)
        finally:
            os.kill(archivist._child.pid, signal.SIGCONT)
        reasons = [reply.result().reason for reply in replies]
    assert reasons.count(None) == 4
    assert reasons.count("too many requests at once; ask again in a second") == 8


@pytest.mark.parametrize("when", ["between", "during"])
def test_a_process_that_ends_is_reported_and_started_again(archivist, when, capfd):
    process = archivist._child
    if when == "between":
        process.kill()
        process.wait()
    else:
        os.kill(process.pid, signal.SIGSTOP)
        os.kill(process.pid, signal.SIGKILL)
        archivist.ask("estimate", SPAN)
    assert len(decode(archivist.ask("estimate", SPAN).payload)["estimates"]) == 10
    assert archivist._child is not process
    printed = capfd.readouterr()
    assert "the process that reads the recordings ended" in printed.out + printed.err
