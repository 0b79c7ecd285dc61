"""A gateway's process, fed with what a service would send it."""

from __future__ import annotations

import json
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np

from observer.frames import EstimateBlock, Layout
from observer.gateway.start import Start
from observer.process.pipes import framed
from observer.publish.codec import EstimateEncoder
from tests.patience import PATIENCE_S

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


class GatewayFeed:
    """Sends estimates and documents to a gateway's process and reads what it reports."""

    def __init__(self, process: subprocess.Popen[bytes]) -> None:
        self.process = process

    def send(self, key: str, payload: bytes) -> None:
        self.process.stdin.write(framed(key, payload))
        self.process.stdin.flush()

    def document(self, key: str, document: dict[str, Any]) -> None:
        self.send(key, json.dumps(document).encode())

    def estimate(self, quality: str = "good", sequence: int = 7, time_s: float | None = None) -> float:
        time_s = time.time() if time_s is None else time_s
        self.send("estimate", ENCODER.cbor(block(time_s, quality), 0, sequence))
        self.send("heat", ENCODER.heat(block(time_s, quality), 0, sequence))
        return time_s

    def said(self) -> dict[str, Any]:
        """The next line that it reports."""
        return json.loads(self.process.stdout.readline())


@contextmanager
def fed_gateway(period_s: float = 60.0, **outlets: Any) -> Iterator[GatewayFeed]:
    """Start the process with some outlets; it ends by itself when its input closes."""
    start = Start(machine="lathe", axis="z", period_s=period_s, **outlets)
    command = [sys.executable, "-m", "observer.gateway"]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as process:
        feed = GatewayFeed(process)
        try:
            feed.send("start", start.model_dump_json().encode())
            yield feed
        finally:
            process.stdin.close()
            assert process.wait(PATIENCE_S) in (0, -9)


def feed_machine(feed: GatewayFeed, quality: str = "good") -> None:
    """Once the gateway is up, send what a machine with an alarm would on every key."""
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
