"""The outlets beside a real daemon: killed, frozen, gone with the daemon, and started by hand."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import urllib.error
import urllib.request
from contextlib import ExitStack
from pathlib import Path

import pytest
import zenoh

from observer.bus.session import session_config
from tests.bus.router import free_port
from tests.outlets.test_mqtt import MOSQUITTO, Listener, broker
from tests.patience import until
from tests.system.plant import PREFIX, ROOT, START_S, Daemon, Subscriber, children_of, machine, table_for

pytestmark = pytest.mark.system
_KEYS = {"estimate", "heat", "field", "readings", "health"}
STOP_S = 2.0  # what a stop may take


@pytest.fixture
def sockets(tmp_path, monkeypatch):
    """The folder in which a daemon makes the socket of its outlets."""
    folder = tmp_path / "sockets"
    folder.mkdir()
    monkeypatch.setenv("TMPDIR", str(folder))
    return folder


def _outlets(pid: int) -> list[int]:
    return [child for child in children_of(pid) if b"observer.outlets" in _command(child)]


def _command(pid: int) -> bytes:
    """How a process was called; nothing once it has ended."""
    try:
        return Path(f"/proc/{pid}/cmdline").read_bytes()
    except OSError:
        return b""


def _session(endpoint: str) -> zenoh.Session | None:
    """A client's session, None while nobody listens."""
    try:
        return zenoh.open(session_config("client", (endpoint,), ()))
    except zenoh.ZError:
        return None


def _cycles(listen: str) -> float | None:
    """The count of steps in a scrape, None where nobody answers or nothing has been published yet."""
    try:
        with urllib.request.urlopen(f"http://{listen}/metrics", timeout=10.0) as reply:
            text = reply.read().decode()
    except OSError:
        return None
    found = [line for line in text.splitlines() if line.startswith("ballscrew_cycles_total")]
    return float(found[0].rsplit(" ", 1)[1]) if found else None


def test_killed_and_frozen_outlets_are_replaced_and_hold_up_nothing(tmp_path, sockets):
    endpoint, listen = f"tcp/127.0.0.1:{free_port()}", f"127.0.0.1:{free_port()}"
    with machine() as devices:
        table = table_for(devices.wires, listen=[endpoint]) | {"metrics": {"listen": listen}}
        with Daemon(tmp_path, table) as daemon, Subscriber(endpoint) as seen:
            until(
                lambda: _cycles(listen), START_S
            )  # steps of whatever quality: a good one takes half a minute
            (first,) = _outlets(daemon.process.pid)
            os.kill(first, signal.SIGKILL)
            (second,) = until(lambda: [pid for pid in _outlets(daemon.process.pid) if pid != first])
            until(lambda: _cycles(listen))
            reported = [reason for document in seen.documents["health"] for reason in document["reasons"]]
            assert any("outlets:" in reason for reason in reported)
            until(lambda: not any("outlets:" in reason for reason in seen.health()["reasons"]))

            os.kill(second, signal.SIGSTOP)
            (third,) = until(lambda: [pid for pid in _outlets(daemon.process.pid) if pid != second])
            until(lambda: (_cycles(listen) or 0.0) >= seen.health()["cycles"])
            reported = [reason for document in seen.documents["health"] for reason in document["reasons"]]
            assert any("froze and is restarted" in reason for reason in reported)

            os.kill(third, signal.SIGSTOP)
            assert daemon.stop() <= STOP_S
            assert not list(sockets.iterdir())
            until(lambda: not _command(third))
            daemon.assert_no_tick_is_missing()


@pytest.mark.skipif(not Path(MOSQUITTO).exists(), reason="needs Debian's package mosquitto")
def test_messages_are_zenohs_to_the_byte_and_they_end_with_a_daemon_that_is_killed(tmp_path, sockets):
    endpoint, port = f"tcp/127.0.0.1:{free_port()}", free_port()
    zenohs: dict[str, list[bytes]] = {}
    mqtts: dict[str, set[bytes]] = {}

    def take(sample: zenoh.Sample) -> None:
        key = str(sample.key_expr).removeprefix(f"{PREFIX}/")
        zenohs.setdefault(key, []).append(sample.payload.to_bytes())

    with machine() as devices, broker(tmp_path, port), Listener(port) as plant:
        table = table_for(devices.wires, listen=[endpoint]) | {"mqtt": {"broker": f"127.0.0.1:{port}"}}
        with Daemon(tmp_path, table) as daemon:
            with until(lambda: _session(endpoint), START_S) as session:
                session.declare_subscriber(f"{PREFIX}/**", take)

                def enough(key: str) -> bool:
                    """Whoever is behind gets the newest only, and either may have begun later."""
                    reported = set(zenohs.get(key, ()))
                    return len(reported & mqtts.get(key, set())) >= max(1, len(reported) / 2)

                def came() -> bool:
                    while not plant.order.empty():
                        topic, payload = plant.order.get()
                        mqtts.setdefault(topic.removeprefix(f"{PREFIX}/"), set()).add(payload)
                    return len(mqtts.get("estimate", ())) > 20 and all(enough(key) for key in _KEYS)

                until(came, START_S)
            assert json.loads(next(iter(mqtts["config"])))["config"]["machine"]["name"] == "demo"
            (outlets,) = _outlets(daemon.process.pid)
            assert list(sockets.iterdir())
            daemon.process.kill()
            until(lambda: not _command(outlets))
            assert not list(sockets.iterdir())
            until(lambda: plant.newest.get(f"{PREFIX}/alive") == b"false")


def _answer(listen: str, alarm: str) -> tuple[int, str]:
    """What the page answers to somebody who acknowledges an alarm."""
    request = urllib.request.Request(
        f"http://{listen}/acknowledge", f"id={alarm}".encode(), {"Origin": f"http://{listen}"}
    )
    try:
        with urllib.request.urlopen(request, timeout=10.0) as reply:
            return reply.status, reply.read().decode()
    except urllib.error.HTTPError as error:
        return error.code, error.read().decode()
    except OSError:  # not there yet
        return 0, ""


@pytest.mark.parametrize("starts", [True, False])
def test_outlets_of_the_service_and_those_started_by_hand_serve_the_same(tmp_path, starts):
    endpoint, listen, page = f"tcp/127.0.0.1:{free_port()}", *(f"127.0.0.1:{free_port()}" for _ in range(2))
    with machine() as devices:
        table = table_for(devices.wires, listen=[endpoint])
        table |= {"metrics": {"listen": listen}, "page": {"listen": page}, "outlets": {"start": starts}}
        with Daemon(tmp_path, table) as daemon, Subscriber(endpoint) as seen, ExitStack() as stack:
            until(lambda: seen.estimates, START_S)
            if not starts:
                assert not _outlets(daemon.process.pid)
                command = [sys.executable, "-m", "observer", "outlets", "--config", str(daemon.config)]
                by_hand = stack.enter_context(subprocess.Popen(command, cwd=ROOT))
            until(lambda: (_cycles(listen) or 0.0) > 0.0, START_S)
            _, words = until(lambda: (answer := _answer(page, "none"))[0] == 502 and answer)
            assert words == "there is no alarm none; there are: none\n"
            until(lambda: "health" in seen.documents, START_S)
            reasons = [reason for document in seen.documents["health"] for reason in document["reasons"]]
            assert not any("another service runs" in reason for reason in reasons)
            if not starts:
                by_hand.send_signal(signal.SIGINT)
                assert by_hand.wait(START_S) == 0
