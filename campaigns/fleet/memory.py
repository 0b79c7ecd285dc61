"""What a fleet takes of memory whose logs together, and one of them alone, are larger than a worker may be.

    python -m campaigns.fleet.memory --logs 60 --megabytes 50 --memory-GB 0.6

A log is CSV with many channels of a drive beside those that are needed. It is made once and is there under
as many names. The memory is what goes with each process (PSS), looked at ten times a second.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq

from observer.files.logs import Log, read_log
from observer.files.writer import write_log
from tests.logs.machines import configuration
from tests.logs.simulated import written_log

DRIVE = 48
BYTES_PER_ROW = 500
LOOK_S = 0.1
TIMES_LARGER = 8


def large(whole: Log, path: Path, megabytes: float) -> Path:
    """A log of about so many MB: a machine's sensors and inputs again and again, and a drive's channels."""
    rows = int(megabytes * 1e6 / BYTES_PER_ROW)
    again, rng = np.arange(rows) % len(whole), np.random.default_rng(0)
    kept = [
        name
        for name in whole.channels
        if name in ("nut_position_m", "screw_speed_rpm") or (name.endswith("_degC") and "field" not in name)
    ]
    columns = {name: whole.values[again, whole.channels.index(name)] for name in kept}
    columns |= {f"drive_{i}": np.round(rng.normal(0.0, 10.0, rows), 4) for i in range(DRIVE)}
    write_log(path, np.arange(rows, dtype=float), columns)
    return path


def below(parent: int) -> list[int]:
    """The processes that one has started, and those they have."""
    found: list[int] = []
    for file in Path("/proc").glob("[0-9]*/stat"):
        try:
            if int(file.read_text().rsplit(")", 1)[1].split()[1]) == parent:
                found += [int(file.parent.name), *below(int(file.parent.name))]
        except OSError:
            continue
    return found


def pss_MB(pid: int) -> float:
    """Memory that goes with a process: what it shares with others counts in parts. 0 if it has ended."""
    try:
        lines = Path(f"/proc/{pid}/smaps_rollup").read_text(encoding="ascii").splitlines()
    except OSError:
        return 0.0
    return next((int(line.split()[1]) / 1024 for line in lines if line.startswith("Pss:")), 0.0)


class Watch:
    """The peaks of a command: of the process that gives work out, of any worker, of all together."""

    def __init__(self, pid: int) -> None:
        self.own_MB = self.worker_MB = self.all_MB = 0.0
        self._pid, self._over = pid, threading.Event()
        self._thread = threading.Thread(target=self._look)
        self._thread.start()

    def _look(self) -> None:
        while not self._over.wait(LOOK_S):
            own, workers = pss_MB(self._pid), [pss_MB(pid) for pid in below(self._pid)]
            self.own_MB = max(self.own_MB, own)
            self.worker_MB = max([self.worker_MB, *workers])
            self.all_MB = max(self.all_MB, own + sum(workers))

    def end(self) -> None:
        """Look no longer."""
        self._over.set()
        self._thread.join()


def main() -> None:
    """Measure and print; exit code 1 where another log failed than the one that is too large."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--logs", type=int, default=60)
    parser.add_argument("--megabytes", type=float, default=50.0)
    parser.add_argument("--memory-GB", type=float, default=0.6)
    parser.add_argument("--workers", type=int, default=1)
    asked = parser.parse_args()
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        config = configuration(folder, 0, "m")
        whole = read_log(written_log(config, folder / "whole" / "run.parquet", 20_000))
        first = large(whole, folder / "run-000.csv", asked.megabytes)
        logs = [first, *(folder / f"run-{i:03}.csv" for i in range(1, asked.logs))]
        for log in logs[1:]:
            os.link(first, log)
        above = large(whole, folder / "above.csv", TIMES_LARGER * asked.megabytes)
        total_MB = sum(log.stat().st_size for log in logs) / 1e6
        print(
            f"{asked.logs} logs, {total_MB:.0f} MB, and one of {above.stat().st_size / 1e6:.0f} MB",
            flush=True,
        )
        command = [
            sys.executable, "-m", "observer", "fleet", "replay", *map(str, logs), str(above),
            "--config", str(config), "--output", str(folder / "out"),
            "--workers", str(asked.workers), "--memory-GB", str(asked.memory_GB),
        ]  # fmt: skip
        begun_s = time.monotonic()
        process = subprocess.Popen(command)
        watch = Watch(process.pid)
        code = process.wait()
        watch.end()
        rows = pq.read_table(folder / "out" / "results.parquet").to_pylist()
        failed = [row["problem"] for row in rows if row["problem"]]
        print(
            f"exit code {code} after {time.monotonic() - begun_s:.0f} s, {len(rows) - len(failed)} done; "
            f"peak of a worker {watch.worker_MB:.0f} MB, of the command itself {watch.own_MB:.0f} MB, of all "
            f"{watch.all_MB:.0f} MB"
        )
        print(json.dumps(failed, indent=1))
        sys.exit(0 if [above.name in problem for problem in failed] == [True] else 1)


if __name__ == "__main__":
    main()
