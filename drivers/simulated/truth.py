"""Publishes the true heats on Zenoh, beside which the estimates can be laid."""

from __future__ import annotations

import json
import threading
import time
from dataclasses import asdict

import zenoh

from drivers.simulated.machine import Heats

RETRY_S = 0.25


class TruthPublisher:
    """A publisher with a session of its own, opened as soon as there is a router; only the newest goes out.

    Everything that can block is in a daemon thread, so the machine neither waits for a router nor for the
    end of a session with a router that no longer answers.
    """

    def __init__(self, endpoint: str, key: str) -> None:
        self._endpoint = endpoint
        self._key = key
        self._next: str | None = None
        self._wake = threading.Event()
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._live, name="truth", daemon=True)
        self._thread.start()

    def put(self, true: Heats, sequence: int) -> None:
        """Publish these heats, with the time of now."""
        self._next = json.dumps(
            {
                "time_s": time.time(),
                "sequence": sequence,
                "sources": {
                    key.removesuffix("_W"): {"heat_W": heat_W, "sigma_W": 0.0}
                    for key, heat_W in asdict(true).items()
                },
                "quality": "good",
            }
        )
        self._wake.set()

    def close(self) -> None:
        """End the session, without waiting long for it."""
        self._stop.set()
        self._wake.set()
        self._thread.join(timeout=1.0)

    def _live(self) -> None:
        config = zenoh.Config()
        config.insert_json5("mode", '"client"')
        config.insert_json5("connect/endpoints", json.dumps([self._endpoint]))
        config.insert_json5("scouting/multicast/enabled", "false")
        session = None
        while session is None and not self._stop.is_set():
            try:
                session = zenoh.open(config)
            except zenoh.ZError:
                self._stop.wait(RETRY_S)
        if session is None:
            return
        with session:
            publisher = session.declare_publisher(
                self._key,
                encoding=zenoh.Encoding.APPLICATION_JSON,
                congestion_control=zenoh.CongestionControl.DROP,
            )
            while not self._stop.is_set():
                self._wake.wait()
                self._wake.clear()
                if self._next is not None and not self._stop.is_set():
                    publisher.put(self._next)
