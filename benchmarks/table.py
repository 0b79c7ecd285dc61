"""The one table of results, and what a result is."""

from __future__ import annotations

import csv
from collections.abc import Sequence
from dataclasses import asdict, dataclass, fields
from pathlib import Path

from rich.table import Table

NOT_JUDGED = "–"


@dataclass(frozen=True, slots=True)
class Result:
    """One row: what was done, our figure, whose figure stands beside it, the ratio, and the goal.

    `met` is None where the row only informs or could not be measured (`ours` then says why). `times` is the
    ratio as a number where it is to be kept from commit to commit, `more` whether more of it is better.
    """

    work: str
    ours: str
    beside: str = ""
    ratio: str = ""
    goal: str = ""
    met: bool | None = None
    times: float | None = None
    more: bool = True


def judged(
    work: str,
    ours: str,
    beside: str,
    ratio: float,
    *,
    at_least: float | None = None,
    at_most: float | None = None,
) -> Result:
    """A row whose ratio has a bound."""
    bound = f"≥ {at_least:g} ×" if at_least is not None else f"≤ {at_most:g} ×"
    met = ratio >= at_least if at_least is not None else at_most is not None and ratio <= at_most
    return Result(work, ours, beside, f"{ratio:.3g} ×", bound, met, ratio, at_least is not None)


def render(results: Sequence[Result], note: str, kept: Sequence[str] = ()) -> Table:
    """The table for the terminal; `kept` says of each row what it was before."""
    table = Table(title="Speed, medians of one run", caption=note, caption_justify="left")
    for name in ("work", "ours", "beside", "ratio", "goal"):
        table.add_column(name, overflow="fold")
    table.add_column("met", justify="center")
    if kept:
        table.add_column("kept before", overflow="fold")
    for k, row in enumerate(results):
        met = NOT_JUDGED if row.met is None else "[green]yes[/]" if row.met else "[bold red]no[/]"
        table.add_row(row.work, row.ours, row.beside, row.ratio, row.goal, met, *kept[k : k + 1])
    return table


def write(path: Path, results: Sequence[Result]) -> None:
    """The same rows as CSV."""
    with path.open("w", newline="") as file:
        writer = csv.DictWriter(file, [f.name for f in fields(Result)])
        writer.writeheader()
        writer.writerows([asdict(row) for row in results])
