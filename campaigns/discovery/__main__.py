"""`make discover-campaign`: run the cases that have not been run, and write the summary."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import NamedTuple

from rich.console import Console

from campaigns.discovery.summary import housed_summary, rough_summary, summary, typical_summary
from campaigns.discovery.suspects import SuspectRow, suspect_summary, try_suspect
from campaigns.discovery.trial import Row, rows_of, try_entry
from campaigns.resumable import Rows, go_on, read_rows, show
from tests.truth.machine.entries import (
    FIRST_SEED,
    Entry,
    campaign,
    housed_campaign,
    rough_campaign,
    slice_entries,
    suspect_campaign,
    typical_campaign,
)

FOLDER, PAGE = Path("docs/campaign"), Path("docs/discovery.md")
MARKS = ("<!-- campaign -->", "<!-- end of campaign -->")
TYPICAL_MARKS = ("<!-- typical users -->", "<!-- end of typical users -->")
ROUGH_MARKS = ("<!-- rough -->", "<!-- end of rough -->")
HOUSED_MARKS = ("<!-- housings -->", "<!-- end of housings -->")
SUSPECT_MARKS = ("<!-- suspects -->", "<!-- end of suspects -->")
GROUPS = ("null", "ladder", "outside", "pair", "ambiguous", "poor", "absent", "faulty")


def main() -> None:
    """Run the campaign, or go on with it."""
    options = _options()
    options.folder.mkdir(parents=True, exist_ok=True)
    own = SLICES[options.slice]
    table = options.folder / own.table
    entries = own.entries() if options.first_seed is None else own.entries(options.first_seed)
    entries = [e for e in entries if not options.only or options.only in _marks(e)][:: options.every]
    known = {row["name"] for row in latest(table) if row["outcome"] != "failed"}
    waiting = [e for e in entries if e.name not in known]
    console = Console()
    console.print(f"{len(entries)} cases, {len(entries) - len(waiting)} already in {table}")
    answers = options.answers or Path("build/campaign/answers")
    go_on(waiting, partial(rows_of, own.trial, answers), table, console, options.workers, _shown)
    page = PAGE if options.folder == FOLDER else options.folder / "summary.md"
    show(page, own.summary(latest(table)), own.marks)
    console.print(f"{table} and {page} written")


class Slice(NamedTuple):
    """A campaign of its own: its `table`, its cases, what the page says of them between which marks, and how
    one is tried.
    """

    table: str
    entries: Callable[..., list[Entry]]
    summary: Callable[[Rows], str]
    marks: tuple[str, str]
    trial: Callable[[Entry, Path], Row | SuspectRow] = try_entry


SLICES: dict[str | None, Slice] = {
    None: Slice("results.csv", campaign, summary, MARKS),
    "ci": Slice("results.csv", slice_entries, summary, MARKS),
    "typical": Slice("typical.csv", typical_campaign, typical_summary, TYPICAL_MARKS),
    "rough": Slice("rough.csv", rough_campaign, rough_summary, ROUGH_MARKS),
    "housings": Slice("housings.csv", housed_campaign, housed_summary, HOUSED_MARKS),
    "suspects": Slice("suspects.csv", suspect_campaign, suspect_summary, SUSPECT_MARKS, try_suspect),
}


def latest(table: Path) -> list[dict[str, str]]:
    """The table's lines in the order of their names, the last of each."""
    last = {row["name"]: row for row in read_rows(table)}
    return [last[name] for name in sorted(last)]


def _shown(rows: Rows) -> str:
    (row,) = rows
    good = "good" if row["good"] == "1" else f"[bold]{row['outcome']}[/bold]"
    return f"{row['name']}: {good}"


def _marks(entry: Entry) -> set[str]:
    """What `--only` can ask for: a group, a kind of effect, or one case."""
    return {entry.group, entry.name, *(e.kind for e in entry.case.effects)}


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="make discover-campaign", description=__doc__)
    parser.add_argument(
        "--folder", type=Path, default=FOLDER, help=f"of results.csv ({FOLDER}, described in {PAGE})"
    )
    parser.add_argument("--answers", type=Path, help="of the answers (build/campaign/answers)")
    parser.add_argument(
        "--slice",
        choices=[name for name in SLICES if name],
        help="a few cases of every sort, the machines of typical users, what is rough about real ones, "
        "sensors on housings only, or logs with something wrong",
    )
    parser.add_argument("--only", help=f"one group ({', '.join(GROUPS)}), kind of effect, or case")
    parser.add_argument(
        "--every", type=int, default=1, metavar="N", help="only every Nth case, from all groups"
    )
    parser.add_argument("--first-seed", type=int, help=f"{FIRST_SEED}; below 3000: to set thresholds on")
    parser.add_argument("--workers", type=int, default=2)
    options = parser.parse_args()
    if options.every < 1:
        parser.error("--every takes a number from 1 on")
    if options.folder == FOLDER and (options.slice == "ci" or options.first_seed not in (None, FIRST_SEED)):
        parser.error(f"{FOLDER} is for the campaign's own seeds; give another --folder")
    return options


if __name__ == "__main__":
    main()
