"""`python -m tests.campaign`: run what of the campaign has not been run, and write its summary."""

from __future__ import annotations

import argparse
import csv
import multiprocessing
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from pathlib import Path
from typing import NamedTuple

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from tests.campaign.summary import Cells, rough_summary, summary, typical_summary
from tests.campaign.suspects import SuspectRow, suspect_summary, try_suspect
from tests.campaign.trial import Row, try_entry
from tests.truth.machine.entries import (
    FIRST_SEED,
    Entry,
    campaign,
    rough_campaign,
    slice_entries,
    suspect_campaign,
    typical_campaign,
)

FOLDER, PAGE = Path("docs/campaign"), Path("docs/discovery.md")
MARKS = ("<!-- campaign -->", "<!-- end of campaign -->")
TYPICAL_MARKS = ("<!-- typical users -->", "<!-- end of typical users -->")
ROUGH_MARKS = ("<!-- rough -->", "<!-- end of rough -->")
SUSPECT_MARKS = ("<!-- suspects -->", "<!-- end of suspects -->")
GROUPS = ("null", "ladder", "outside", "pair", "ambiguous", "poor", "absent", "faulty")


def main() -> None:
    """Run the campaign, or go on with it."""
    options = _options()
    options.folder.mkdir(parents=True, exist_ok=True)
    own = SLICES[options.slice]
    table = options.folder / own.table
    entries = own.entries() if options.first_seed is None else own.entries(options.first_seed)
    entries = [e for e in entries if not options.only or options.only in _marks(e)]
    known = {row["name"] for row in read_rows(table) if row["outcome"] != "failed"}
    waiting = [e for e in entries if e.name not in known]
    console = Console()
    console.print(f"{len(entries)} cases, {len(entries) - len(waiting)} already in {table}")
    answers = options.answers or Path("build/campaign/answers")
    run_entries(waiting, table, answers, options.workers, console, own.trial)
    page = PAGE if options.folder == FOLDER else options.folder / "summary.md"
    before = page.read_text(encoding="utf-8") if page.exists() else ""
    page.write_text(with_tables(before, own.summary(read_rows(table)), own.marks), encoding="utf-8")
    console.print(f"{table} and {page} written")


class Slice(NamedTuple):
    """A campaign of its own: its `table`, its cases, what the page says of them between which marks, and how
    one is tried.
    """

    table: str
    entries: Callable[..., list[Entry]]
    summary: Callable[[Sequence[Cells]], str]
    marks: tuple[str, str]
    trial: Callable[[Entry, Path], Row | SuspectRow] = try_entry


SLICES: dict[str | None, Slice] = {
    None: Slice("results.csv", campaign, summary, MARKS),
    "ci": Slice("results.csv", slice_entries, summary, MARKS),
    "typical": Slice("typical.csv", typical_campaign, typical_summary, TYPICAL_MARKS),
    "rough": Slice("rough.csv", rough_campaign, rough_summary, ROUGH_MARKS),
    "suspects": Slice("suspects.csv", suspect_campaign, suspect_summary, SUSPECT_MARKS, try_suspect),
}


def run_entries(
    entries: Sequence[Entry],
    table: Path,
    answers: Path,
    workers: int,
    console: Console,
    one: Callable[[Entry, Path], Row | SuspectRow] = try_entry,
) -> None:
    """Search and judge cases, a line of the table as soon as one is done; an interrupted run can go on."""
    columns = (
        TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn(compact=True)
    )  # fmt: skip
    pool = ProcessPoolExecutor(workers, mp_context=multiprocessing.get_context("spawn"))
    with pool, Progress(*columns, console=console, speed_estimate_period=600.0) as progress:
        task = progress.add_task("searching", total=len(entries))
        jobs = [pool.submit(one, entry, answers) for entry in entries]
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


def append_row(table: Path, row: Row | SuspectRow) -> None:
    """Add a line to the table, with the header before the first."""
    fresh = not table.exists()
    with table.open("a", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, row.columns(), lineterminator="\n")
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
        choices=[name for name in SLICES if name],
        help="a few cases of every sort, the machines of typical users, what is rough about real ones, or "
        "logs with something wrong",
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
