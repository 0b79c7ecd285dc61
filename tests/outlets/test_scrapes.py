"""Prometheus' figures beside hundreds of connections that ask nothing."""

from __future__ import annotations

import os
import socket
import urllib.request

import pytest

from observer.config.outlets import Metrics
from tests.bus.router import free_port
from tests.outlets.feeding import fed_outlets

pytestmark = pytest.mark.system


@pytest.mark.parametrize("sent", [b"", b"GET /metrics HTT"])
def test_connections_that_ask_nothing_take_few_threads_and_nobody_elses_turn(sent):
    port = free_port()
    with fed_outlets(metrics=Metrics(listen=f"127.0.0.1:{port}")) as feed:
        assert feed.said()["reason"] is None
        before = _threads(feed.process.pid)
        held = []
        for _ in range(400):
            held.append(socket.create_connection(("127.0.0.1", port)))
            held[-1].sendall(sent)
        with urllib.request.urlopen(f"http://127.0.0.1:{port}/metrics", timeout=60.0) as reply:
            assert b"ballscrew_up" in reply.read()
        assert _threads(feed.process.pid) <= before + 16
        for connection in held:
            connection.close()


def _threads(pid: int) -> int:
    return len(os.listdir(f"/proc/{pid}/task"))
