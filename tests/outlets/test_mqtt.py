"""MQTT with a real broker: state for those who come late, the last will, a broker that goes and returns."""

from __future__ import annotations

import json
import queue
import shutil
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from paho.mqtt.client import Client
from paho.mqtt.enums import CallbackAPIVersion

from observer.config.outlets import Mqtt
from tests.bus.people import Authority
from tests.bus.router import free_port
from tests.outlets.feeding import HEALTH, fed_outlets
from tests.patience import PATIENCE_S, until

MOSQUITTO = shutil.which("mosquitto") or "/usr/sbin/mosquitto"
pytestmark = [
    pytest.mark.system,
    pytest.mark.skipif(not Path(MOSQUITTO).exists(), reason="needs Debian's package mosquitto"),
]
TOPIC = "ballscrew/lathe/z"


@contextmanager
def broker(folder: Path, port: int, *more: str) -> Iterator[None]:
    """A broker on loopback."""
    file = folder / "mosquitto.conf"
    file.write_text(
        "\n".join([f"listener {port} 127.0.0.1", "user root", *(more or ["allow_anonymous true"]), ""])
    )
    process = subprocess.Popen(
        [MOSQUITTO, "-c", str(file)], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
    )
    try:
        yield
    finally:
        process.terminate()
        process.wait(PATIENCE_S)


class Listener:
    """Keeps the newest message of every topic."""

    def __init__(self, port: int) -> None:
        self.newest: dict[str, bytes] = {}
        self.retained: set[str] = set()
        self.order: queue.Queue[tuple[str, bytes]] = queue.Queue()
        self._client = Client(CallbackAPIVersion.VERSION2)
        self._client.on_connect = lambda client, *_: client.subscribe("ballscrew/#", 1)
        self._client.on_message = self._take
        self._client.reconnect_delay_set(1, 1)
        self._client.connect_async("127.0.0.1", port)
        self._client.loop_start()

    def _take(self, _client, _data, message) -> None:
        topic = message.topic.removeprefix(f"{TOPIC}/")
        self.newest[topic] = message.payload
        self.order.put((topic, message.payload))
        if message.retain:
            self.retained.add(topic)

    def __enter__(self) -> Listener:
        return self

    def __exit__(self, *_) -> None:
        self._client.disconnect()
        self._client.loop_stop()


def test_state_is_retained_for_who_comes_late_and_figures_are_not(tmp_path):
    port = free_port()
    with broker(tmp_path, port), fed_outlets(mqtt=Mqtt(broker=f"127.0.0.1:{port}")) as feed:
        until(lambda: feed.said()["reason"] is None)
        health = HEALTH | {"time_s": 1.0}
        feed.document("health", health)
        with Listener(port) as early:
            until(lambda: "alive" in early.newest)
            feed.estimate()
            until(lambda: {"heat", "quality"} <= early.newest.keys())
        with Listener(port) as late:
            until(lambda: {"health", "alive", "quality"} <= late.newest.keys())
            assert json.loads(late.newest["health"]) == health
            assert late.newest["alive"] == b"true"
            assert "heat" not in late.newest
            assert late.retained == {"health", "alive", "quality"}


@pytest.mark.parametrize("how", ["killed", "ended"])
def test_an_outlet_that_is_gone_is_not_alive(tmp_path, how):
    port = free_port()
    with broker(tmp_path, port), Listener(port) as seen:
        with fed_outlets(mqtt=Mqtt(broker=f"127.0.0.1:{port}")) as feed:
            until(lambda: seen.newest.get("alive") == b"true")
            if how == "killed":
                feed.process.kill()
        until(lambda: seen.newest["alive"] == b"false")


def test_a_lost_broker_is_reported_and_reconnected(tmp_path):
    port = free_port()
    with fed_outlets(mqtt=Mqtt(broker=f"127.0.0.1:{port}")) as feed:
        feed.document("health", HEALTH | {"time_s": 1.0})
        assert "no broker answers" in feed.said()["reason"]
        for _ in range(2):
            with broker(tmp_path, port), Listener(port) as seen:
                until(lambda: seen.newest.get("alive") == b"true" and "health" in seen.newest)
            until(lambda: "no broker answers" in (feed.said()["reason"] or ""))


def test_a_wrong_password_is_reported(tmp_path):
    port, word = free_port(), tmp_path / "word"
    word.write_text("wrong\n")
    users = tmp_path / "users"
    users.touch(mode=0o700)
    settings = Mqtt(broker=f"127.0.0.1:{port}", user="anna", password_file=word)
    strict = broker(tmp_path, port, "allow_anonymous false", f"password_file {users}")
    with strict, fed_outlets(mqtt=settings) as feed:
        until(lambda: "refuses" in (feed.said()["reason"] or ""))


@pytest.mark.parametrize("signed_by", ["plant", "another"])
def test_a_certificate_is_trusted_or_reported_as_not_trusted(tmp_path, signed_by):
    port, ours, another = free_port(), Authority(tmp_path), Authority(tmp_path, "another")
    issued = {"plant": ours, "another": another}[signed_by].sign("broker")
    more = ("allow_anonymous true", f"certfile {issued['certificate']}", f"keyfile {issued['key']}")
    settings = Mqtt(broker=f"127.0.0.1:{port}", ca=ours.ca)
    with broker(tmp_path, port, *more), fed_outlets(mqtt=settings) as feed:
        if signed_by == "plant":
            until(lambda: feed.said()["reason"] is None)
        else:
            until(lambda: "is not trusted" in feed.said()["reason"])
