"""How many logs a second one and two workers replay, and where the rest of their time goes.

    python -m tests.fleet.scaling --logs 400 --pairs 3

Logs of three machine types are made once. Each pair is a run with one worker and one with two, in turn, so
that what else the computer does meets both. The parts: the start (imports, cluster, kernels and machines in
each worker, measured as a run of one log of each type for each worker), the work itself in one process
without Dask, and what is left.
"""

from __future__ import annotations

import argparse
import os
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from observer.fleet.journal import How
from observer.fleet.orders import orders_of, read_table
from observer.fleet.work import work
from tests.fleet.machines import LENGTHS_M, a_fleet


def one_run(table: Path, workers: int) -> float:
    """Wall seconds of a whole command."""
    with tempfile.TemporaryDirectory() as output:
        command = [
            sys.executable, "-m", "observer", "fleet", "replay",
            "--table", str(table), "--output", output, "--workers", str(workers),
        ]  # fmt: skip
        begun_s = time.monotonic()
        subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
        return time.monotonic() - begun_s


def alone(table: Path) -> tuple[float, float]:
    """Wall seconds of all logs in this process, when it is warm; and those of the first of each type."""
    with tempfile.TemporaryDirectory() as output:
        orders = sorted(orders_of(read_table(table), "replay"), key=lambda order: str(order.config))
        firsts = list({order.config: order for order in orders}.values())
        begun_s = time.monotonic()
        work(firsts, How("replay", Path(output, "first")))
        warm_s = time.monotonic()
        rows = work(orders, How("replay", Path(output, "all")))
        assert not any(row["problem"] for row in rows)
        return time.monotonic() - warm_s, warm_s - begun_s


def small(table: Path, workers: int) -> Path:
    """A table with one log of each type for each worker, for which a run is all start."""
    lines = table.read_text(encoding="utf-8").splitlines()
    kept = [
        row
        for length_m in LENGTHS_M
        for row in [r for r in lines if r.endswith(f"-{length_m:g}.toml")][:workers]
    ]
    path = table.with_name(f"small-{workers}.csv")
    path.write_text("\n".join([lines[0], *kept]) + "\n", encoding="utf-8")
    return path


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--logs", type=int, default=400)
    parser.add_argument("--rows", type=int, default=1800)
    parser.add_argument("--pairs", type=int, default=3)
    asked = parser.parse_args()
    with tempfile.TemporaryDirectory() as place:
        table = a_fleet(Path(place), 3 * 4, asked.logs // 12, asked.rows)
        logs = len(read_table(table))
        print(f"{logs} logs of {asked.rows} rows, load {os.getloadavg()[0]:.1f}, {os.cpu_count()} cores")
        work_s, first_s = alone(table)
        print(
            f"in one process without Dask: {work_s:.1f} s, {1000 * work_s / logs:.1f} ms a log; "
            f"the first of each type {first_s:.1f} s"
        )
        ratios, walls, starts = [], {1: [], 2: []}, {1: [], 2: []}
        for _ in range(asked.pairs):
            for workers in (1, 2):
                starts[workers].append(one_run(small(table, workers), workers))
                walls[workers].append(one_run(table, workers))
            ratios.append(walls[1][-1] / walls[2][-1])
            print(
                "  ".join(
                    f"{w}: {walls[w][-1]:.1f} s, {logs / walls[w][-1]:.1f}/s, start {starts[w][-1]:.1f} s"
                    for w in (1, 2)
                )
                + f"  ratio {ratios[-1]:.2f}  load {os.getloadavg()[0]:.1f}",
                flush=True,
            )
        start_s, wall_s = ({w: statistics.median(all_[w]) for w in (1, 2)} for all_ in (starts, walls))
        after = {w: wall_s[w] - start_s[w] for w in (1, 2)}
        print(
            f"medians: ratio {statistics.median(ratios):.2f}; start {start_s[1]:.1f} and {start_s[2]:.1f} s; "
            f"after it {after[1]:.1f} and {after[2]:.1f} s, ratio {after[1] / after[2]:.2f}; "
            f"Dask, journal and waiting {1000 * (after[1] - work_s) / logs:.1f} ms a log"
        )


if __name__ == "__main__":
    main()
