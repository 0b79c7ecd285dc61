"""Long campaigns: a table that grows by what is done, so that they can go on, and a page that shows it."""

from __future__ import annotations

import csv
import multiprocessing
from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from pathlib import Path
from typing import TypeVar

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from campaigns.runs import note_run

Task = TypeVar("Task")
Cells = Mapping[str, str]
Rows = Sequence[Cells]


def read_rows(table: Path) -> list[dict[str, str]]:
    """The table's lines, none where there is no table."""
    if not table.exists():
        return []
    with table.open(newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


def append_rows(table: Path, rows: Rows) -> None:
    """Add lines to a table, with the header before the first; note the run of a new one."""
    table.parent.mkdir(parents=True, exist_ok=True)
    fresh = not table.exists()
    with table.open("a", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, list(rows[0]), lineterminator="\n")
        if fresh:
            writer.writeheader()
        writer.writerows(rows)
    if fresh:
        note_run(table)


def go_on(
    tasks: Iterable[Task],
    one: Callable[[Task], Rows],
    table: Path,
    console: Console,
    workers: int = 2,
    described: Callable[[Rows], str] = lambda _rows: "",
) -> None:
    """Carry tasks out, each in a process of its own kind, and add the rows of each as soon as it is done.

    `described` gives the text that is shown of them beside the progress.
    """
    columns = (
        TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn(compact=True)
    )  # fmt: skip
    pool = ProcessPoolExecutor(workers, mp_context=multiprocessing.get_context("spawn"))
    with pool, Progress(*columns, console=console, speed_estimate_period=600.0) as progress:
        jobs = [pool.submit(one, task) for task in tasks]
        shown = progress.add_task(table.stem, total=len(jobs))
        try:
            for job in as_completed(jobs):
                rows = job.result()
                append_rows(table, rows)
                progress.update(shown, advance=1, description=described(rows) or table.stem)
        except KeyboardInterrupt:
            pool.shutdown(cancel_futures=True)
            raise SystemExit("interrupted; the same command goes on from here") from None


def with_tables(page: str, tables: str, marks: tuple[str, str]) -> str:
    """The page with its tables, between the two marks, replaced; a page without marks becomes the tables."""
    head, begin, rest = page.partition(marks[0])
    _, end, tail = rest.partition(marks[1])
    return f"{head}{begin}\n\n{tables}\n{end}{tail}" if begin and end else tables


def show(page: Path, tables: str, marks: tuple[str, str]) -> None:
    """Put tables into a page, which may be a new one."""
    before = page.read_text(encoding="utf-8") if page.exists() else ""
    page.write_text(with_tables(before, tables, marks), encoding="utf-8")
