"""`python -m benchmarks`: one table of every figure of the bar, in one run."""

from __future__ import annotations

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
os.environ.setdefault("OMP_NUM_THREADS", "1")

import argparse
from collections.abc import Callable
from functools import partial
from pathlib import Path

from rich.console import Console

from benchmarks import (
    daemon,
    heat_history,
    history,
    kalman_step,
    picture,
    replaying,
    searching,
    simulated_hour,
    table,
    transport,
)

NOTE = "One BLAS thread; ratios are taken within this run."


def main() -> None:
    """Measure, print, and write a file only if asked."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks", description=__doc__)
    parser.add_argument("--output", type=Path, help="also write the rows to this CSV file")
    parser.add_argument(
        "--only", nargs="+", metavar="PART", help="of step replay hour history search transport daemon"
    )
    parser.add_argument(
        "--compare", action="store_true", help="show the ratios that were kept last beside these"
    )
    parser.add_argument("--keep", action="store_true", help=f"keep this run's ratios in {history.PLACE}")
    parser.add_argument("--daemon-seconds", type=float, default=30.0, help="how long the daemon is watched")
    options = parser.parse_args()
    parts: dict[str, Callable[[], list[table.Result]]] = {
        "step": kalman_step.results,
        "replay": replaying.results,
        "hour": simulated_hour.results,
        "history": heat_history.results,
        "search": searching.results,
        "transport": transport.results,
        "daemon": partial(daemon.results, options.daemon_seconds),
    }
    if unknown := set(options.only or ()) - set(parts):
        parser.error(f"unknown part {min(unknown)}; choose from {' '.join(parts)}")
    results: list[table.Result] = []
    console = Console()
    if not console.is_terminal:
        console = Console(width=140)
    for name in options.only or parts:
        with console.status(f"measuring: {name}"):
            results += parts[name]()
    compared = history.compare(history.named(results), history.read()) if options.compare else []
    console.print(table.render(results, NOTE, [each.shown for each in compared]))
    for each in compared:
        if each.worse:
            console.print(f"[bold red]worse by more than a fifth:[/] {each.work}: {each.kept_text}")
    if options.keep:
        history.keep(results)
        picture.draw()
    if options.output:
        table.write(options.output, results)


if __name__ == "__main__":
    main()
