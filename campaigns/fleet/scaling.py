"""How many logs a second one and two workers replay, and where the rest of their time goes.

    python -m campaigns.fleet.scaling --logs 400 --pairs 3

Logs of three machine types are made once. Each pair is a run with one worker and one with two, in turn, so
that what else the computer does meets both. The parts: the start (imports, cluster, kernels and machines in
each worker, measured as a run of one log of each type for each worker), the work itself in one process
without Dask, and what is left.
"""

from __future__ import annotations

import argparse
import os
import resource
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

from observer.fleet.jobs import jobs_of, read_table
from observer.fleet.journal import RunOptions, finished_row
from observer.fleet.report import conclude
from observer.fleet.run import batches
from observer.fleet.work import work
from tests.logs.machines import LENGTHS_M
from tests.logs.simulated import a_fleet


class Took(NamedTuple):
    """How long a run took by the clock, and of processors, which other programs do not lengthen."""

    wall_s: float
    cpu_s: float


def one_run(table: Path, workers: int) -> Took:
    """Seconds of a whole command."""
    with tempfile.TemporaryDirectory() as output:
        command = [
            sys.executable, "-m", "observer", "fleet", "replay",
            "--table", str(table), "--output", output, "--workers", str(workers),
        ]  # fmt: skip
        before, begun_s = _of_children_s(), time.monotonic()
        subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
        return Took(time.monotonic() - begun_s, _of_children_s() - before)


def _of_children_s() -> float:
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def alone(table: Path) -> tuple[float, float, float]:
    """Processor seconds of all logs in this process, when it is warm; of the first of each type; and of what
    one process does for all others: looking what is done, portions, and the table and page at the end.
    """
    with tempfile.TemporaryDirectory() as output:
        orders = sorted(jobs_of(read_table(table), "replay"), key=lambda order: str(order.config))
        firsts = list({order.config: order for order in orders}.values())
        begun_s = time.process_time()
        work(firsts, RunOptions("replay", Path(output, "first")))
        warm_s = time.process_time()
        how = RunOptions("replay", Path(output, "all"))
        rows = work(orders, how)
        done_s = time.process_time()
        assert not any(row["problem"] for row in rows)
        assert all(finished_row(order, how) for order in orders)
        batches(orders, 2)
        conclude(how.output, rows)
        return done_s - warm_s, warm_s - begun_s, time.process_time() - done_s


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
        work_s, first_s, serial_s = alone(table)
        print(
            f"in one process without Dask: {work_s:.1f} s, {1000 * work_s / logs:.1f} ms a log; "
            f"the first of each type {first_s:.1f} s; "
            f"by the one process for all: {1000 * serial_s / logs:.2f} ms a log"
        )
        starts, alls = ({1: list[Took](), 2: list[Took]()} for _ in range(2))
        for _ in range(asked.pairs):
            for workers in (1, 2):
                starts[workers].append(one_run(small(table, workers), workers))
                alls[workers].append(one_run(table, workers))
            print(_comparison(logs, starts, alls, lambda each: each[-1]), flush=True)
        if asked.pairs:
            print("medians: " + _comparison(logs, starts, alls, _median))


def _median(each: list[Took]) -> Took:
    return Took(*(statistics.median(column) for column in zip(*each, strict=True)))


def _comparison(
    logs: int, starts: dict[int, list[Took]], alls: dict[int, list[Took]], of: Callable[[list[Took]], Took]
) -> str:
    """Two runs beside each other, and what lies between their start and their end."""
    parts = []
    for workers in (1, 2):
        start, whole = of(starts[workers]), of(alls[workers])
        # the start did three logs for each worker itself
        more = logs - len(LENGTHS_M) * workers
        parts.append(
            f"{workers} worker{'s' * (workers > 1)}: {whole.wall_s:.1f} s ({whole.cpu_s:.1f} s of cores), "
            f"{logs / whole.wall_s:.2f} logs/s; start {start.wall_s:.1f} s ({start.cpu_s:.1f}), then "
            f"{1000 * (whole.wall_s - start.wall_s) / more:.0f} ms a log "
            f"({1000 * (whole.cpu_s - start.cpu_s) / more:.0f})"
        )
    ratio = of(alls[1]).wall_s / of(alls[2]).wall_s
    return "\n  ".join([*parts, f"ratio {ratio:.2f}, load {os.getloadavg()[0]:.1f}"])


if __name__ == "__main__":
    main()
