"""The socket on which a service serves its outlets, and what it takes from their process."""

from __future__ import annotations

import os
import signal
import stat
import sys
import tempfile
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import pytest
import zenoh

from observer.bus.session import LOCAL, session_config
from observer.bus.zenoh import ServiceIdentity, ZenohPublisher
from observer.config.outlets import Metrics
from observer.config.publishing import Publish
from observer.outlets import beside
from observer.outlets.beside import OutletsProcess
from observer.outlets.start import Start
from tests.bus.blocks import LAYOUT
from tests.bus.router import free_port
from tests.patience import PATIENCE_S, until

pytestmark = pytest.mark.system
PREFIX = "ballscrew/lathe/z"
NAN = b'{"mqtt": {"unsent": {"steps": NaN, "duration_s": Infinity}}}'


@pytest.fixture
def sockets(tmp_path, monkeypatch) -> Path:
    """The folder below which sockets are made, which is not there yet."""
    folder = tmp_path / "temporary"
    monkeypatch.setattr(tempfile, "tempdir", str(folder))
    return folder


@pytest.fixture
def endpoint() -> str:
    return f"tcp/127.0.0.1:{free_port()}"


@pytest.fixture
def made(sockets, endpoint) -> Iterator[ZenohPublisher]:
    """A publisher with a process of outlets that serves metrics."""
    start = Start(machine="lathe", axis="z", period_s=1.0, metrics=Metrics(listen=f"127.0.0.1:{free_port()}"))
    settings = Publish(mode="router", listen=(endpoint,))
    identity = ServiceIdentity("lathe", "z", "0a0a0a0a")
    publisher = ZenohPublisher(identity, settings, '{"hash":"h"}', LAYOUT, outlets=OutletsProcess(start))
    with closing(publisher):
        publisher.start()
        yield publisher


def test_without_room_for_a_socket_the_reason_says_so_until_there_is(made, sockets, endpoint):
    until(lambda: "make room for temporary files" in (made.status.reason or ""))
    with zenoh.open(session_config("client", (endpoint,), ())) as session:  # queries are answered meanwhile
        (answer,) = session.get(f"{PREFIX}/config", timeout=PATIENCE_S)
    assert answer.ok.payload.to_string() == '{"hash":"h"}'
    sockets.mkdir()
    until(lambda: made.status.reason is None)


def test_a_folder_whose_path_is_too_long_for_a_socket_is_named(made, sockets, monkeypatch):
    folder = sockets / ("long" * 25)
    monkeypatch.setattr(tempfile, "tempdir", str(folder))
    folder.mkdir(parents=True)
    until(lambda: "set TMPDIR to a shorter path" in (made.status.reason or ""))
    assert str(folder) in made.status.reason


def test_only_this_user_reaches_the_socket_and_it_takes_one_kind_of_command(made, sockets):
    sockets.mkdir()
    (socket,) = until(lambda: list(sockets.glob("observer-*/bus")))
    assert stat.S_IMODE(socket.parent.stat().st_mode) == 0o700
    with zenoh.open(session_config("client", (f"{LOCAL}/{socket}",), ())) as session:
        asked = {kind: f"{PREFIX}/command/{kind}?config=wrong" for kind in ("acknowledge", "arm", "disarm")}
        answers = {kind: list(session.get(key, timeout=PATIENCE_S)) for kind, key in asked.items()}
    (refusal,) = answers.pop("acknowledge")
    assert "not in force" in refusal.err.payload.to_string()
    assert answers == {"arm": [], "disarm": []}


def test_a_process_that_cannot_be_started_is_tried_again(made, sockets, monkeypatch):
    python = sys.executable
    monkeypatch.setattr(sys, "executable", str(sockets / "python"))
    sockets.mkdir()
    until(lambda: "cannot be started" in (made.status.reason or ""))
    monkeypatch.setattr(sys, "executable", python)
    until(lambda: made.status.reason is None)


def test_a_frozen_process_is_killed_and_replaced(made, sockets, monkeypatch):
    monkeypatch.setattr(beside, "_SILENT_LOOKS", 50)
    sockets.mkdir()
    until(lambda: made._outlets._states)
    frozen = made._outlets._child
    os.kill(frozen.pid, signal.SIGSTOP)
    until(lambda: "froze and is restarted" in (made.status.reason or ""))
    assert frozen.wait(PATIENCE_S) == -signal.SIGKILL
    until(lambda: made._outlets._states and made.status.reason is None)
    assert made._outlets._child.pid != frozen.pid


def test_a_signal_to_every_process_of_the_service_leaves_the_end_to_the_service(made, sockets):
    sockets.mkdir()
    until(lambda: made._outlets._states)
    child = made._outlets._child
    for number in (signal.SIGTERM, signal.SIGINT, signal.SIGHUP):
        os.kill(child.pid, number)
    made.close(PATIENCE_S)
    assert child.wait(PATIENCE_S) == 0
    assert list(sockets.iterdir()) == []


def test_what_is_no_report_changes_nothing():
    process = OutletsProcess(Start(machine="lathe", axis="z", period_s=1.0))
    process.take(b'{"mqtt": {"reason": "mqtt: no broker", "unsent": {"steps": 3, "duration_s": 3.0}}}')
    for wrong in (b"", b"[]", b'{"page": 1}', b'{"page": {"reasons": "x"}}', NAN):
        process.take(wrong)
    assert process.reason == "mqtt: no broker"
    assert process.unsent == {"mqtt": {"steps": 3.0, "duration_s": 3.0}}
    process.take(b'{"mqtt": {"address": "127.0.0.1:1883"}}')
    assert process.reason is None
    assert process.unsent == {}
