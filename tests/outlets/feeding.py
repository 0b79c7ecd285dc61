"""A process of outlets, fed over a bus with what a service would publish."""

from __future__ import annotations

import json
import queue
import subprocess
import sys
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Any

import numpy as np
import zenoh

from observer.bus.codec import EstimateEncoder
from observer.bus.session import session_config
from observer.frames import EstimateBlock, Layout
from observer.outlets.start import Start
from tests.bus.router import free_port
from tests.patience import PATIENCE_S, until

LAYOUT = Layout(("nut", "left"), np.array([0.0, 0.5, 1.0]), ("t1", "t2"), True)
QUALITIES = ("good", "starting", "degraded", "stale", "invalid")
ENCODER = EstimateEncoder(LAYOUT, "ab12")
HEALTH: dict[str, Any] = {
    "state": "degraded", "reasons": ["channel t2_degC is missing"], "cycles": 70, "overruns": 2,
    "published": 400, "publish_drops": 3, "recorded": 80, "record_drops": 6, "degraded_sensors": ["t2"],
    "unsent": {"mqtt": {"steps": 12, "duration_s": 12.0}},
    "channels": {"t1_degC": {"quality": "good", "age_s": 0.25, "fault": None}},
    "drivers": {"axis": {"connected": True, "samples": 9, "drops": 0, "errors": 4, "reconnects": 1,
                         "error_frames": 9, "bus_off": 8}},
}  # fmt: skip
ALARM = {
    "id": "sensor_fault.t2.open_circuit", "kind": "sensor_fault", "target": "t2", "severity": "major",
    "state": "unacknowledged", "since_s": 5.0, "reason": "open", "remedy": "look", "evidence": None,
}  # fmt: skip


def block(time_s: float, quality: str = "good") -> EstimateBlock:
    """One estimate in which every number is different."""
    row = np.array
    return EstimateBlock(
        time_s=row([time_s]), heat_W=row([[26.5, 3.25]]), heat_sigma_W=row([[0.5, 0.25]]),
        field_degC=row([[21.0, 25.5, 22.0]]), field_sigma_K=row([[0.1, 0.2, 0.3]]),
        error_um=row([[0.0, 8.0, 12.0]]), error_sigma_um=row([[0.0, 1.0, 2.0]]),
        innovation_K=row([[0.125, np.nan]]), sensor_quality=row([[0, 1]], np.int8),
        quality=row([QUALITIES.index(quality)], np.int8), innovation_sigma_K=row([[0.05, 0.05]]),
        law_W=row([[25.0, 3.0]]), heat_bound_W=row([[2.5, 1.25]]), field_bound_K=row([[0.5, 0.75, 1.5]]),
        error_bound_um=row([[0.0, 4.0, 9.0]]),
    )  # fmt: skip


class OutletsFeed:
    """A bus with estimates and documents for a process of outlets, which hears what it reports of itself."""

    def __init__(self, start: Start, session: zenoh.Session, process: subprocess.Popen[bytes]) -> None:
        self.process, self.acknowledged = process, queue.Queue[dict[str, str]]()
        self._prefix, self._session = start.prefix, session
        self._states: dict[str, Any] = {}
        self._news: queue.Queue[dict[str, Any]] = queue.Queue()
        self._publishers: dict[str, zenoh.Publisher] = {}
        self._kept = [
            session.declare_subscriber(f"{self._prefix}/outlets", self._take),
            session.declare_queryable(f"{self._prefix}/config", self._answer_config),
            session.declare_queryable(f"{self._prefix}/command/acknowledge", self._acknowledge),
        ]

    def _take(self, sample: zenoh.Sample) -> None:
        states = json.loads(sample.payload.to_bytes())
        for name, state in states.items():
            if state != self._states.get(name):
                self._news.put({"outlet": name, **state})
        self._states = states

    def _answer_config(self, query: zenoh.Query) -> None:
        with query:
            query.reply(f"{self._prefix}/config", json.dumps({"hash": "ab", "config": {}}))

    def _acknowledge(self, query: zenoh.Query) -> None:
        with query:
            self.acknowledged.put({name: query.parameters.get(name) for name in ("config", "by", "id")})
            query.reply(f"{self._prefix}/command/acknowledge", json.dumps({"done": True}))

    def wait_until_heard(self) -> None:
        """Wait until the process has subscribed."""
        until(lambda: self._publisher("estimate").matching_status.matching)

    def _publisher(self, key: str) -> zenoh.Publisher:
        if key not in self._publishers:
            block = zenoh.CongestionControl.BLOCK  # no test waits for what was dropped
            name = f"{self._prefix}/{key}"
            self._publishers[key] = self._session.declare_publisher(name, congestion_control=block)
        return self._publishers[key]

    def send(self, key: str, payload: bytes) -> None:
        self._publisher(key).put(payload)

    def document(self, key: str, document: Mapping[str, Any]) -> None:
        self.send(key, json.dumps(document).encode())

    def estimate(self, quality: str = "good", sequence: int = 7, time_s: float | None = None) -> float:
        time_s = time.time() if time_s is None else time_s
        self.send("estimate", ENCODER.cbor(block(time_s, quality), 0, sequence))
        self.send("heat", ENCODER.heat(block(time_s, quality), 0, sequence))
        return time_s

    def said(self) -> dict[str, Any]:
        """The next change of an outlet that it reports."""
        return self._news.get(timeout=PATIENCE_S)


@contextmanager
def fed_outlets(
    period_s: float = 60.0, machine: str = "lathe", stderr: int | None = None, **start: Any
) -> Iterator[OutletsFeed]:
    """Start the process with some outlets; it ends by itself when its input closes."""
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    first = Start(machine=machine, axis="z", period_s=period_s, connect=endpoint, **start)
    command = [sys.executable, "-m", "observer.outlets"]
    with (
        zenoh.open(session_config("peer", (), (endpoint,))) as session,
        subprocess.Popen(command, stdin=subprocess.PIPE, stderr=stderr) as process,
    ):
        feed = OutletsFeed(first, session, process)
        try:
            process.stdin.write(first.model_dump_json().encode() + b"\n")
            process.stdin.flush()
            feed.wait_until_heard()
            yield feed
        finally:
            process.stdin.close()
            assert process.wait(PATIENCE_S) in (0, -9)
            if process.stderr is not None:
                assert process.stderr.read() == b""  # it ends without a word, whoever still looks


def feed_machine(feed: OutletsFeed, quality: str = "good") -> None:
    """Once an outlet serves, send what a machine with an alarm would on every key."""
    assert feed.said()["reason"] is None
    feed.document("health", HEALTH | {"time_s": 1.0})
    feed.document("alarms", {"time_s": 1.0, "alarms": [ALARM], "bands": {}})
    feed.document(
        "learned",
        {
            "time_s": 1.0,
            "quality": "good",
            "parameters": {"surface.convection_W_m2K": {"value": 14.5, "sigma": 0.5}},
        },
    )
    feed.document("forecast", {"time_s": 1.0, "quality": "good", "settled_at_s": 1234.5})
    feed.estimate(quality)
