"""A broker that is killed and comes back: the plant has every step, in order, and no live one waits.

Nor does it matter that the service is killed meanwhile.
"""

from __future__ import annotations

import itertools
import json
import shutil
import socket
import subprocess
import threading
from collections.abc import Callable
from contextlib import closing, suppress
from pathlib import Path

import pytest
from paho.mqtt.client import Client
from paho.mqtt.enums import CallbackAPIVersion

from observer.bus.codec import decode_estimate
from tests.bus.router import free_port
from tests.patience import PATIENCE_S, until
from tests.system.plant import PREFIX, Daemon, Subscriber, machine, table_for

MOSQUITTO = shutil.which("mosquitto") or "/usr/sbin/mosquitto"
pytestmark = pytest.mark.system
needs_broker = pytest.mark.skipif(not Path(MOSQUITTO).exists(), reason="needs Debian's package mosquitto")
OUTAGE_STEPS = 30
MOST_UNRECORDED_S = 1.0
"""A recorder hands its rows to the system every 0.2 s; a busy computer may delay that."""


class Broker:
    """A broker of MQTT that can be killed and started again; the service reaches it at `door`.

    The door opens once the plant is back: MQTT does not repeat what a subscriber has missed.
    """

    def __init__(self, folder: Path) -> None:
        self.port = free_port()
        self._file = folder / "mosquitto.conf"
        self._file.write_text(f"listener {self.port} 127.0.0.1\nuser root\nallow_anonymous true\n")
        self._door = socket.create_server(("127.0.0.1", 0))
        self.door = self._door.getsockname()[1]
        self.is_open = False
        self._ends: list[socket.socket] = []
        threading.Thread(target=self._let_in, daemon=True).start()

    def start(self) -> None:
        self._process = subprocess.Popen(
            [MOSQUITTO, "-c", str(self._file)], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
        )

    def kill(self) -> None:
        self.is_open = False
        self._process.kill()
        self._process.wait(PATIENCE_S)

    def cut(self) -> None:
        """End the connections of the service, those of the plant last."""
        self.is_open = False
        for end in self._ends:
            with suppress(OSError):
                end.shutdown(socket.SHUT_RDWR)

    def close(self) -> None:
        self._door.close()

    def _let_in(self) -> None:
        with suppress(OSError):
            while True:
                inside, _ = self._door.accept()
                try:
                    if not self.is_open:
                        raise ConnectionRefusedError
                    outside = socket.create_connection(("127.0.0.1", self.port))
                except OSError:
                    inside.close()
                    continue
                self._ends = [inside, outside]
                for one, other in ((inside, outside), (outside, inside)):
                    threading.Thread(target=_pass_on, args=(one, other), daemon=True).start()


def _pass_on(source: socket.socket, sink: socket.socket) -> None:
    """Pass on what comes until either side ends."""
    with suppress(OSError), source, sink:
        while data := source.recv(65536):
            sink.sendall(data)
        sink.shutdown(socket.SHUT_RDWR)


class Plant:
    """What a plant keeps: every message of the steps, in the order of arrival."""

    def __init__(self, port: int) -> None:
        self.got: list[tuple[str, dict]] = []
        self.is_there = False
        self._client = Client(CallbackAPIVersion.VERSION2)
        self._client.on_connect = lambda client, *_: client.subscribe(f"{PREFIX}/#", 1)
        self._client.on_subscribe = lambda *_: setattr(self, "is_there", True)
        self._client.on_disconnect = lambda *_: setattr(self, "is_there", False)
        self._client.on_message = self._take
        self._client.reconnect_delay_set(1, 1)
        self._client.connect_async("127.0.0.1", port)
        self._client.loop_start()

    def _take(self, _client, _data, message) -> None:
        key = message.topic.removeprefix(f"{PREFIX}/")
        if key == "estimate":
            self.got.append((key, decode_estimate(message.payload)))
        elif key in {"heat", "readings"}:
            self.got.append((key, json.loads(message.payload)))

    def times_s(self, key: str, late: Callable[[dict], bool] = lambda _: True) -> list[float]:
        return [d["time_s"] for k, d in self.got if k == key and late(d)]

    def __enter__(self) -> Plant:
        return self

    def __exit__(self, *_) -> None:
        self._client.disconnect()
        self._client.loop_stop()


def _late(document: dict) -> bool:
    return document.get("late", False)


def _live(document: dict) -> bool:
    return not _late(document)


def _assert_whole(plant: Plant, daemon: Daemon, outages: int) -> None:
    """Every step that was recorded since the first that came is there, and late ones are in order.

    It is there once, but for one that arrived when the broker died before it could acknowledge it.
    """
    for key in ("heat", "estimate", "readings"):
        times_s = plant.times_s(key)
        wanted = [t for t in daemon.ticks_s() if min(times_s) <= t <= max(times_s)]
        assert set(times_s) >= set(wanted), key
        assert len(times_s) - len(set(times_s)) <= outages
        unrecorded = set(times_s) - set(wanted)  # the killed service had published them, and not yet recorded
        assert not unrecorded or max(unrecorded) - min(unrecorded) < MOST_UNRECORDED_S
        for kind in (plant.times_s(key, _late), plant.times_s(key, _live)):
            assert all(a <= b for a, b in itertools.pairwise(kind))


def _back(broker: Broker, plant: Plant) -> None:
    """Start the broker, and let the service in once the plant is there."""
    broker.start()
    until(lambda: plant.is_there)
    broker.is_open = True


def _mqtt(broker: Broker, wires: dict, late_rate_Hz: float = 1000.0) -> dict:
    settings = {"broker": f"127.0.0.1:{broker.door}", "late_every_s": 0, "late_rate_Hz": late_rate_Hz}
    return table_for(wires, listen=[f"tcp/127.0.0.1:{free_port()}"]) | {"mqtt": settings}


def _wait_for_steps(daemon: Daemon, count: int = OUTAGE_STEPS) -> None:
    """Wait until so many more steps are recorded."""
    before = len(daemon.ticks_s())
    until(lambda: len(daemon.ticks_s()) > before + count, pause_s=0.1)


def _wait_until_whole(plant: Plant, daemon: Daemon) -> None:
    """Wait until live steps come again, and all before them have come."""
    begin_s = daemon.ticks_s()[-1]
    until(lambda: plant.times_s("heat", _live)[-1] > begin_s)
    end_s = plant.times_s("heat", _live)[-1]

    def whole() -> bool:
        times_s = set(plant.times_s("heat"))
        return bool(times_s) and all(t in times_s for t in daemon.ticks_s() if min(times_s) <= t <= end_s)

    until(whole, pause_s=0.2)
    # a busy computer may have lost the connection once more meanwhile
    until(lambda: not _missing(daemon), pause_s=0.2)


def _unsent(seen: Subscriber) -> int:
    """The steps that health counts as not sent yet."""
    return int(seen.health()["unsent"]["mqtt"]["steps"])


def _missing(daemon: Daemon) -> list[list[float]]:
    """The spans that the service still has to send."""
    (kept,) = daemon.recordings.glob("*.mqtt-sent")
    return json.loads(kept.read_bytes())["missing"]


@needs_broker
def test_a_broker_that_was_killed_gets_every_step_beside_the_live_ones(tmp_path):
    """The first outage has another one within its late steps, which come slowly here."""
    broker = Broker(tmp_path)
    with (
        closing(broker),
        machine() as wires,
        Daemon(tmp_path, table := _mqtt(broker, wires.wires, 20.0)) as daemon,
        Subscriber(table["publish"]["listen"][0]) as seen,
        Plant(broker.port) as plant,
    ):
        _back(broker, plant)
        until(lambda: len(plant.times_s("heat")) > 20)
        for outage in range(2):
            broker.kill()
            _wait_for_steps(daemon)
            if outage == 0:
                until(lambda: _unsent(seen) >= OUTAGE_STEPS // 2, pause_s=0.2)
            _back(broker, plant)
            if outage == 0:
                until(lambda: len(plant.times_s("heat", _late)) > 5)
                assert _missing(daemon), "the late steps have come already"
                broker.cut()
                _wait_for_steps(daemon)
                broker.is_open = True
            _wait_until_whole(plant, daemon)
        until(lambda: _unsent(seen) == 0, pause_s=0.2)
        kinds = [_late(d) for k, d in plant.got if k == "heat"]
        begin = kinds.index(True)
        assert False in kinds[begin : begin + OUTAGE_STEPS]  # live ones among them
        daemon.stop()
        broker.kill()
        _assert_whole(plant, daemon, 3)


@needs_broker
def test_a_service_that_was_killed_during_the_outage_sends_what_was_missed_before_and_after(tmp_path):
    broker = Broker(tmp_path)
    with closing(broker), machine() as wires, Plant(broker.port) as plant:
        table = _mqtt(broker, wires.wires)
        with Daemon(tmp_path, table) as daemon:
            _back(broker, plant)
            until(lambda: len(plant.times_s("heat")) > 20)
            broker.kill()
            _wait_for_steps(daemon)
            daemon.process.kill()
            daemon.process.wait(PATIENCE_S)
        with Daemon(tmp_path, table) as daemon:
            _wait_for_steps(daemon)
            _back(broker, plant)
            _wait_until_whole(plant, daemon)
            daemon.stop()
            broker.kill()
            _assert_whole(plant, daemon, 1)
        assert len({d["instance"] for k, d in plant.got if k == "heat" and _late(d)}) == 2
