"""The end of a run: one table and one page of everything in the folder."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from observer.fleet.journal import Row, rows_in
from observer.fleet.report import write_report
from observer.fleet.table import write_table


def conclude(output: Path, rows: Sequence[Row]) -> list[Row]:
    """Write `results.parquet` and `report.html` of all that is done in a folder, by this run or others.

    Returns the rows of this run that failed, in their order, which stand in both files too.
    """
    failures = [row for row in rows if row["problem"] is not None]
    failures.sort(key=lambda row: str(row["folder"]))
    lost = {row["folder"] for row in failures}  # there may be results of an older log of that name
    places = {_work(row): row["folder"] for row in rows}
    there = [
        row
        for row in rows_in(output)
        if row["folder"] not in lost and places.get(_work(row), row["folder"]) == row["folder"]
    ]
    write_table(output / "results.parquet", [*there, *failures])
    write_report(output / "report.html", there, failures)
    return failures


def _work(row: Row) -> tuple[str, ...]:
    """What was done, wherever it stands: logs may have changed places since, among others of their name."""
    return (row["machine"], row["verb"], *row["logs"])
