"""`python -m tests.campaign`: run what of the campaign has not been run, and write its summary."""

from __future__ import annotations

import argparse
import csv
import multiprocessing
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from pathlib import Path

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from tests.campaign.summary import rough_summary, summary, typical_summary
from tests.campaign.trial import Row, try_entry
from tests.truth.machine.entries import (
    FIRST_SEED,
    Entry,
    campaign,
    rough_campaign,
    slice_entries,
    typical_campaign,
)

FOLDER, PAGE = Path("docs/campaign"), Path("docs/discovery.md")
MARKS = ("<!-- campaign -->", "<!-- end of campaign -->")
TYPICAL_MARKS = ("<!-- typical users -->", "<!-- end of typical users -->")
ROUGH_MARKS = ("<!-- rough -->", "<!-- end of rough -->")
SLICES = {
    "typical": ("typical.csv", typical_campaign, typical_summary, TYPICAL_MARKS),
    "rough": ("rough.csv", rough_campaign, rough_summary, ROUGH_MARKS),
}
"""Campaigns of their own: table, cases, summary, and where that stands on the page."""
GROUPS = ("null", "ladder", "outside", "pair", "ambiguous", "poor", "absent", "faulty")


def main() -> None:
    """Run the campaign, or go on with it."""
    options = _options()
    options.folder.mkdir(parents=True, exist_ok=True)
    whole = ("results.csv", slice_entries if options.slice else campaign, summary, MARKS)
    name, every, told, marks = SLICES.get(options.slice, whole)
    table = options.folder / name
    entries = every() if options.first_seed is None else every(options.first_seed)
    entries = [e for e in entries if not options.only or options.only in _marks(e)]
    known = {row["name"] for row in read_rows(table) if row["outcome"] != "failed"}
    waiting = [e for e in entries if e.name not in known]
    console = Console()
    console.print(f"{len(entries)} cases, {len(entries) - len(waiting)} already in {table}")
    answers = options.answers or Path("build/campaign/answers")
    run_entries(waiting, table, answers, options.workers, console)
    page = PAGE if options.folder == FOLDER else options.folder / "summary.md"
    before = page.read_text(encoding="utf-8") if page.exists() else ""
    page.write_text(with_tables(before, told(read_rows(table)), marks), encoding="utf-8")
    console.print(f"{table} and {page} written")


def run_entries(entries: Sequence[Entry], table: Path, answers: Path, workers: int, console: Console) -> None:
    """Search and judge cases, a line of the table as soon as one is done; an interrupted run can go on."""
    columns = (
        TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn(compact=True)
    )  # fmt: skip
    pool = ProcessPoolExecutor(workers, mp_context=multiprocessing.get_context("spawn"))
    with pool, Progress(*columns, console=console, speed_estimate_period=600.0) as progress:
        task = progress.add_task("searching", total=len(entries))
        jobs = [pool.submit(try_entry, entry, answers) for entry in entries]
        try:
            for job in as_completed(jobs):
                row = job.result()
                append_row(table, row)
                good = "good" if row.good == "1" else f"[bold]{row.outcome}[/bold]"
                progress.update(task, advance=1, description=f"{row.name}: {good}")
        except KeyboardInterrupt:
            pool.shutdown(cancel_futures=True)
            raise SystemExit("interrupted; the same command goes on from here") from None


def with_tables(page: str, tables: str, marks: tuple[str, str] = MARKS) -> str:
    """The page with its tables, between the two marks, replaced; a page without marks becomes the tables."""
    head, begin, rest = page.partition(marks[0])
    _, end, tail = rest.partition(marks[1])
    return f"{head}{begin}\n\n{tables}\n{end}{tail}" if begin and end else tables


def append_row(table: Path, row: Row) -> None:
    """Add a line to the table, with the header before the first."""
    fresh = not table.exists()
    with table.open("a", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, Row.columns(), lineterminator="\n")
        if fresh:
            writer.writeheader()
        writer.writerow(row.cells())


def read_rows(table: Path) -> list[dict[str, str]]:
    """The table's lines in the order of their names, the last of each; none where there is no table."""
    if not table.exists():
        return []
    with table.open(newline="", encoding="utf-8") as file:
        last = {row["name"]: row for row in csv.DictReader(file)}
    return [last[name] for name in sorted(last)]


def _marks(entry: Entry) -> set[str]:
    """What `--only` can ask for: a group, a kind of effect, or one case."""
    return {entry.group, entry.name, *(e.kind for e in entry.case.effects)}


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="make discover-campaign", description=__doc__)
    parser.add_argument(
        "--folder", type=Path, default=FOLDER, help=f"of results.csv ({FOLDER}, told in {PAGE})"
    )
    parser.add_argument("--answers", type=Path, help="of the answers (build/campaign/answers)")
    parser.add_argument(
        "--slice",
        choices=("ci", *SLICES),
        help="a few cases of every sort, the machines of typical users, or what is rough about real ones",
    )
    parser.add_argument("--only", help=f"one group ({', '.join(GROUPS)}), kind of effect, or case")
    parser.add_argument("--first-seed", type=int, help=f"{FIRST_SEED}; below 3000: to set thresholds on")
    parser.add_argument("--workers", type=int, default=2)
    options = parser.parse_args()
    if options.folder == FOLDER and (options.slice == "ci" or options.first_seed not in (None, FIRST_SEED)):
        parser.error(f"{FOLDER} is for the campaign's own seeds; give another --folder")
    return options


if __name__ == "__main__":
    main()
