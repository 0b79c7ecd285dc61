"""Many simulated axes through one Zenoh router: is each of them heard, and do all go on?

    python -m campaigns.fleet.axes --axes 50 --seconds 60

Each axis plays a log that the program has simulated, as if it were live, and is a process of its own.
"""

from __future__ import annotations

import argparse
import json
import os
import signal
import subprocess
import sys
import tempfile
import time
import tomllib
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

import tomlkit
import zenoh

from observer.bus.session import session_config
from tests.bus.router import Router
from tests.logs.machines import configuration
from tests.logs.simulated import written_log
from tests.patience import PATIENCE_S, computed_s, until

PERIOD_S = 0.5


def axes_of(folder: Path, count: int, endpoint: str, rows: int = 4000) -> list[Path]:
    """Configurations of axes that play a simulated log and are clients of a router."""
    found = []
    whole = configuration(folder, 0, "whole")
    log = written_log(whole, folder / "log" / "run.parquet", rows, PERIOD_S)
    for number in range(count):
        path = configuration(folder, 0, f"m{number:02}")
        table = tomllib.loads(path.read_text(encoding="utf-8"))
        table["estimator"] = {"period_s": PERIOD_S}
        table["drivers"] = {"log": {"kind": "player", "path": str(log)}}
        table["publish"] = {"mode": "client", "connect": [endpoint]}
        path.write_text(tomlkit.dumps(table), encoding="utf-8")
        found.append(path)
    return found


@dataclass
class Heard:
    """How often each machine was heard, and in which quality last; how many of its messages went missing."""

    count: dict[str, int] = field(default_factory=dict)
    quality: dict[str, str] = field(default_factory=dict)
    sequence: dict[str, int] = field(default_factory=dict)
    lost: int = 0

    def take(self, sample: zenoh.Sample) -> None:
        """Take a message about heats."""
        machine = str(sample.key_expr).split("/")[1]
        document = json.loads(sample.payload.to_bytes())
        self.count[machine] = self.count.get(machine, 0) + 1
        self.quality[machine] = document["quality"]
        before = self.sequence.get(machine)
        self.lost += 0 if before is None else max(0, document["sequence"] - before - 1)
        self.sequence[machine] = document["sequence"]


@contextmanager
def listening_at(endpoint: str) -> Iterator[Heard]:
    """Hear the heats of every machine through the router."""
    heard = Heard()
    with zenoh.open(session_config("client", (endpoint,), ())) as session:
        subscriber = session.declare_subscriber("ballscrew/*/*/heat", heard.take)
        yield heard
        subscriber.undeclare()


@contextmanager
def served(configs: list[Path], folder: Path, heard: Heard) -> Iterator[dict[str, subprocess.Popen[bytes]]]:
    """`observer run` for each configuration; as many start at a time as there are cores."""
    environment = os.environ | {"OPENBLAS_NUM_THREADS": "1"}
    axes: dict[str, subprocess.Popen[bytes]] = {}

    def starting() -> int:
        return sum(name not in heard.count and axis.poll() is None for name, axis in axes.items())

    try:
        for path in configs:
            until(lambda: starting() < (os.cpu_count() or 1), 10 * PATIENCE_S)
            command = [sys.executable, "-m", "observer", "run", "--config", str(path)]
            with (folder / f"{path.stem}.said").open("wb") as said:
                axes[path.stem] = subprocess.Popen(command, stderr=said, env=environment)
        yield axes
    finally:
        for axis in axes.values():
            axis.kill()
            axis.wait(PATIENCE_S)


def main() -> None:
    """Start the axes, listen, and say what was heard; exit code 1 where an axis was not."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--axes", type=int, default=50)
    parser.add_argument("--seconds", type=float, default=60.0)
    asked = parser.parse_args()
    with tempfile.TemporaryDirectory() as place, Router() as router:
        folder = Path(place)
        configs = axes_of(folder, asked.axes, router.endpoint)
        begun_s = time.monotonic()
        with listening_at(router.endpoint) as heard, served(configs, folder, heard) as axes:
            until(lambda: len(heard.count) == asked.axes, 10 * PATIENCE_S)
            print(f"{len(heard.count)} of {asked.axes} axes heard after {time.monotonic() - begun_s:.0f} s")
            pids = [axis.pid for axis in axes.values()]
            before, cpu_s, lost = dict(heard.count), sum(map(computed_s, pids)), heard.lost
            end_s = time.monotonic() + asked.seconds
            until(lambda: time.monotonic() > end_s, asked.seconds + PATIENCE_S)
            more = {name: heard.count[name] - before[name] for name in before}
            load = (sum(map(computed_s, pids)) - cpu_s) / asked.seconds
            rss_MB = sum(map(_own_MB, pids)) / max(1, len(pids))
            due = asked.seconds / PERIOD_S
            print(
                f"in {asked.seconds:g} s each had {min(more.values())} to {max(more.values())} messages of "
                f"{due:.0f} due, {heard.lost - lost} lost on the way; {load:.2f} cores in all, "
                f"{1000 * load / asked.axes:.1f} ms of a core a second and {rss_MB:.0f} MB for each"
            )
            for axis in axes.values():
                axis.send_signal(signal.SIGTERM)
            print(f"ended with exit codes {sorted({axis.wait(PATIENCE_S) for axis in axes.values()})}")
        sys.exit(0 if len(heard.count) == asked.axes and min(more.values()) > due / 2 else 1)


def _own_MB(pid: int) -> float:
    """Memory that goes with a process: what it shares with others counts in parts."""
    lines = Path(f"/proc/{pid}/smaps_rollup").read_text().splitlines()
    return next(int(line.split()[1]) for line in lines if line.startswith("Pss:")) / 1024


if __name__ == "__main__":
    main()
