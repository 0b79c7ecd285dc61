"""`make soak`: the service against the simulated machine, ten times as fast as the demo.

All the time something happens: sensors break and heal, the bus falls silent, clients come, ask and go, files
of the recording fill up and are removed, the configuration is read again. What is watched is to be flat:
memory, threads, descriptors, and how late estimates arrive.
"""

from __future__ import annotations

import argparse
import json
import os
import random
import signal
import sys
import tempfile
import threading
import time
from pathlib import Path
from typing import Any

import numpy as np
import tomlkit
import zenoh

from campaigns.soak.flat import Trend, trend
from observer.bus.codec import decode_estimate
from observer.bus.session import session_config
from tests.bus.router import free_port
from tests.patience import until
from tests.system.plant import PREFIX, Daemon, Machine, machine, table_for

PERIOD_S = 0.05
FAULTS: list[dict[str, Any]] = [
    {"open": "t3_degC"},
    {"silence_can": True},
    {"open": ["t1_degC", "t2_degC"]},
]
SAMPLE_S = 5.0
SETTLE_S = 300.0
"""Until it keeps as many estimates as it ever will; in a short soak, half of the time."""
# Of 3600 clients and 20 reloads in an hour; without any the memory does not grow at all.
LIMITS_1_H = {"memory, MB": 12.0, "threads": 1.0, "descriptors": 2.0, "latency p50, ms": 2.0}


class Latency:
    """How late estimates arrive at a subscriber, ms."""

    def __init__(self, endpoint: str) -> None:
        self._endpoint = endpoint
        self._lock = threading.Lock()
        self._late_ms: list[float] = []

    def __enter__(self) -> Latency:
        self._session = zenoh.open(session_config("client", (self._endpoint,), ()))
        self._subscriber = self._session.declare_subscriber(f"{PREFIX}/estimate", self._take)
        return self

    def __exit__(self, *_: object) -> None:
        self._subscriber.undeclare()
        self._session.close()

    def _take(self, sample: zenoh.Sample) -> None:
        late_ms = 1000.0 * (time.time() - decode_estimate(sample.payload.to_bytes())["time_s"])
        with self._lock:
            self._late_ms.append(late_ms)

    def taken(self) -> list[float]:
        """Those since the last call."""
        with self._lock:
            taken, self._late_ms = self._late_ms, []
        return taken


def main() -> None:
    """Soak, print the report, and leave with 1 if something grows."""
    parser = argparse.ArgumentParser(prog="python -m campaigns.soak", description=__doc__)
    parser.add_argument("--minutes", type=float, default=60.0, help="how long (60)")
    parser.add_argument("--output", type=Path, default=Path("build/soak"), help="folder of the report")
    options = parser.parse_args()
    options.output.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(prefix="soak-") as folder:
        samples, events, said = soak(Path(folder), 60.0 * options.minutes)
    trends = trends_of(samples)
    lines = [
        f"soak of {options.minutes:g} minutes at {1 / PERIOD_S:g} Hz: {sum(s['estimates'] for s in samples)} "
        f"estimates, {', '.join(f'{n} {what}' for what, n in sorted(events.items()))}",
        *map(str, trends),
        f"latency p99 {np.median([s['p99_ms'] for s in samples]):.1f} ms; "
        f"tracebacks in what it says: {said.count('Traceback')}",
    ]
    text = "\n".join(lines)
    print(text)
    (options.output / "report.txt").write_text(text + "\n", encoding="utf-8")
    (options.output / "samples.json").write_text(json.dumps(samples, indent=1) + "\n", encoding="utf-8")
    (options.output / "service.log").write_text(said, encoding="utf-8")
    sys.stdout.flush()
    os._exit(0 if all(t.flat for t in trends) and "Traceback" not in said else 1)


def soak(folder: Path, seconds: float) -> tuple[list[dict[str, float]], dict[str, int], str]:
    """Run it all; returns the samples, how often what happened, and what the service said."""
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    with machine() as plant, Daemon(folder, _table(plant, endpoint)) as daemon:
        _busy_recording(daemon.config)
        until(lambda: any(daemon.recordings.glob("*.csv")), 300.0)
        until(lambda: _ask(endpoint, "health"), 300.0)
        with Latency(endpoint) as latency:
            until(latency.taken, 300.0)
            os.kill(daemon.process.pid, signal.SIGHUP)  # takes the recording's keys over
            samples, events = _watch(plant, daemon, endpoint, latency, seconds)
        daemon.stop()
        return samples, events, daemon.said()


def _watch(
    plant: Machine, daemon: Daemon, endpoint: str, latency: Latency, seconds: float
) -> tuple[list[dict[str, float]], dict[str, int]]:
    """Let things happen, and take a sample every few seconds."""
    rng, samples, events = random.Random(1), [], dict.fromkeys(("faults", "clients", "reloads"), 0)
    begun_s = time.monotonic()
    for k in range(1, 1 + round(seconds / SAMPLE_S)):
        while (left_s := begun_s + k * SAMPLE_S - time.monotonic()) > 0.0:
            time.sleep(min(left_s, 1.0))
            events["clients"] += _ask(endpoint, rng.choice(["config", "health", "estimate?last=100"]))
        if k % 4 == 0:
            events["faults"] += 1
            plant.fault(**rng.choice(FAULTS))
        elif k % 4 == 1:
            plant.fault()
        if k % 36 == 0:
            events["reloads"] += 1
            os.kill(daemon.process.pid, signal.SIGHUP)
        late_ms = latency.taken()
        samples.append(_sample(daemon.process.pid, time.monotonic() - begun_s, late_ms))
        assert daemon.process.poll() is None, daemon.said()[-2000:]
    plant.fault()
    return samples, events


def _sample(pid: int, time_s: float, late_ms: list[float]) -> dict[str, float]:
    status = dict(line.split(":", 1) for line in Path(f"/proc/{pid}/status").read_text().splitlines())
    p50, p99 = np.percentile(late_ms or [np.nan], [50, 99])
    return {
        "time_s": time_s,
        "memory, MB": int(status["VmRSS"].split()[0]) / 1024,
        "threads": int(status["Threads"]),
        "descriptors": len(os.listdir(f"/proc/{pid}/fd")),
        "latency p50, ms": float(p50),
        "p99_ms": float(p99),
        "estimates": len(late_ms),
    }


def trends_of(samples: list[dict[str, float]]) -> list[Trend]:
    """The trends after the first part, in which queues and histories fill."""
    settled_s = min(SETTLE_S, samples[-1]["time_s"] / 2)
    kept = [s for s in samples if s["time_s"] > settled_s and s["estimates"]]
    time_s = [s["time_s"] for s in kept]
    return [trend(name, time_s, [s[name] for s in kept], limit) for name, limit in LIMITS_1_H.items()]


def _ask(endpoint: str, what: str) -> bool:
    """Come, ask, and go; says whether an answer came."""
    try:
        session = zenoh.open(session_config("client", (endpoint,), ()))
    except zenoh.ZError:
        return False
    try:
        return any(reply.ok for reply in session.get(f"{PREFIX}/{what}", timeout=2.0))
    finally:
        session.close()


def _table(plant: Machine, endpoint: str) -> dict[str, Any]:
    table = table_for(plant.wires, mode="router", listen=[endpoint], history=200)
    table["estimator"]["period_s"] = PERIOD_S
    table["drivers"]["thermocouples"]["period_s"] = PERIOD_S
    table["compensation"] = {"enabled": True, "controller_compensates": False, "position_feedback": "motor"}
    return table


def _busy_recording(config: Path) -> None:
    """Have files fill up and go within minutes, and a checkpoint written every second."""
    table = tomlkit.parse(config.read_text(encoding="utf-8"))
    table["record"] |= {"rotate_MB": 0.3, "keep_GB": 0.002}
    table["checkpoint"] = {"period_s": 1.0}
    config.write_text(tomlkit.dumps(table), encoding="utf-8")


if __name__ == "__main__":
    main()
