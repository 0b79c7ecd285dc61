"""Broken connections to a real broker: nothing that was recorded stays missing."""

from __future__ import annotations

import asyncio
import contextlib
import json
import socket
import struct
import threading
from contextlib import suppress

import numpy as np
import pytest
from paho.mqtt.client import Client
from paho.mqtt.enums import CallbackAPIVersion

from observer.outlets import late, mqtt, process
from observer.outlets.messages import Latest
from observer.outlets.start import Start
from observer.publish.codec import EstimateEncoder, config_json, decode_estimate
from observer.tables.outlets import Mqtt
from tests.outlets.feeding import LAYOUT, block
from tests.outlets.test_mqtt import TOPIC, broker, pytestmark  # noqa: F401  (the marks hold here, too)
from tests.patience import PATIENCE_S, eventually
from tests.publish.router import free_port
from tests.steps.lived import configuration, lived

EVERY_S = 0.04
OUTAGE_STEPS = 25


class Wire:
    """A TCP proxy to a broker, which can cut every connection at once."""

    def __init__(self, port: int) -> None:
        self._port, self._pairs = port, list[tuple[socket.socket, socket.socket]]()
        self.is_open = True
        self._door = socket.create_server(("127.0.0.1", 0))
        self.port = self._door.getsockname()[1]
        threading.Thread(target=self._accept, daemon=True).start()

    def _accept(self) -> None:
        with suppress(OSError):
            while True:
                inside, _ = self._door.accept()
                if not self.is_open:
                    inside.close()
                    continue
                outside = socket.create_connection(("127.0.0.1", self._port))
                self._pairs.append((inside, outside))
                for ends in ((inside, outside), (outside, inside)):
                    threading.Thread(target=self._pass_on, args=ends, daemon=True).start()

    def _pass_on(self, source: socket.socket, sink: socket.socket) -> None:
        with suppress(OSError):
            while data := source.recv(65536):
                sink.sendall(data)

    def cut(self) -> None:
        """Reset every connection, whatever is under way."""
        pairs, self._pairs = self._pairs, []
        for end in (end for pair in pairs for end in pair):
            end.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
            with suppress(OSError):
                end.shutdown(socket.SHUT_RDWR)
            end.close()

    def close(self) -> None:
        self._door.close()
        self.cut()


class Plant:
    """A subscriber that is never disconnected: the times of the steps by key, live and late."""

    def __init__(self, port: int) -> None:
        self.live: dict[str, set[float]] = {"estimate": set(), "readings": set()}
        self.late: dict[str, set[float]] = {"estimate": set(), "readings": set()}
        self._client = Client(CallbackAPIVersion.VERSION2)
        self._client.on_connect = lambda client, *_: client.subscribe(f"{TOPIC}/+", 1)
        self._client.on_message = self._take
        self._client.on_subscribe = lambda *_: subscribed.set()
        self._client.reconnect_delay_set(1, 1)
        subscribed = threading.Event()
        self._client.connect_async("127.0.0.1", port)
        self._client.loop_start()
        assert subscribed.wait(PATIENCE_S)

    def _take(self, _client, _data, message) -> None:
        key = message.topic.rsplit("/", 1)[1]
        if key in self.live:
            document = decode_estimate(message.payload) if key == "estimate" else json.loads(message.payload)
            (self.late if document.get("late") else self.live)[key].add(document["time_s"])

    def missing(self, times_s: np.ndarray) -> int:
        """How many steps have not come by any way, from the first to the newest that came live."""
        first_s, last_s = min(self.live["readings"]), max(self.live["estimate"])
        wanted = times_s[(first_s <= times_s) & (times_s <= last_s)].tolist()
        return sum(t not in self.live[key] | self.late[key] for key in self.live for t in wanted)

    def close(self) -> None:
        self._client.disconnect()
        self._client.loop_stop()


async def _feed(latest: Latest, estimates: list[bytes], readings: list[bytes]) -> None:
    """Do as the service does, step by step; what is recorded is on the disk already."""
    for estimate, reading in zip(estimates, readings, strict=True):
        latest.put("estimate", estimate)
        decoded = decode_estimate(estimate)
        latest.put("heat", json.dumps({k: decoded[k] for k in ("time_s", "sequence", "quality")}).encode())
        latest.put("readings", reading)
        await asyncio.sleep(EVERY_S)


@pytest.mark.parametrize("rounds", [2, pytest.param(15, marks=pytest.mark.slow)])
async def test_nothing_is_missing_after_each_broken_connection(rounds, tmp_path, monkeypatch):
    """A round breaks two connections: among live values, and among late ones."""
    monkeypatch.setattr(late, "_SETTLE_S", 0.1)
    monkeypatch.setattr(mqtt, "_RETRY_S", 0.05)
    config = configuration(tmp_path / "recordings")
    named = config.machine.model_copy(update={"name": "lathe", "axis": "z"})
    config = config.model_copy(update={"machine": named})
    estimates, readings, _ = lived(config, 600 + 360 * rounds, rotate_bytes=20_000)
    times_s = np.array([json.loads(reading)["time_s"] for reading in readings])
    port = free_port()
    with (
        broker(tmp_path, port),
        contextlib.closing(Wire(port)) as wire,
        contextlib.closing(Plant(port)) as plant,
    ):
        settings = Mqtt(broker=f"127.0.0.1:{wire.port}", late_every_s=0, late_rate_Hz=1000)
        start = Start(
            machine="lathe", axis="z", period_s=0.5, mqtt=settings, recordings=tmp_path / "recordings"
        )
        latest = Latest(60.0)
        latest.put("config", config_json(config, "00000001").encode())
        outlet = asyncio.create_task(process._supervised("mqtt", start, latest, lambda _: None))
        feeding = asyncio.create_task(_feed(latest, estimates, readings))
        try:
            await eventually(lambda: len(plant.live["readings"]) > 20)
            for _ in range(rounds):
                before = len(plant.late["estimate"])
                wire.is_open = False
                wire.cut()
                wanted = latest.document("readings")["sequence"] + OUTAGE_STEPS
                await eventually(lambda wanted=wanted: latest.document("readings")["sequence"] > wanted)
                wire.is_open = True
                await eventually(lambda before=before: len(plant.late["estimate"]) > before + 5)
                wire.cut()
                newest_s = max(plant.live["estimate"])
                await eventually(lambda newest_s=newest_s: max(plant.live["estimate"]) > newest_s)
                await eventually(lambda: plant.missing(times_s) == 0)
        finally:
            for task in (feeding, outlet):
                task.cancel()
            await asyncio.wait([feeding, outlet])


async def test_a_task_of_an_outlet_that_ends_is_reported_and_restarted(tmp_path, monkeypatch):
    begun: list[str] = []
    reports: list[dict] = []

    async def run(_sender: late.LateSender) -> None:
        begun.append("late")
        if len(begun) == 1:
            raise RuntimeError("the connection dropped")
        await asyncio.Event().wait()

    monkeypatch.setattr(late.LateSender, "run", run)
    settings = Mqtt(broker=f"127.0.0.1:{free_port()}")
    start = Start(machine="lathe", axis="z", period_s=0.5, mqtt=settings, recordings=tmp_path)
    outlet = asyncio.create_task(process._supervised("mqtt", start, Latest(60.0), reports.append))
    try:
        await eventually(lambda: len(begun) == 2)
    finally:
        outlet.cancel()
        await asyncio.wait([outlet])
    assert {"reason": "mqtt: RuntimeError: the connection dropped"} in reports


def test_an_interval_too_short_to_tell_steps_apart_is_refused():
    with pytest.raises(ValueError, match=r"give 0, which is every step, or 0\.001"):
        Mqtt(broker="127.0.0.1:1883", late_every_s=1e-300)


def test_overtaken_steps_are_noticed_also_after_a_restart_of_the_service(tmp_path):
    start = Start(machine="lathe", axis="z", period_s=1.0, mqtt=Mqtt(late_every_s=0.0), recordings=tmp_path)
    sender = late.LateSender(start, Latest(1.0), lambda _: None, lambda *_: None, lambda: True)

    def sent(instance: str, sequence: int, time_s: float) -> None:
        encoder = EstimateEncoder(LAYOUT, instance)
        sender.can_send("estimate", encoder.cbor(block(time_s), 0, sequence))
        sender.note_sent("heat", encoder.heat(block(time_s), 0, sequence))

    sender.connected()
    sent("0a0a0a0a", 900, 10.0)
    sent("0b0b0b0b", 0, 20.0)
    assert sender.backlog.first is None
    sent("0b0b0b0b", 2, 22.0)
    assert sender.backlog.first.keys == ("heat",)
