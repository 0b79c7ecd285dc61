"""`make first-day`: the first hours of machines as most users have them, as `observer init` configures them.

Without options the judged machines work an hour each and two of them a day; the results go into `docs/`.
With `-o` they go into a folder, together with logs, truths and configurations. Rows that are there are not
run again. `--write` writes a machine's files and replays none.
"""

from __future__ import annotations

import argparse
from functools import partial
from pathlib import Path

from rich.console import Console

from campaigns.first_day.judge import row_of, write_machine
from campaigns.first_day.promise import DAY_HOURS, HOURS, JUDGED, LONG
from campaigns.first_day.report import MARKS, machines_table, promises_table
from campaigns.resumable import go_on, read_rows, show

DOCS = Path(__file__).parents[2] / "docs"
PAGE = DOCS / "evidence" / "integrity.md"


def numbers(text: str) -> list[int]:
    """Return the numbers of a text such as "1-6,9"."""
    named: list[int] = []
    for part in text.split(","):
        low, _, high = part.partition("-")
        named += range(int(low), int(high or low) + 1)
    return named


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--machines", type=numbers, help='such as "1-6,9"; the judged ones')
    parser.add_argument("--hours", type=float, default=HOURS)
    parser.add_argument("-o", "--output", type=Path, help="folder of all files, instead of docs/")
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--anew", action="store_true", help="forget what has been run")
    parser.add_argument("--write", action="store_true", help="only write logs, truths and configurations")
    options = parser.parse_args()
    if options.output is None and (options.machines or options.write):
        parser.error("name a folder with -o")
    return options


def main() -> None:
    """Run what is missing and print the tables."""
    options = _options()
    folder: Path | None = options.output
    shifts = [(number, options.hours) for number in options.machines or JUDGED]
    shifts += [] if options.machines else [(number, DAY_HOURS) for number in LONG]
    if options.write and folder is not None:
        for number, hours in shifts:
            write_machine(folder / f"machine-{number}", number, hours)
        return
    results = (folder or DOCS / "first-day") / "results.csv"
    if options.anew:
        results.unlink(missing_ok=True)
    finished = {(int(row["machine"]), float(row["shift_h"])) for row in read_rows(results)}
    missing = [shift for shift in shifts if shift not in finished]
    go_on(missing, partial(row_of, folder=folder), results, Console(stderr=True), options.jobs)
    rows = read_rows(results)
    if folder is None:
        show(PAGE, promises_table(rows), MARKS)
    print(machines_table(rows), "", promises_table(rows), sep="\n")


if __name__ == "__main__":
    main()
