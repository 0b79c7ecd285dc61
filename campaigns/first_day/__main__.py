"""`make first-day`: the first hours of machines as most users have them, as `observer init` configures them.

Development: `--machines 1-6`; without it the judged machines. Rows that are there are not run again.
`--write` only writes logs, truths and configurations.
"""

from __future__ import annotations

import argparse
import functools
from pathlib import Path

from rich.console import Console

from campaigns.first_day.judge import row_of, write_machine
from campaigns.first_day.promise import HOURS, JUDGED, PROMISES, Row
from campaigns.resumable import go_on, read_rows

SHOWN = (
    "machine", "first_good_s", "steps", "good", "beyond_3_sigma", "worst_um", "rms_um", "last_um", "bounded",
    "excursions", "jumps", "exclusions", "armed_s", "released", "replay_s",
)  # fmt: skip


def table(rows: list[Row]) -> str:
    """Return a line for each machine, and one for each promise."""
    lines = [" ".join(f"{name[:14]:>14}" for name in SHOWN)]
    ordered = sorted(rows, key=lambda row: int(row["machine"]))
    lines += [" ".join(f"{row[name][:14] or '–':>14}" for name in SHOWN) for row in ordered]
    lines.append("")
    for promise in PROMISES:
        sign = "≥" if promise.least else "≤"
        kept = "kept" if promise.kept(rows) else "NOT KEPT"
        lines.append(f"{promise.words}: {promise.figure(rows):.4g} ({sign} {promise.limit:g}, {kept})")
    return "\n".join(lines)


def numbers(text: str) -> list[int]:
    """Return the numbers of a text such as "1-6,9"."""
    found: list[int] = []
    for part in text.split(","):
        low, _, high = part.partition("-")
        found += range(int(low), int(high or low) + 1)
    return found


def main() -> None:
    """Run what is missing and print the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "--machines", type=numbers, default=list(JUDGED), help='such as "1-6,9"; the judged ones'
    )
    parser.add_argument("--hours", type=float, default=HOURS)
    parser.add_argument(
        "-o", "--output", type=Path, default=Path("build/first-day"), help="folder of all files"
    )
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--anew", action="store_true", help="forget what has been run")
    parser.add_argument(
        "--write", action="store_true", help="write logs, truths and configurations, replay none"
    )
    options = parser.parse_args()
    folder: Path = options.output
    if options.write:
        for number in options.machines:
            write_machine(folder / f"machine-{number}", number, options.hours)
        return
    results = folder / "results.csv"
    if options.anew:
        results.unlink(missing_ok=True)
    done = {int(row["machine"]) for row in read_rows(results)}
    one = functools.partial(row_of, hours=options.hours, folder=folder)
    wanted = [number for number in options.machines if number not in done]
    go_on(wanted, one, results, Console(stderr=True), options.jobs)
    rows: list[Row] = [row for row in read_rows(results) if int(row["machine"]) in options.machines]
    print(table(rows))


if __name__ == "__main__":
    main()
